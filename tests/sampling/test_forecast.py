"""Forecast of the states that a campaign still has to solve."""

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.sampling.forecast import StateForecast

BOX = InputSpace(("p", "H22"), (-0.1, -0.3), (0.1, 0.3))


def test_states_of_a_design_cost_alike():
    forecast = StateForecast(BOX)
    for x in np.random.default_rng(1).uniform((-0.1, -0.3), (0.1, 0.3), (20, 2)):
        forecast.add(tuple(x), 80, outward=False)
    done, left = forecast.work
    assert left / done == pytest.approx(3.0)


def test_states_of_sweeps_that_are_still_to_come_cost_more():
    forecast, alike = StateForecast(BOX), StateForecast(BOX)
    for value in np.linspace(0, 0.1, 20):
        forecast.add((0.0, value), 40, outward=True)
        alike.add((0.0, value), 40, outward=False)
    assert alike.work[1] == pytest.approx(alike.work[0])
    assert forecast.work[1] > 2 * forecast.work[0]


def test_a_sampler_that_adds_states_is_taken_to_go_on_with_it():
    forecast = StateForecast(BOX)
    expected = [40] * 10 + list(range(41, 51))
    for known in expected:
        forecast.add((0.05, 0.1), known, outward=False)
    done, left = forecast.work
    # 30 are foreseen, and each that is solved adds about one more.
    assert left / done * 20 == pytest.approx(30 / (1 - 0.75))


def test_nothing_is_left_where_all_states_are_known():
    forecast = StateForecast(BOX)
    for _ in range(5):
        forecast.add((0.1, 0.3), 5, outward=True)
    assert forecast.work[1] == 0


def test_pressure_alone_costs_next_to_nothing():
    pressed, stretched = StateForecast(BOX), StateForecast(BOX)
    for value in np.linspace(0, 1, 10):
        pressed.add((0.1 * value, 0.0), 20, outward=True)
        stretched.add((0.0, 0.3 * value), 20, outward=True)
    assert pressed.work[0] == pytest.approx(10)
    assert pressed.work[1] > 1.5 * stretched.work[1]
