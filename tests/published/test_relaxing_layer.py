"""Layers whose solid relaxes, by inverted transforms: against series, elastic limits and the law in time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erfc

from porocore.macro.analytic import LayeredConsolidation, SoilLayer, Terzaghi, excess_force, inverse_laplace

HEIGHT, LOAD = 7.5, 0.01
CONSTANTS = {"stiffness": 0.444, "biot": 0.79, "storage": 0.34, "conductivity": 1.94}
ELASTIC = Terzaghi(height=HEIGHT, load=LOAD, **CONSTANTS)
#: Time in which the elastic layer drains.
SCALE = HEIGHT**2 / ELASTIC.consolidation_coefficient
T = [0.02, 0.1, 0.4, 1.5]
Y = np.array([0.0, 2.0, 5.0, 7.0])


def column(*branches, **settings):
    return LayeredConsolidation([SoilLayer(HEIGHT, **CONSTANTS, branches=branches)], LOAD, **settings)


def scaled(factor):
    """The elastic layer whose solid is stiffer by a factor."""
    stiffer = CONSTANTS | {
        "stiffness": factor * CONSTANTS["stiffness"],
        "storage": CONSTANTS["storage"] / factor,
    }
    return Terzaghi(height=HEIGHT, load=LOAD, **stiffer)


def one_branch(strength, time, t):
    """Pressures at Y and settlement by a series.

    Of cos(m y/h) the amplitude has the transform 1/(s + κ s ĝ(s)) with κ = m² c_v/h², whose poles are the roots of
    τ s² + (1 + κ τ (1 + γ)) s + κ; the strain is (α p − P)/C behind s ĝ, which vanishes at −1/(τ (1 + γ)).
    """
    m = np.pi / 2 * (2.0 * np.arange(4000) + 1)
    kappa = m**2 / SCALE
    half = (1 + kappa * time * (1 + strength)) / 2
    spread = np.sqrt(half**2 - time * kappa)
    late = strength / (1 + strength) * np.exp(-t / (time * (1 + strength)))
    amplitude, crept = np.zeros_like(m), np.full_like(m, -late)
    for root, sign in (((-half - spread) / time, -1), (-kappa / (half + spread), 1)):
        weight = sign * (1 + root * time) / (2 * spread) * np.exp(root * t)
        amplitude += weight
        crept -= kappa / root * weight
    p0, signs = ELASTIC.initial_pressure, (-1.0) ** np.arange(len(m))
    pressure = p0 * np.cos(np.multiply.outer(Y / HEIGHT, m)) @ (2 * signs / m * amplitude)
    strain = ((1 - late) * LOAD - ELASTIC.biot * p0 * float((2 / m**2) @ crept)) / ELASTIC.stiffness
    return pressure, HEIGHT * strain


@pytest.mark.parametrize("branches", [(), ((0.0, 3.0),)])
def test_a_solid_that_does_not_relax_is_terzaghis(branches):
    found = column(*branches)
    for t in SCALE * np.array(T):
        np.testing.assert_allclose(found.pressure(Y, t), ELASTIC.pressure(Y, t), rtol=0, atol=1e-8 * LOAD)
        assert found.settlement(t) == pytest.approx(float(ELASTIC.settlement(t)), rel=1e-8)


@pytest.mark.parametrize(("strength", "time"), [(1.0, 0.05), (0.4, 0.5), (3.0, 4.0)])
def test_one_branch_is_its_series(strength, time):
    found = column((strength, time * SCALE))
    for t in SCALE * np.array(T):
        pressure, settlement = one_branch(strength, time * SCALE, t)
        np.testing.assert_allclose(found.pressure(Y, t), pressure, rtol=0, atol=1e-8 * LOAD)
        assert found.settlement(t) == pytest.approx(settlement, rel=1e-8)


def test_fast_and_slow_branches_are_elastic():
    fast, slow, factor = (0.7, 1e-12 * SCALE), (0.5, 1e12 * SCALE), 1.5
    for t in SCALE * np.array(T):
        for branches, elastic in (
            ((fast,), scaled(1.0)),
            ((slow,), scaled(factor)),
            ((fast, slow), scaled(factor)),
        ):
            found = column(*branches)
            np.testing.assert_allclose(found.pressure(Y, t), elastic.pressure(Y, t), rtol=0, atol=1e-8 * LOAD)
            assert found.settlement(t) == pytest.approx(float(elastic.settlement(t)), rel=1e-8)


def test_two_branches_of_one_time_are_one():
    two, one = column((0.3, 2.0), (0.5, 2.0)), column((0.8, 2.0))
    for t in (0.3, 2.0, 9.0):
        np.testing.assert_allclose(two.pressure(Y, t), one.pressure(Y, t), rtol=1e-12)
        assert two.settlement(t) == pytest.approx(one.settlement(t), rel=1e-12)


def test_first_it_is_undrained_and_stiff_and_at_last_drained_and_soft():
    branches = ((0.6, 0.1 * SCALE), (0.9, 3 * SCALE))
    found = column(*branches)
    early, late = 1e-12 * SCALE, 1e5 * SCALE
    assert float(found.pressure(0.0, early)[0]) == pytest.approx(ELASTIC.initial_pressure, rel=1e-8)
    assert found.settlement(early) == pytest.approx(scaled(2.5).immediate_settlement, rel=2e-4)
    assert found.settlement(late) == pytest.approx(ELASTIC.final_settlement, rel=1e-8)
    held = 0.01 * HEIGHT
    assert found.held_load(held, late) == pytest.approx(0.01 * ELASTIC.stiffness, rel=1e-8)
    undrained = ELASTIC.stiffness + ELASTIC.biot**2 / ELASTIC.storage
    assert found.held_load(held, early) == pytest.approx(2.5 * undrained * 0.01, rel=2e-4)


def test_a_held_elastic_layer_relaxes_by_its_modes():
    """The force on a layer between plates is the series of the mixed condition σ = C ε̄ − α p̄."""
    C, alpha, S = (CONSTANTS[name] for name in ("stiffness", "biot", "storage"))
    share = (alpha**2 / C) / (S + alpha**2 / C)
    held, found = 0.01 * HEIGHT, column()
    for dimensionless in T:
        more = float(excess_force(share, np.array([dimensionless]))[0])
        expected = C * 0.01 * (1 + more)
        assert found.held_load(held, dimensionless * SCALE) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("t", [0.5, 4.0])
def test_a_held_layer_is_in_equilibrium(t):
    """The load is g C times the mean strain, which is constant, and α times the mean pressure."""
    branches = ((0.6, 0.5), (0.9, 5.0))
    found, held = column(*branches), 0.01 * HEIGHT
    g = 1 + sum(strength * np.exp(-t / time) for strength, time in branches)
    x, weights = np.polynomial.legendre.leggauss(60)
    pressure = found.held_pressure(held, HEIGHT * (x + 1) / 2, t)
    expected = g * 0.01 * ELASTIC.stiffness + ELASTIC.biot * float(weights @ pressure) / 2
    assert found.held_load(held, t) == pytest.approx(expected, rel=1e-8)


def test_a_ramp_is_the_mean_of_sudden_loads():
    branches = ((0.6, 0.5), (0.9, 5.0))
    sudden, ramped = column(*branches), column(*branches, ramp=2.0)
    x, weights = np.polynomial.legendre.leggauss(30)
    for read in (lambda c, t: c.settlement(t), lambda c, t: c.held_load(0.1, t)):
        mean = float(weights @ [read(sudden, 3.0 - 2.0 * (s + 1) / 2) for s in x]) / 2
        assert read(ramped, 3.0) == pytest.approx(mean, rel=1e-7)


@pytest.mark.parametrize(
    ("transform", "known"),
    [
        (lambda s: 1 / s**2, lambda t: t),
        (lambda s: 1 / (s + 3), lambda t: np.exp(-3 * t)),
        (lambda s: np.exp(-np.sqrt(s)) / s, lambda t: erfc(0.5 / np.sqrt(t))),
        (lambda s: 1 / np.sqrt(s), lambda t: 1 / np.sqrt(np.pi * t)),
    ],
)
def test_known_transforms_are_inverted(transform, known):
    for t in (0.05, 1.0, 20.0):
        found = float(inverse_laplace(lambda s: np.array([transform(s)]), t)[0])
        assert found == pytest.approx(float(known(t)), rel=1e-10, abs=1e-12)
