"""What drives a body, and the forces that it answers with."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from porocore.core.formulas import TimeFunction
from porocore.core.units import OutputUnits, ResultUnits, Scales, using_units
from porocore.macro.problem import Boundary, MacroSetup
from porocore.report.context import LoadingMode, reactions, relaxation
from porocore.report.dimensional import dimensional_rows
from porocore.report.metrics import LoadCase, case_metrics
from porocore.report.text import force_sentences, force_warnings

UNITS = ResultUnits(
    Scales(modulus=2e3, length=0.01, pore=1e-6, viscosity=1e-3), OutputUnits(length="mm", force="mN")
)
RAMP = TimeFunction(ramp=-0.2, until=1.0)


@pytest.mark.parametrize(
    ("top", "displaced", "stressed"),
    [
        ({"traction": (0, 1, 0), "pressure": 0}, (), True),
        ({"displacement": (None, -0.2, None), "pressure": 0}, ("y+",), False),
        ({"displacement": (0, RAMP, 0)}, ("y+",), False),
        ({"normal": -0.2}, ("y+",), False),
        ({"normal": 0.0}, (), False),
        ({"plate": -0.2}, (), True),
        ({"follower": RAMP}, (), True),
        ({"displacement": (0, RAMP, 0), "pressure": 0.1}, ("y+",), True),
        ({"flux": 0.1}, (), False),
    ],
)
def test_what_drives_a_body(top, displaced, stressed):
    held = {"y-": Boundary(displacement=(0, 0, 0)), "y+": Boundary(**top)}
    assert LoadingMode.from_setup(MacroSetup(boundary=held)) == LoadingMode(
        displaced, stressed, "follower" in top, scales=top.get("traction") == (0, 1, 0)
    )


@pytest.mark.parametrize(
    ("top", "scales"),
    [
        ({"traction": (0, -1, 0)}, True),
        ({"follower": 1.0}, True),
        ({"pressure": 1.0}, True),
        ({"plate": -1.0}, False),
        ({"traction": (0, -0.2, 0)}, False),
        ({"follower": RAMP, "pressure": 0.3}, False),
        ({"displacement": (None, 1.0, None)}, False),
    ],
)
def test_the_load_is_a_stress_where_it_multiplies_one(top, scales):
    """Under a plate's force of 58 mN and the factor 1, the report said that the load times E is 400 kPa."""
    assert LoadingMode.from_setup(MacroSetup(boundary={"y+": Boundary(**top)})).scales is scales


@pytest.fixture
def plug(column):
    """Pushed down at the top, which peaks in the fourth step; its sides push back less."""
    solution = column()
    top = np.zeros((len(solution.history.time), 3))
    top[:, 1] = -0.3 * np.minimum(1, solution.history.time)
    top[3, 1] = -0.8
    side = np.zeros_like(top)
    side[:, 0], side[:, 1] = 0.1, 1e-3
    return replace(
        solution,
        reactions={"y+": top, "y-": -top, "x-": side, "z-": 1e-9 * side, "free": 0 * side},
        compression={"y+": -top[:, 1], "y-": -top[:, 1]},
    )


def test_peak_and_final_force_of_every_surface(plug):
    found = reactions(plug)
    assert found.keys() == {"y+", "y-", "x-"}
    time = plug.history.time
    # From 0.8 to 0.015 t of the next step, and then up again to 0.3: in that step it falls by more than 0.95 · 0.5.
    step, fall = time[4] - time[3], 0.8 - 0.3 * time[4]
    assert found["y+"] == {
        "force": "compressive",
        "peak": 0.8,
        "time_of_peak": time[3],
        "final": pytest.approx(0.3),
        "drift": pytest.approx(0.0, abs=1e-12),
        "equilibrium": pytest.approx(0.3),
        "peak_over_final": pytest.approx(8 / 3),
        "drop": pytest.approx(5 / 8),
        "relaxed_50_percent": pytest.approx(step * 0.25 / fall),
        "relaxed_95_percent": pytest.approx(step * 0.475 / fall),
    }
    assert found["y-"]["peak"] == 0.8
    assert (found["x-"]["force"], found["x-"]["peak"], found["x-"]["final"]) == ("along x", 0.1, 0.1)
    assert found["x-"]["relaxed_50_percent"] is None
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert reactions(replace(plug, reactions={})) == {}
    assert reactions(replace(plug, reactions={"y+": np.zeros((len(plug.history.time), 3))})) == {}


