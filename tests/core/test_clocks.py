"""The time left of recorded tasks: two macro solves and a sampling, as they went on a slow machine.

``clock_traces.json`` holds the seconds that each took, and when its forecast was told what: the end of a step, or a
state with how many the sampler foresaw.
"""

import io
import json
from pathlib import Path

import numpy as np
import pytest

from porocore.core.console import Console
from porocore.core.inputs import InputSpace
from porocore.macro.integration.newton import StepForecast
from porocore.macro.problem import MacroProblem
from porocore.sampling.forecast import StateForecast

TRACES = json.loads(Path(__file__).with_name("clock_traces.json").read_text(encoding="utf-8"))
FIXED = {"displacement": (0, 0, 0)}
PISTON = MacroProblem(
    boundary={"y-": FIXED, "y+": {"displacement": (None, {"ramp": -0.15, "until": 0.2}, None), "pressure": 0}},
    time={"end": 2.0, "step": 0.2, "ramp_increments": 10, "ramp_step": 0.02, "tolerance": 1e-3,
          "profiles": (0.05, 0.2, 0.4)},
)  # fmt: skip
STRIP = MacroProblem(
    boundary={"y-": FIXED, "y+": {"traction": (0, -1, 0), "pressure": 0}},
    time={"end": 40, "step": 2, "ramp_increments": 5, "ramp_step": 0.1, "tolerance": 2e-3, "profiles": (0.5, 5)},
)  # fmt: skip


class Steps:
    """The forecast of a macro solve."""

    def __init__(self, problem):
        self.forecast = StepForecast(problem)

    def told(self, time):
        self.forecast.add(time)
        return self.forecast.work


class Sweeps:
    """The forecast of sweeps over pressure and stretch; each state begins from another."""

    def __init__(self):
        self.forecast = StateForecast(InputSpace(("p", "H22"), (-0.02, -0.4), (0.24, 0.04)))

    def told(self, p, stretch, expected):
        self.forecast.add((p, stretch), expected, outward=True)
        return self.forecast.work


def shown(name, forecast):
    """Return (n, 2): share of the time, and time left over what was left, NaN where none is shown."""
    seconds, now, rows = TRACES[name]["seconds"], 0.0, []
    with Console(io.StringIO(), lambda: now).task(name, "") as task:
        if isinstance(forecast, Sweeps):
            task.update(0, 1, work=(0.0, 1.0))
        for now, *told in TRACES[name]["reports"]:
            task.update(now, seconds, work=forecast.told(*told))
            if now < seconds:
                rows.append((now / seconds, np.nan if task.left is None else task.left / (seconds - now)))
    return np.array(rows)


@pytest.mark.parametrize(
    ("name", "forecast"),
    [("piston", Steps(PISTON)), ("strip", Steps(STRIP)), ("sweeps", Sweeps())],
    ids=["piston", "strip", "sweeps"],
)
def test_the_time_left_is_within_a_factor_of_two(name, forecast):
    share, ratio = shown(name, forecast).T
    at_a_fifth = ratio[np.searchsorted(share, 0.2, "right") - 1]
    assert 0.5 <= at_a_fifth <= 2
    later = ratio[(share > 0.2) & (share < 0.9)]
    assert np.isfinite(later).mean() >= 0.9
    assert ((later > 0.5) & (later < 2)).mean() >= 0.9 * np.isfinite(later).mean()
