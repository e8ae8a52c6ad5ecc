"""Notes on values that the load or the size of the body excludes, against solutions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.commands.calibration.expectations import sign_note, size_note
from porocore.commands.calibration.observations import MeasuredSeries, ObservedCurve
from porocore.commands.calibration.settings import Kind
from porocore.core.units import OutputUnits, ResultUnits, Scales, using_units
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
    MeasuredSeries("heave"),
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
    moved, down = "y+" in solution.reactions, name not in ("y+ pulled", "y- along the axis")
    vertical = "settlement" if down else "heave"
    assert told == [s for s in SERIES if (moved or s.surface == "y-" if s.surface else s.kind == vertical)]
    # The other movement stays 0, with which no measured values agree.
    other = MeasuredSeries("heave" if down else "settlement")
    assert not other.values(solution).any()
    for values in ([0.1, 0.2], [-0.1, -0.2]):
        assert f"so that the {other.kind} stays 0; change the sign of the load" in str(
            note(other, values, problem, load)
        )
    assert note(other, [0.1, -0.1], problem, load) is None


def test_the_note_says_what_to_do() -> None:
    problem = problem_of({"y-": HELD, "y+": {"normal": -0.01}})
    assert note(SERIES[0], [-1, -2, 0.01], problem, 1.0) == (
        "the values reach -2, below 0, but the study presses y+, so that the force on y+, positive in compression, is "
        "above 0; give 'factor: -1' if the file counts the other way"
    )
    assert note(SERIES[0], [-1, -2, 0.5], problem, 1.0) is None
    # A zero that is off, and rows before the load, leave the sign of the large values.
    shifted = [49.4, 48.0, 49.1, -300, -913.4, -700, -500, -400, 20]
    assert "the values reach -913.4, below 0," in str(note(SERIES[0], shifted, problem, 1.0))
    assert note(SERIES[0], [-value for value in shifted], problem, 1.0) is None
    assert note(SERIES[0], [-10, 6, 7, -8, 5], problem, 1.0) is None
    assert "the study pulls y+, so that the force 2 on y- is below 0" in str(
        note(SERIES[3], [1, 2], problem, -1.0)
    )


def test_a_note_on_a_curve_that_stays_0_says_what_was_measured() -> None:
    pulled = problem_of({"y-": HELD, "y+": {"traction": (0, {"ramp": 0.01, "until": 1}, 0), "pressure": 0}})
    assert note(SERIES[4], [0, 0.1, 0.3], pulled, 1.0) == (
        "the values reach 0.3, but the study pulls y+, so that the settlement stays 0; change the sign of the load, or "
        "give 'quantity: heave' if the movement along +y was measured"
    )
    assert "give 'quantity: settlement' and 'factor: -1' if the movement against y was measured" in str(
        note(SERIES[5], [0, -0.1], pulled, -1.0)
    )
    hung = problem_of({"x-": HELD, "y+": {"traction": (0, 0.01, 0), "pressure": 0}})
    assert note(SERIES[4], [0, 0.1, 0.3], hung, 1.0) is None


def test_positions_that_fall_are_no_settlement() -> None:
    pressed = problem_of({"y-": HELD, "y+": {"traction": (0, -0.01, 0), "pressure": 0}})
    assert note(SERIES[4], [12.4, 12.1, 11.97], pressed, 1.0) == (
        "the values begin at 12.4 and fall to 11.97, but the study presses y+, so that the settlement grows; give "
        "'offset: 12.4' and 'factor: -1' if the file holds a position"
    )
    for values in ([0.1, 0.2, 0.3], [0.3, 0.31, 0.305], [0.4, 0.38, 0.39]):
        assert note(SERIES[4], values, pressed, 1.0) is None
    times, ones = np.arange(1.0, 4), np.ones(3)
    curve = ObservedCurve("one", SERIES[4], times, "mm", "", 1, 1, ones, np.array([12.4, 12.1, 11.97]))
    with pytest.raises(ConfigurationError) as refused:
        size_note(curve, pressed)
    assert (
        "which stands on y-; the values begin at 12.4 mm and fall to 11.97 mm: give 'offset: 12.4 mm' and 'factor: -1' "
        "if they are positions, otherwise check the unit of the values"
    ) in str(refused.value)


def sized(kind: Kind, value: float, boundary: dict[str, Any], factor: float = 1.0) -> str | None:
    """Return the note on one value in units of which the length of the study, 1, has ``factor``."""
    times, unit = np.ones(1), "" if factor == 1 else "mm"
    series = MeasuredSeries(
        kind, probe="top" if kind == "displacement" else "", component=2 if kind == "displacement" else 0
    )
    curve = ObservedCurve("one", series, times, unit, "", factor, 1, times, np.array([value]))
    return size_note(curve, problem_of(boundary, probes={"top": (0, 2, 0)}))


def test_a_settlement_beyond_the_height_of_a_standing_body_is_refused() -> None:
    """The body is 1 by 2 by 1."""
    standing = {"y-": HELD, "y+": {"normal": -0.01}}
    assert sized("settlement", 2.0, standing) is None
    with pytest.raises(ConfigurationError) as refused:
        sized("settlement", 90.0, standing, factor=0.5)
    assert str(refused.value) == (
        "the settlement reaches 90 mm; expected less than 1 mm, the height of the body, which stands on y-; check the "
        "unit of the values (it is taken from 'unit:' or the heading), and macro.body"
    )
    scales = ResultUnits(
        Scales(modulus=1e3, length=1e-3, pore=1e-6, viscosity=1e-3), OutputUnits(length="mm")
    )
    with using_units(scales), pytest.raises(ConfigurationError) as refused:
        sized("settlement", 90.0, standing)
    assert "(give 'unit:' or the heading), without which they are multiples of 1 mm" in str(refused.value)


def test_displacements_several_times_as_large_as_the_body_are_noted() -> None:
    hanging = {"y+": HELD, "y-": {"normal": 0.01}}
    for kind, sign in (("settlement", 1), ("heave", 1), ("heave", -1), ("displacement", -1)):
        assert sized(kind, 6.0 * sign, hanging) is None
        assert "but the body is at most 2 long; check the unit" in str(sized(kind, 6.1 * sign, hanging))
    assert sized("pressure", 1e9, hanging) is None


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