def test_of_components_that_symmetry_makes_the_same_the_first_is_told(plug):
    force = np.ones((len(plug.history.time), 3)) * [0.0, 1.0, 1.0 + 1e-12]
    assert reactions(replace(plug, reactions={"side": force}))["side"]["force"] == "along y"
    assert reactions(replace(plug, reactions={"side": force * [1, 1, 1.1]}))["side"]["force"] == "along z"


def test_rows_with_units_are_those_of_the_drive(plug, column):
    case = LoadCase(plug, column(law="linear"))

    def names(loading_mode):
        rows = dimensional_rows(case_metrics(case), plug, np.eye(3), {"this study": UNITS}, loading_mode)
        return {row.name: row.values[0] for row in rows}

    stressed, moved = names(LoadingMode(scales=True)), names(LoadingMode(("y+",), stressed=False))
    assert "load times E" in stressed
    assert not [name for name in stressed if "force" in name]
    assert "load times E" not in moved
    assert "load times E" not in names(LoadingMode())
    # A settlement that is prescribed is no result.
    assert [name for name in stressed if "settlement" in name]
    assert not [name for name in moved if "settlement" in name or name.startswith("99 %")]
    # E L² = 0.2 N.
    assert moved["peak compressive force on y+"] == "160 mN"
    assert moved["final compressive force on y+"] == "60.0 mN"


def test_a_pulled_surface_bears_a_tensile_force(plug):
    pulled = replace(
        plug,
        reactions={name: -force for name, force in plug.reactions.items()},
        compression={name: -force for name, force in plug.compression.items()},
    )
    found = reactions(pulled)["y+"]
    assert (found["force"], found["peak"], found["final"]) == ("tensile", 0.8, pytest.approx(0.3))


def test_times_of_an_exponential_relaxation():
    time = np.linspace(0, 30, 3001)
    force = np.where(time < 1, time * 5, 2 + 3 * np.exp(-(time - 1)))
    found = relaxation(time, force)
    assert (found["peak"], found["time_of_peak"]) == (pytest.approx(5.0), pytest.approx(1.0))
    assert found["peak_over_final"] == pytest.approx(2.5)
    assert found["relaxed_50_percent"] == pytest.approx(math.log(2), rel=1e-3)
    assert found["relaxed_95_percent"] == pytest.approx(math.log(20), rel=1e-3)
    assert found["equilibrium"] == pytest.approx(2.0)
    # Ended before it has relaxed, it has no equilibrium force.
    early = relaxation(time[:200], force[:200])
    assert early["equilibrium"] is None
    assert early["drift"] > 0.01
    # A force that is zero has no ratio, and one that only grows does not relax.
    assert relaxation(time, 0 * time)["peak_over_final"] is None
    assert relaxation(time, time)["relaxed_50_percent"] is None


def test_a_force_that_hardly_drops_says_why_it_has_no_time_of_relaxation(plug):
    force = np.minimum(1, plug.history.time / 5) * (1 + 3e-4 * (plug.history.time < 50))
    drained = replace(plug, compression={"y+": force}, reactions={"y+": np.outer(force, [0, -1, 0])})
    found = reactions(drained)["y+"]
    assert found["drop"] == pytest.approx(3e-4, rel=1e-3)
    assert found["relaxed_95_percent"] is None
    with using_units(UNITS):
        (sentence, _) = force_sentences(LoadCase(drained, drained), ("y+",))
    assert sentence.endswith(
        "200.0 mN in equilibrium: a drop below 0.1 %, so no time of relaxation is given."
    )


def test_a_run_under_prescribed_displacement_is_told_by_its_force(plug, column):
    case = LoadCase(plug, replace(plug, law="linear"))
    with using_units(UNITS):
        first, second = force_sentences(case, ("y+",))
    assert first.startswith("The compressive force on y+ (load −0.2) is 160.0 mN at its peak, at t = ")
    assert "60.00 mN in equilibrium, a ratio of 2.67" in first
    assert "95 %" in first
    assert second == "With linear poroelasticity, its peak is 160.0 mN, and it is 60.00 mN at the end."
    assert force_warnings(case, ("y+",)) == []
    force = 0.3 + 0.5 * np.exp(-plug.history.time / 50)
    early = LoadCase(
        replace(plug, compression={"y+": force}, reactions={"y+": np.outer(force, [0, -1, 0])}), plug
    )
    assert "at the end, still changing" in force_sentences(early, ("y+",))[0]
    (warning,) = force_warnings(early, ("y+",))
    assert "still changed by" in warning
    assert force_sentences(LoadCase(column(), column()), ("y+",)) == []
