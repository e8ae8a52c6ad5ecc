"""Mandel's solution against the equations that it solves."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.macro.analytic import Mandel

BLOCK = Mandel(
    half_width=100.0, force=0.6, lame=1.65, shear=2.475, biot=0.8, storage=0.06, conductivity=0.0987
)
X = np.linspace(1, 99, 40)


def time_of(T):
    return T * BLOCK.half_width**2 / BLOCK.consolidation_coefficient


def slope(f, at, h):
    return (8 * (f(at + h) - f(at - h)) - (f(at + 2 * h) - f(at - 2 * h))) / (12 * h)


@pytest.mark.parametrize("T", [2e-3, 0.05, 0.4])
def test_the_sides_are_free_and_the_plates_bear_the_force(T):
    """σ_xx = 0 everywhere, and the integral of σ_yy over a quarter is −F."""
    t = time_of(T)
    strain_x, strain_y = slope(lambda x: BLOCK.lateral(x, t), X, 1e-2), BLOCK.strain(t)
    p = BLOCK.pressure(X, t)
    sigma_x = (BLOCK.lame + 2 * BLOCK.shear) * strain_x + BLOCK.lame * strain_y - BLOCK.biot * p
    np.testing.assert_allclose(sigma_x, 0, atol=1e-8 * BLOCK.force / BLOCK.half_width)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    x = BLOCK.half_width * (nodes + 1) / 2
    mean_p = BLOCK.pressure(x, t) @ weights / 2
    widened = BLOCK.lateral(BLOCK.half_width, t) / BLOCK.half_width
    sigma_y = BLOCK.lame * widened + (BLOCK.lame + 2 * BLOCK.shear) * strain_y - BLOCK.biot * mean_p
    assert sigma_y * BLOCK.half_width == pytest.approx(-BLOCK.force, rel=1e-8)


@pytest.mark.parametrize("T", [0.02, 0.4])
def test_fluid_is_conserved(T):
    """∂/∂t (α ε + S p) = k ∂²p/∂x², and no pressure on the drained side."""
    t, dx, dt = time_of(T), 0.05, 1e-3 * time_of(T)

    def content(t):
        strain = slope(lambda x: BLOCK.lateral(x, t), X, 1e-2) + BLOCK.strain(t)
        return BLOCK.biot * strain + BLOCK.storage * BLOCK.pressure(X, t)

    rate = slope(content, t, dt)
    bend = slope(lambda x: slope(lambda y: BLOCK.pressure(y, t), x, dx), X, dx)
    np.testing.assert_allclose(BLOCK.conductivity * bend, rate, atol=1e-5 * abs(rate).max())
    assert abs(BLOCK.pressure(BLOCK.half_width, t)) < 1e-12 * BLOCK.pressure(0.0, t)


def test_first_the_block_is_undrained_and_at_last_drained():
    nu, nu_u = BLOCK.poisson_ratio, BLOCK.undrained_poisson_ratio
    first = BLOCK.force * BLOCK.skempton * (1 + nu_u) / (3 * BLOCK.half_width)
    assert BLOCK.pressure(30.0, time_of(1e-4)) == pytest.approx(first, rel=0.03)
    early, late = BLOCK.strain(time_of(1e-6)), BLOCK.strain(time_of(20))
    scale = BLOCK.force / (2 * BLOCK.shear * BLOCK.half_width)
    assert early == pytest.approx(-(1 - nu_u) * scale, rel=1e-2)
    assert late == pytest.approx(-(1 - nu) * scale, rel=1e-12)


def test_mandels_effect():
    """The pressure in the middle rises above its first value before it falls."""
    first = BLOCK.force * BLOCK.skempton * (1 + BLOCK.undrained_poisson_ratio) / (3 * BLOCK.half_width)
    history = [float(BLOCK.pressure(0.0, time_of(T))) for T in (0.001, 0.03, 0.1, 0.5)]
    assert history[1] > 1.01 * first
    assert history[1] > history[0]
    assert history[3] < 0.9 * first
