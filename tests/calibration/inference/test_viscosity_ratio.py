"""The benchmarks' interval of viscosity over conductivity, on a model whose logarithms are linear."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from porocore.commands.calibration.problem import Unknown
from tests.helpers.calibration_models import Formula, misfit_of

BENCHMARKS = Path(__file__).parents[3] / "benchmarks"
COUNT, DEVIATION = 25, 0.05
UNKNOWNS = (
    Unknown("radius", 0.25, 0.05, 0.45, "log"),
    Unknown("viscosity", 1.0, 1e-3, 1e3, "log"),
)


def seen(values):
    """Return 25 times ln(μ/K) with K = 3 r⁴, and once ln r."""
    radius, viscosity = values
    return np.append(np.full(COUNT, np.log(viscosity / (3 * radius**4))), np.log(radius))


def test_the_interval_of_the_ratio_is_that_of_its_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from viscosity_ratio import PowerSeries, ratio_interval

    series = PowerSeries.of(lambda r: 3 * r**4, 0.05, 0.45)
    assert series.value(0.2) == pytest.approx(3 * 0.2**4, rel=1e-12)
    assert series.relative_slope(0.2) == pytest.approx(4 / 0.2, rel=1e-10)
    noise = np.random.default_rng(3).normal(size=COUNT + 1)
    misfit = misfit_of(Formula(UNKNOWNS, seen), [0.22, 2.0], DEVIATION, noise)
    mean = misfit.data.values[:COUNT].mean()
    radius = np.exp(misfit.data.values[-1])
    best = misfit.at(np.array([np.log(radius), mean + np.log(3 * radius**4)]))
    value, (low, high), identifiable = ratio_interval(misfit, best, series)
    half = 1.959963984540054 * DEVIATION / np.sqrt(COUNT)
    assert value == pytest.approx(np.exp(mean), rel=1e-8)
    assert low == pytest.approx(np.exp(mean - half), rel=1e-6)
    assert high == pytest.approx(np.exp(mean + half), rel=1e-6)
    assert identifiable
