"""Intervals of numbers that follow from the unknowns, against the region of all values that the data allow."""

import numpy as np
import pytest

from porocore.commands.calibration.derived import derived_intervals
from porocore.commands.calibration.infer import infer
from porocore.commands.calibration.problem import NormalPrior, Unknown
from tests.helpers.calibration_models import Consolidation, Formula, misfit_of

T = np.geomspace(0.02, 6, 24)
NOISE = np.random.default_rng(3).normal(size=24)


def logarithmic(*names, lower=0.01, upper=100.0, **more):
    return tuple(Unknown(name, 1.0, lower, upper, "log", **more) for name in names)


def inferred(model, truth, deviation=0.001):
    misfit = misfit_of(model, truth, deviation, NOISE, times=T)
    return misfit, infer(misfit, misfit.at(misfit.start), rays=0)


def derived(inference, **numbers):
    """Value and both ends of each number."""
    found = derived_intervals(
        inference,
        lambda values: {name: float(of(values)) for name, of in numbers.items()},
        lambda name: name.startswith("plain"),
    )
    return {name: (value, interval.low, interval.high) for name, (value, interval) in found.items()}


def test_intervals_are_the_shadow_of_all_values_that_the_data_allow():
    """Of a grid over modulus and conductivity, those whose sum of squares has risen by no more than 3.84."""
    misfit, found = inferred(Consolidation(logarithmic("modulus", "conductivity"), T), [1.2, 0.8], 2e-4)
    numbers = {
        "c_v": lambda v: v[0] * v[1],
        "stiffness": lambda v: 3 * v[0],
        "ratio": lambda v: v[0] / v[1] ** 2,
        "plain": lambda v: v[0] - v[1],
    }
    at = derived(found, **numbers)
    best, widths = found.best, 3 * found.with_priors.deviations
    axes = [x + w * np.linspace(-1, 1, 61) for x, w in zip(best.coordinates, widths, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    inside = np.array([x for x in points if 2 * (misfit.at(x).cost - best.cost) <= 3.841])
    for name, of in numbers.items():
        allowed = [of(np.exp(x)) for x in inside]
        value, low, high = at[name]
        assert value == pytest.approx(of(found.values))
        width = high.value - low.value
        assert low.value == pytest.approx(min(allowed), abs=0.06 * width), name
        assert high.value == pytest.approx(max(allowed), abs=0.06 * width), name


def test_what_is_seen_of_unseen_unknowns_has_an_interval():
    """Edge of the pores and viscosity are not seen, the permeability is: pore²/viscosity alone enters."""
    unknowns = logarithmic("modulus", "pore", "viscosity")
    _, found = inferred(
        Formula(unknowns, lambda v: (1 - np.exp(-(v[1] ** 2) / v[2] * T)) / v[0]), [2.0, 1.0, 1.3]
    )
    at = derived(found, K=lambda v: v[1] ** 2 / v[2], k=lambda v: v[1] ** 2, H_A=lambda v: 3 * v[0])
    assert found.intervals[1].values == found.intervals[2].values == (None, None)
    for name, truth in (("K", 1 / 1.3), ("H_A", 6.0)):
        _, low, high = at[name]
        assert low.value < truth < high.value, name
        assert high.value < 1.05 * low.value
    _, low, high = at["k"]
    assert (low.value, high.value) == (None, None)
    assert low.reason == "the data do not determine it"


def test_no_end_is_made_of_a_bound():
    """The rate is so large that the curve is flat: its profile has no upper end, and nor has what moves with it."""
    unknowns = (*logarithmic("modulus"), *logarithmic("rate", upper=1e4))
    _, found = inferred(Formula(unknowns, lambda v: (1 - np.exp(-v[1] * T / 0.024)) / v[0]), [2.0, 6.0])
    assert found.intervals[1].values[1] is None
    at = derived(found, c_v=lambda v: v[0] * v[1], H_A=lambda v: 3 * v[0])
    _, low, high = at["c_v"]
    assert high.value is None
    assert "rate" in high.reason
    assert low.value is None or low.value < 12
    assert None not in (at["H_A"][1].value, at["H_A"][2].value)


def test_a_bound_of_the_search_on_the_way_is_no_end():
    _, found = inferred(Formula(logarithmic("modulus", upper=1.301), lambda v: 1 / v[0] + 0 * T), [1.3], 0.01)
    _, low, high = derived(found, H_A=lambda v: 3 * v[0])["H_A"]
    assert (high.value, high.reason) == (None, "modulus meets a bound of the search")
    assert 3.8 < low.value < 3.9


def test_priors_count():
    prior = NormalPrior(np.log(2.0), 0.01)
    model = Formula(logarithmic("modulus", prior=prior), lambda v: 1 / v[0] + 0 * T)
    _, found = inferred(model, [2.0], 1.0)
    value, low, high = derived(found, H_A=lambda v: 3 * v[0])["H_A"]
    assert np.log(high.value / low.value) == pytest.approx(2 * 1.96 * 0.01, rel=0.01)
    assert low.value < value < high.value
