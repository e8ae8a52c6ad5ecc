"""What drives a body, and the forces that it answers with."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from porocore.core.formulas.time_function import TimeFunction
from porocore.core.units.results import OutputUnits, ResultUnits
from porocore.core.units.scales import Scales
from porocore.macro.problem import Boundary, MacroSetup
from porocore.report.dimensional import dimensional_rows
from porocore.report.loading_mode import LoadingMode, reactions
from porocore.report.metrics import LoadCase, case_metrics

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
    assert LoadingMode.from_setup(MacroSetup(boundary=held)) == LoadingMode(displaced, stressed)


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
        solution, reactions={"y+": top, "y-": -top, "x-": side, "z-": 1e-9 * side, "free": 0 * side}
    )


def test_peak_and_final_force_of_every_surface(plug):
    found = reactions(plug)
    assert found.keys() == {"y+", "y-", "x-"}
    assert found["y+"] == {
        "component": 2,
        "peak": -0.8,
        "time_of_peak": plug.history.time[3],
        "final": pytest.approx(-0.3),
    }
    assert found["y-"]["peak"] == 0.8
    assert (found["x-"]["component"], found["x-"]["peak"], found["x-"]["final"]) == (1, 0.1, 0.1)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert reactions(replace(plug, reactions={})) == {}
    assert reactions(replace(plug, reactions={"y+": np.zeros((len(plug.history.time), 3))})) == {}


def test_of_components_that_symmetry_makes_the_same_the_first_is_told(plug):
    force = np.ones((len(plug.history.time), 3)) * [0.0, 1.0, 1.0 + 1e-12]
    assert reactions(replace(plug, reactions={"side": force}))["side"]["component"] == 2
    assert reactions(replace(plug, reactions={"side": force * [1, 1, 1.1]}))["side"]["component"] == 3


def test_rows_with_units_are_those_of_the_drive(plug, column):
    case = LoadCase(plug, column(law="linear"))

    def names(loading_mode):
        rows = dimensional_rows(case_metrics(case), plug, 1.0, {"this study": UNITS}, loading_mode)
        return {row.name: row.values[0] for row in rows}

    stressed, moved = names(LoadingMode()), names(LoadingMode(("y+",), stressed=False))
    assert "load times E" in stressed
    assert not [name for name in stressed if "force" in name]
    assert "load times E" not in moved
    # E L² = 0.2 N.
    assert moved["peak force on y+, component 2"] == "−160 mN"
    assert moved["final force on y+, component 2"] == "−60.0 mN"
