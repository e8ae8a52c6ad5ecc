"""Bodies that move along x or z: the same figures as along y, and no settlement made of round-off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from porocore.core.units import ResultUnits
from porocore.macro.analytic import Terzaghi
from porocore.macro.problem import MacroProblem
from porocore.report.context import LoadingMode, law_differences
from porocore.report.dimensional import dimensional_rows
from porocore.report.figures import history_figure
from porocore.report.html import render
from porocore.report.metrics import LoadCase, case_metrics
from porocore.report.words.results import case_sentences, case_warnings
from porocore.testing.synthetic.response import linear_law
from tests.helpers.report_page import Page

Solver = pytest.importorskip("porocore_fem_skfem.macro").SkfemMacroSolver
LAW = linear_law()
#: Share of the time of consolidation h²/c_v at which a run ends.
SHORT, LONG = 0.2, 4.0
HEIGHT = 2.0


def column(axis, share, sense=1.0, rounding=0.0):
    """Solution of a column that stands along an axis, up to a share of its time of consolidation."""
    end = share * HEIGHT**2 / LAW.coefficients.consolidation_coefficient()
    name = "xyz"[axis]
    size, counts = np.full(3, 0.1), np.ones(3, int)
    size[axis], counts[axis] = HEIGHT, 8
    boundary = {f"{each}{sign}": {"normal": 0} for each in "xyz" for sign in "-+"}
    foot, top = (f"{name}-", f"{name}+") if sense > 0 else (f"{name}+", f"{name}-")
    traction = [0.0, 0.0, 0.0]
    traction[axis] = -1e-3 * sense
    boundary |= {foot: {"normal": 0}, top: {"traction": traction, "pressure": 0}}
    time = {"end": end, "step": end / 40, "ramp_increments": 1, "ramp_step": end / 400, "profiles": ()}
    body = {"kind": "box", "size": size.tolist(), "elements": counts.tolist()}
    problem = MacroProblem.model_validate({"body": body, "boundary": boundary, "time": time})
    solver = Solver()
    return solver.solve(solver.prepare(problem), LAW)


@pytest.mark.parametrize("share", [SHORT, LONG])
def test_a_column_is_as_steady_along_x_and_z_as_along_y(share):
    """Along z it was that of displacements of 5e-14 µm along y: 10.8 % of a body at rest, 0.1 % of one that moved."""
    found = {axis: case_metrics(LoadCase(column(axis, share), None)) for axis in range(3)}
    upright = found[1]["nonlinear"]
    assert upright["largest_displacement"] == pytest.approx(upright["largest_settlement"], rel=1e-12)
    for axis, metrics in found.items():
        law = metrics["nonlinear"]
        for name in ("steady_drift", "largest_displacement", "final_displacement", "max_pressure", "drained"):
            assert law[name] == pytest.approx(upright[name], rel=1e-6, abs=1e-12)
        assert law["largest_component"] == f"u_{axis + 1}"
        assert law["moves_along_y"] == (axis == 1)
    told = {axis: case_warnings(metrics) for axis, metrics in found.items()}
    assert told[0] == told[1] == told[2]
    assert len(told[0]) == (share == SHORT)
    if told[0]:
        exact = Terzaghi.from_coefficients(LAW.coefficients, HEIGHT, 1e-3)
        end = SHORT * HEIGHT**2 / exact.consolidation_coefficient
        drift = 1 - exact.settlement(0.9 * end) / exact.settlement(end)
        assert upright["steady_drift"] == pytest.approx(float(drift), rel=0.03)
        assert f"still changed by {100 * upright['steady_drift']:.1f} %" in told[0][0]


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_column_along_z_has_no_settlement(context, sense, unpictured):
    solution = column(2, SHORT, sense)
    # What an irregular mesh adds along y.
    rough = replace(
        solution, history=replace(solution.history, settlement=4e-3 * solution.history.displacement)
    )
    metrics = case_metrics(LoadCase(rough, None))
    (told,) = case_sentences(metrics)
    assert "the body moves along z, and by less than 1 % of that along y" in told
    assert "A probe (macro.probes) has u_3 of a point." in told
    assert case_sentences(metrics, settles=False) == []
    (row, *_) = dimensional_rows(metrics, rough, np.eye(3), {"this study": ResultUnits()}, LoadingMode())
    assert row.name == "largest displacement, mostly u_3"
    assert history_figure(rough, None).axes[0].get_ylabel().startswith("largest displacement")
    (gap,) = law_differences(LoadCase(rough, None, (replace(rough, law="direct"),)))
    assert gap["settlement"] is None
    assert gap["pressure_max"]["largest_percent"] == 0
    text = Page(render(replace(context, published=None, cases=(LoadCase(rough, None),)))).text
    assert "largestdisplacement" in text
    assert "finalsettlement" not in text
