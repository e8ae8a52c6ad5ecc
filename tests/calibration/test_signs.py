"""The note on values whose sign the load excludes, against solutions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.calibration.observations import MeasuredSeries, ObservedCurve
from porocore.calibration.reading import sign_note
from porocore.errors import ConfigurationError
from porocore.macro.boundary.symmetry import whole_specimen
from porocore.macro.problem import MacroProblem
from porocore.testing.synthetic.response import linear_law

SIDES = {face: {"normal": 0} for face in ("x-", "x+", "z-", "z+")}
TIME = {"end": 2.0, "step": 0.5, "ramp_increments": 2, "ramp_step": 0.25, "profiles": ()}
SERIES = (
    MeasuredSeries("force", "y+"),
    MeasuredSeries("force", "y-"),
    MeasuredSeries("force", "y+", component=2),
    MeasuredSeries("force", "y-", component=2),
    MeasuredSeries("settlement"),
)
HELD = {"normal": 0}
LOADED: dict[str, tuple[dict[str, Any], float]] = {
    "y+ by its normal": ({"y-": HELD, "y+": {"normal": -1}}, 0.01),
    "y+ along the axis": ({"y-": HELD, "y+": {"displacement": (None, 1, None), "pressure": 0}}, -0.01),
    "y+ by a ramp": ({"y-": HELD, "y+": {"displacement": (None, {"ramp": -0.01, "until": 1}, None)}}, 1.0),
    "y+ by a table": (
        {"y-": HELD, "y+": {"displacement": (None, {"table": [[0, 0], [1, -0.01], [2, -0.02]]}, None)}},
        1.0,
    ),
    "y- along the axis": ({"y+": HELD, "y-": {"displacement": (None, 0.01, None), "pressure": 0}}, 1.0),
    "y+ by a plate": ({"y-": HELD, "y+": {"plate": -1}}, 0.01),
    "y+ pulled": ({"y-": HELD, "y+": {"normal": 0.01}}, 1.0),
    "y+ by a traction": ({"y-": HELD, "y+": {"traction": (0, 0.01, 0), "pressure": 0}}, -1.0),
    "y+ by a follower": ({"y-": HELD, "y+": {"follower": 0.01, "pressure": 0}}, 1.0),
}


def note(series: MeasuredSeries, values: Any, problem: MacroProblem, load: float) -> str | None:
    measured = np.asarray(values, dtype=float)
    times, ones = np.arange(1.0, len(measured) + 1), np.ones(len(measured))
    return sign_note(ObservedCurve("one", series, times, "", "", 1, 1, ones, measured), problem, load)


def problem_of(boundary: dict[str, Any], load: float = 1.0, **settings: Any) -> MacroProblem:
    body = {"kind": "box", "elements": (1, 2, 1), "size": (1, 2, 1)}
    data = {"body": body, "boundary": SIDES | boundary, "time": TIME, "load": load}
    return MacroProblem.model_validate(data | settings)


@pytest.mark.parametrize("name", LOADED)
def test_the_sign_is_that_of_the_solution(name: str) -> None:
    boundary, load = LOADED[name]
    problem = problem_of(boundary, load)
    solver = pytest.importorskip("porocore_fem_skfem.macro").SkfemMacroSolver()
    solution = whole_specimen(solver.solve(solver.prepare(problem), linear_law()), problem)
    told = []
    for series in SERIES:
        has_it = not series.surface or series.surface in solution.reactions
        if not has_it:
            with pytest.raises(ConfigurationError, match="expected one with this result"):
                series.require_in(problem)
        else:
            series.require_in(problem)
            values = series.values(solution)[1:]
            assert note(series, values, problem, load) is None
            told += [series] if note(series, -values, problem, load) else []
    moved, pressed = "y+" in solution.reactions, name not in ("y+ pulled", "y- along the axis")
    assert told == [s for s in SERIES if (pressed if not s.surface else moved or s.surface == "y-")]


def test_the_note_says_what_to_do() -> None:
    problem = problem_of({"y-": HELD, "y+": {"normal": -0.01}})
    assert note(SERIES[0], [-1, -2, 0.01], problem, 1.0) == (
        "the values are below 0, but the study presses y+, so that the force on y+, positive in compression, is above "
        "0; give 'factor: -1' if the file counts the other way"
    )
    assert note(SERIES[0], [-1, -2, 0.2], problem, 1.0) is None
    assert "the study pulls y+, so that the force 2 on y- is below 0" in str(
        note(SERIES[3], [1, 2], problem, -1.0)
    )


UNCERTAIN: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "unloaded again": (
        {"y-": HELD, "y+": {"displacement": (None, {"table": [[0, 0], [1, -0.01], [2, -0.005]]}, None)}}, {},
    ),
    "an expression": ({"y-": HELD, "y+": {"displacement": (None, {"expression": "-0.01*t"}, None)}}, {}),
    "two faces": ({"y-": {"normal": 0.01}, "y+": {"normal": -0.01}}, {}),
    "suction": ({"y-": HELD, "y+": {"normal": -0.01, "pressure": -0.01}}, {}),
    "another face": ({"y-": HELD, "y+": HELD, "x+": {"normal": -0.01}}, {}),
    "weight": ({"y-": HELD, "y+": {"normal": -0.01}}, {"body_force": (0, 0.1, 0)}),
    "swollen before": ({"y-": HELD, "y+": {"normal": -0.01}}, {"initial": {"pressure": -0.1}}),
    "a cell that changes": ({"y-": HELD, "y+": {"normal": -0.01}}, {"fields": {"radius": "0.2 + 0.01*t"}}),
}  # fmt: skip


@pytest.mark.parametrize("name", UNCERTAIN)
def test_nothing_is_said_where_the_sign_is_not_certain(name: str) -> None:
    boundary, settings = UNCERTAIN[name]
    problem = problem_of(boundary, **settings)
    for series in SERIES:
        assert note(series, [1, 2], problem, 1.0) is None
        assert note(series, [-1, -2], problem, 1.0) is None
