"""Forecast of the steps that a macro solve still takes."""

import numpy as np
import pytest

from porocore.macro.integration.newton import StepForecast
from porocore.macro.integration.stepping import Stepper
from porocore.macro.problem import MacroProblem

CLAMPED = {"displacement": (0, 0, 0)}


def problem(time, **top):
    return MacroProblem(boundary={"y-": CLAMPED, "y+": {"pressure": 0, **top}}, time=time)


def stepped(of, error):
    """Return the ends of the steps of a made-up body; ``error`` says that of a step [t, t + h] after the last kink."""
    stepper, times = Stepper(of.time, of.corners), []
    while not stepper.done:
        kink = max(kink for kink in stepper.kinks if kink <= stepper.time + 1e-9)
        found = error(stepper.time - kink, stepper.next() - stepper.time, kink)
        if stepper.tolerates(found):
            stepper.accept(found)
            times.append(stepper.time)
    return times


def forecasts(of, times):
    """Return the numbers of steps that were foreseen over those that came, at each step but the last few."""
    forecast, ratios = StepForecast(of), []
    for k, time in enumerate(times, 1):
        forecast.add(time)
        done, left = forecast.work
        assert done == k
        ratios.append(left / max(len(times) - k, 1))
    return np.array(ratios)


def within_two(ratios):
    """Return the share of forecasts that are right within a factor of two."""
    return float(((ratios > 0.5) & (ratios < 2)).mean())


def test_equal_steps_are_counted():
    of = problem(
        {"end": 150, "step": 0.75, "ramp_increments": 10, "ramp_step": 0.075, "profiles": (1, 10, 40)}
    )
    times = stepped(of, lambda since, h, kink: 0.0)
    assert len(times) > 200
    assert forecasts(of, times)[:-1] == pytest.approx(1.0)


def test_as_many_steps_as_are_left_are_foreseen_where_there_are_very_many():
    of = problem({"end": 10000, "step": 0.5, "ramp_increments": 10, "ramp_step": 0.05, "profiles": ()})
    assert StepForecast(of).remaining() == pytest.approx(20009, rel=1e-3)


def drained(tau):
    """Return the error of steps of a body that drains, first like a half space and later with the time constant."""
    return lambda since, h, kink: (
        h**2 * (since + h) ** -1.5 * np.exp(-(since + h) / tau) if kink else h**2 * (since + h) ** -0.5
    )


@pytest.mark.parametrize("tau", [5.0, 50.0])
def test_steps_that_grow_are_foreseen_within_a_factor_of_two(tau):
    of = problem(
        {"end": 40, "step": 10, "ramp_increments": 4, "ramp_step": 0.05, "tolerance": 1e-2, "profiles": (8,)}
    )
    times = stepped(of, drained(tau))
    assert 20 < len(times) < 500
    ratios = forecasts(of, times)[len(times) // 5 : 4 * len(times) // 5]
    assert within_two(ratios) >= 0.9
    # The simulated time that is left says something else.
    k = len(times) // 5
    assert (40 - times[k]) / times[k] * (k + 1) > 10 * (len(times) - k)


def test_bends_to_come_are_foreseen_after_those_that_were():
    curve = [
        (t + shift, share)
        for t in range(0, 40, 10)
        for shift, share in ((0.2, 1), (5, 1), (5.2, 0), (9.9, 0))
    ]
    of = problem(
        {"end": 40, "step": 10, "ramp_increments": 4, "ramp_step": 0.05, "tolerance": 1e-2, "profiles": (),
         "load_curve": curve},
        traction=(0, -1, 0),
    )  # fmt: skip
    times = stepped(of, lambda since, h, kink: h**2 * (since + h) ** -1.5 * np.exp(-since / 2))
    ratios = forecasts(of, times)[len(times) // 2 : 9 * len(times) // 10]
    assert within_two(ratios) >= 0.9


def test_steps_under_a_load_that_never_rests_are_not_thought_to_grow():
    of = problem(
        {"end": 20, "step": 5, "ramp_increments": 4, "ramp_step": 0.02, "tolerance": 1e-2, "profiles": ()},
        displacement=(None, {"expression": "0.1*sin(6*t)"}, None),
    )
    times = stepped(of, lambda since, h, kink: h**2 * (1 + 0.5 * np.sin(6 * since)))
    ratios = forecasts(of, times)[len(times) // 10 : 4 * len(times) // 5]
    assert within_two(ratios) >= 0.9


def test_a_resumed_solve_counts_from_where_it_stands():
    of = problem(
        {"end": 40, "step": 10, "ramp_increments": 4, "ramp_step": 0.05, "tolerance": 1e-2, "profiles": ()}
    )
    times = stepped(of, drained(5.0))
    half = len(times) // 2
    forecast = StepForecast(of)
    for time in times[half:]:
        forecast.add(time)
        if time == times[half + 5]:
            done, left = forecast.work
            assert done == 5
            assert 0.5 < left / (len(times) - half - 6) < 2


def test_an_end_far_behind_the_drainage_is_not_thought_to_take_thousands_of_steps():
    of = problem(
        {"end": 4000, "step": 400, "ramp_increments": 5, "ramp_step": 0.02, "tolerance": 1e-2, "profiles": ()}
    )
    times = stepped(of, drained(20.0))
    ratios = forecasts(of, times)[len(times) // 5 : 4 * len(times) // 5]
    assert 0.5 < ratios[0] < 2
    assert ratios.max() < 3
