"""Seconds that a sampling is foreseen to take still."""

import pytest

from porocore.core.inputs import InputSpace
from porocore.interfaces.sampler import Outlook
from porocore.sampling.forecast import Guess, StateForecast

BOX = InputSpace(("p", "H22"), (-0.1, -0.3), (0.1, 0.3))
X = (0.05, 0.2)


def told(forecast, count, *, fewest, most, asked, decision=None):
    """Tell ``count`` states of 2 s each that two workers solve, after 30 s in which they started."""
    for k in range(count):
        first = 5.0 if k < 2 else 2.0
        forecast.add(X, most, outward=False, seconds=first, now=30 + first + (k // 2) * 2)
    if decision is not None:
        forecast.decided(decision)
    forecast.look(Outlook(most, fewest, asked, 6, 1.0))
    return forecast.seconds()


@pytest.mark.parametrize("count", [1, 2, 4, 12])
def test_the_start_of_the_workers_is_no_part_of_the_cost_of_a_state(count):
    forecast = StateForecast(BOX, Guess(workers=2, start=10, state=1.5))
    for k in range(count):
        first = 5.0 if k < 2 else 2.0
        forecast.add(X, 60, outward=False, seconds=first, now=30 + first + (k // 2) * 2)
    forecast.look(Outlook(60, 60))
    left = 60 - count
    assert 0.5 < forecast.seconds() / left < 2


def test_a_sampler_that_may_end_early_is_taken_to_end_between():
    early, late = (
        told(StateForecast(BOX, Guess(workers=2, state=2)), 14, fewest=n, most=n, asked=14) for n in (26, 60)
    )
    between = told(StateForecast(BOX, Guess(workers=2, state=2)), 14, fewest=26, most=60, asked=14)
    assert early < between < late
    assert between**2 == pytest.approx(early * late, rel=0.3)


def test_decisions_take_as_long_as_the_last_one():
    quick, slow = (
        told(StateForecast(BOX, Guess(workers=2, state=2)), 14, fewest=26, most=26, asked=14, decision=s)
        for s in (0.0, 20.0)
    )
    # Two further rounds, and the decision to end.
    assert slow - quick == pytest.approx(3 * 20)


def test_before_the_first_state_the_guess_is_told_and_without_one_nothing():
    forecast, unknown = StateForecast(BOX, Guess(workers=2, start=10, state=2)), StateForecast(BOX)
    for each in (forecast, unknown):
        each.look(Outlook(40, 40))
    assert 40 <= forecast.seconds() <= 60
    assert unknown.seconds() is None
    for _ in range(40):
        forecast.add(X, 40, outward=False, seconds=1.0, now=30.0)
    forecast.look(Outlook(40, 40))
    assert forecast.seconds() == 0
