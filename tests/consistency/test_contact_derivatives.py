"""Derivatives of a run with contact, forward and backward, against central differences."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import (
    HISTORY_SERIES,
    CellParameterChange,
    HistoryWeights,
    IndenterChange,
    LoadChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from porocore.testing.macro_checks.sensitivities import RunDerivatives

LAW = RunDerivatives.law
#: Unknowns: change, value, and the half width of the differences, short against the gap at which drainage begins.
UNKNOWNS = {
    "radius": (CellParameterChange("radius"), 0.22, 1e-6),
    "modulus": (ModulusChange(), 1.0, 2.5e-6),
    "viscosity": (ViscosityChange(), 0.01, 2.5e-8),
    "load": (LoadChange(), 1.0, 2.5e-7),
    "given": (None, 1.0, 2.5e-7),
    "ball": (IndenterChange("tip", "radius"), 0.8, 2.5e-6),
    "offset": (IndenterChange("tip", "offset"), 0.0, 2.5e-8),
}
RELATIVE = ("modulus", "viscosity")


@pytest.fixture(params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def solver(request):
    pytest.importorskip(request.param)
    return registry().get("macro solver", request.param)()


def problem(by, drained=True, **shifts):
    at = {name: value + shifts.get(name, 0.0) for name, (_, value, _) in UNKNOWNS.items()}
    E, given = at["modulus"], 0.06 if by == "displacement" else 2e-3 / at["modulus"]
    tip = {
        "shape": {"kind": "sphere", "radius": at["ball"]},
        "place": (0, 1.005 - at["offset"], 0),
        by: given * at["given"],
        "surfaces": ["y+"],
        "penalty": 200,
    }
    tip |= {"under": "sealed", "outside": "drained"} if drained else {}
    return MacroProblem.model_validate(
        {
            "body": {"kind": "box", "size": (1, 1, 1), "elements": (2, 1, 2), "grading": (2, 1, 2)},
            "boundary": {
                "x-": {"normal": 0},
                "y-": {"displacement": (0, 0, 0)},
                "z-": {"normal": 0},
                "x+": {"pressure": 0},
            },
            "contact": {"tip": tip},
            "fields": {"radius": at["radius"], "viscosity": at["viscosity"] / E},
            "load": at["load"],
            "probes": {"inside": (0.2, 0.6, 0.3)},
            "time": {"end": 0.6, "step": 0.2, "ramp_increments": 2, "ramp_step": 0.1, "profiles": ()},
            "newton": {"tolerance": 1e-12},
        }
    )


def changes(by):
    return [change or IndenterChange("tip", by) for change, *_ in UNKNOWNS.values()]


def series(of, histories, E=1.0):
    """All series but the largest pressure of the contact, which is of one point."""
    found = {name: getattr(histories, name) for name in HISTORY_SERIES}
    found |= {name: E * found[name] for name in ("pressure_max", "pressure_min")}
    found["probe"] = of.probes["inside"] * np.array([1, 1, 1, E]).reshape(
        -1, *[1] * (histories.settlement.ndim - 1)
    )
    found["reaction"] = E * of.reactions["y-"]
    units = {0: E, 4: E}
    contact = of.contact["tip"]
    return found | {f"contact {i}": units.get(i, 1.0) * contact[:, i] for i in range(7)}


@pytest.mark.parametrize("by", ["displacement", "force"])
@pytest.mark.parametrize(
    "drained", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["drained beside", "sealed"]
)
def test_derivatives_are_limits_of_differences(solver, by, drained):
    """All unknowns go along one direction; a drained surface keeps its conductance, which goes with the units."""
    run, found = solver.solve_with_sensitivities(solver.prepare(problem(by, drained)), LAW, changes(by))
    assert run.contact["tip"][-1, 2] > 0.01
    steps = {name: step for name, (*_, step) in UNKNOWNS.items()}
    if drained:
        steps |= {"modulus": 0.0, "viscosity": 0.0}
    ends = []
    for sign in (1, -1):
        moved = problem(by, drained, **{name: sign * step for name, step in steps.items()})
        end = solver.solve(solver.prepare(moved), LAW)
        ends.append(series(end, end.history, 1 + sign * steps["modulus"]))
    given = 0.06 if by == "displacement" else 2e-3
    scaled = [
        step / UNKNOWNS[name][1] if name in RELATIVE else given * step if name == "given" else step
        for name, step in steps.items()
    ]
    for quantity, values in series(found, found).items():
        wanted = (ends[0][quantity] - ends[1][quantity])[1:] / 2
        # Differences have the round-off of their values.
        scale = np.abs(wanted).max() + 1e-7 * np.abs(ends[0][quantity]).max()
        assert np.abs(values[1:] @ np.array(scaled) - wanted).max() < 1e-6 * max(scale, 1e-12), quantity


@pytest.mark.parametrize("by", ["displacement", "force"])
def test_a_pass_backwards_gives_the_same(solver, by):
    unknowns, noise = changes(by), np.random.default_rng(0)
    kept = []

    def weights(solution):
        steps = len(solution.history.time)
        kept.append(
            HistoryWeights(
                1,
                settlement=noise.normal(size=(steps, 1)),
                drained=noise.normal(size=(steps, 1)),
                reactions={"y-": noise.normal(size=(steps, 3, 1))},
                contact={"tip": noise.normal(size=(steps, 7, 1))},
            )
        )
        return kept[-1]

    prepared = solver.prepare(problem(by))
    _, gradients = solver.solve_with_gradients(prepared, LAW, unknowns, weights)
    _, found = solver.solve_with_sensitivities(prepared, LAW, unknowns)
    w = kept[0]
    wanted = w.settlement[:, 0] @ found.settlement + w.drained[:, 0] @ found.drained
    wanted = wanted + np.einsum("sc,sck->k", w.reactions["y-"][..., 0], found.reactions["y-"])
    wanted = wanted + np.einsum("sc,sck->k", w.contact["tip"][..., 0], found.contact["tip"])
    np.testing.assert_allclose(gradients[0], wanted, rtol=1e-7, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (IndenterChange("ti", "radius"), "no indenter 'ti'; did you mean 'tip'"),
        (IndenterChange("tip", "force"), "given a displacement"),
    ],
)
def test_an_indenter_that_does_not_change(solver, change, said):
    with pytest.raises(ConfigurationError, match=said):
        solver.solve_with_sensitivities(solver.prepare(problem("displacement")), LAW, [change])


@pytest.mark.parametrize("by", ["displacement", "force"])
def test_a_run_that_was_killed_goes_on_to_the_last_bit(by, tmp_path):
    pytest.importorskip("skfem")
    make = registry().get("macro solver", "skfem")
    whole = make().solve(make().prepare(problem(by)), LAW)

    class Killed(Exception):
        pass

    def kill(report):
        if report.time > 0.15:
            raise Killed

    path = tmp_path / "state.h5"
    solver = make(checkpoint_seconds=0)
    with pytest.raises(Killed):
        solver.solve(solver.prepare(problem(by)), LAW, checkpoint=path, on_step=kill)
    solver = make(checkpoint_seconds=0)
    resumed = solver.solve(solver.prepare(problem(by)), LAW, checkpoint=path)
    np.testing.assert_array_equal(resumed.contact["tip"], whole.contact["tip"])
    np.testing.assert_array_equal(resumed.profiles[-1].u, whole.profiles[-1].u)
    resumed.save(tmp_path / "s.h5")
    again = type(resumed).load_file(tmp_path / "s.h5")
    np.testing.assert_array_equal(again.contact["tip"], whole.contact["tip"])
    np.testing.assert_array_equal(again.profiles[-1].contact_pressure, whole.profiles[-1].contact_pressure)
    assert again.profiles[-1].contact_pressure.max() > 0
