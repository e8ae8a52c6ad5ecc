"""Unconfined compression in closed form against the equations that it solves."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.macro.analytic import ThickCylinder, UnconfinedCompression

PLUG = UnconfinedCompression(radius=2.0, strain=-0.05, lame=0.3, shear=0.4, conductivity=0.7, ramp=0.3)
R = np.linspace(0.1, 1.9, 19)


def slope(f, at, h):
    return (8 * (f(at + h) - f(at - h)) - (f(at + 2 * h) - f(at - 2 * h))) / (12 * h)


@pytest.mark.parametrize("t", [0.1, 0.29, 0.5, 2.0])
def test_what_leaves_is_what_the_volume_loses(t):
    """Darcy's flux through each radius: u̇ + ε̇ r/2 = K p′."""
    rate = slope(lambda s: PLUG.lateral(R, s), t, 1e-4 if t != 0.29 else 1e-3)
    straining = PLUG.strain / PLUG.ramp if t < PLUG.ramp else 0.0
    flux = PLUG.conductivity * slope(lambda r: PLUG.pressure(r, t), R, 1e-4)
    np.testing.assert_allclose(rate + straining * R / 2, flux, atol=2e-7)


@pytest.mark.parametrize("t", [0.1, 0.5, 2.0])
def test_radial_equilibrium_and_a_free_drained_mantle(t):
    def dilation(r):
        return slope(lambda x: PLUG.lateral(x, t), r, 1e-3) + PLUG.lateral(r, t) / r

    inner = PLUG.aggregate_modulus * slope(dilation, R, 1e-3)
    np.testing.assert_allclose(inner, slope(lambda r: PLUG.pressure(r, t), R, 1e-3), atol=2e-7)
    a, share = PLUG.radius, min(t / PLUG.ramp, 1.0)
    assert float(PLUG.pressure(a, t)) == pytest.approx(0, abs=1e-12)
    edge = slope(lambda x: PLUG.lateral(x, t), a, 1e-4)
    hoop = float(PLUG.lateral(a, t)) / a
    radial = PLUG.aggregate_modulus * edge + PLUG.lame * (hoop + share * PLUG.strain)
    assert radial == pytest.approx(0, abs=1e-7)


def test_the_plates_bear_stress_and_pressure():
    t = 0.4
    nodes, weights = np.polynomial.legendre.leggauss(80)
    r = PLUG.radius * (nodes + 1) / 2
    dilation = slope(lambda x: PLUG.lateral(x, t), r, 1e-4) + PLUG.lateral(r, t) / r
    axial = PLUG.aggregate_modulus * PLUG.strain + PLUG.lame * dilation - PLUG.pressure(r, t)
    mean = float((axial * r) @ weights) * PLUG.radius / PLUG.radius**2
    assert PLUG.stress(t) == pytest.approx(mean, rel=1e-6)


def test_first_it_keeps_its_volume_and_at_last_only_the_frame_bears():
    sudden = UnconfinedCompression(1.0, -0.01, 0.3, 0.4, 1.0)
    young = 0.4 * (3 * 0.3 + 2 * 0.4) / (0.3 + 0.4)
    assert sudden.stress(50.0) == pytest.approx(-0.01 * young, rel=1e-12)
    assert float(sudden.lateral(1.0, 50.0)) == pytest.approx(0.01 * sudden.poisson_ratio, rel=1e-12)
    # Incompressible: E = 3μ, ν = ½; the edge lags in a layer of √t.
    assert sudden.stress(1e-6) == pytest.approx(-0.01 * 3 * 0.4, rel=2e-2)
    assert float(sudden.lateral(0.5, 1e-6)) == pytest.approx(0.0025, rel=1e-3)


def test_creep_begins_without_loss_of_volume_and_ends_with_the_frame():
    young = 0.4 * (3 * 0.3 + 2 * 0.4) / (0.3 + 0.4)
    assert PLUG.creep(-0.01, 1e-9) == pytest.approx(-0.01 / (3 * 0.4), rel=1e-5)
    assert PLUG.creep(-0.01, 1e4) == pytest.approx(-0.01 / young, rel=1e-12)


def test_creep_is_the_inverse_of_relaxation():
    """Stress of a sudden unit strain and strain of a sudden unit stress convolve to t."""
    t = 0.6
    sudden = UnconfinedCompression(2.0, 1.0, 0.3, 0.4, 0.7)
    points, weights = np.polynomial.legendre.leggauss(20)
    angle = np.pi / 4 * (points + 1)
    product = np.array([sudden.stress(s) * sudden.creep(1.0, t - s) for s in t * np.sin(angle) ** 2])
    assert np.pi / 4 * float(weights @ (product * t * np.sin(2 * angle))) == pytest.approx(t, rel=1e-10)


def test_the_thick_cylinder_of_lame():
    """Hooke's law and equilibrium, by differences; pressures on the faces."""
    tube = ThickCylinder(1.0, 2.5, 0.3, 0.1, lame=0.6, shear=0.4)
    r = np.linspace(1.1, 2.4, 12)
    stretch, hoop = slope(tube.lateral, r, 1e-3), tube.lateral(r) / r
    np.testing.assert_allclose(tube.radial_stress(r), 1.4 * stretch + 0.6 * hoop, rtol=1e-9)
    np.testing.assert_allclose(tube.hoop_stress(r), 1.4 * hoop + 0.6 * stretch, rtol=1e-9)
    np.testing.assert_allclose(0.6 * (hoop + stretch), tube.axial_stress(), rtol=1e-9)
    difference = (tube.radial_stress(r) - tube.hoop_stress(r)) / r
    np.testing.assert_allclose(slope(tube.radial_stress, r, 1e-3), -difference, rtol=1e-9)
    np.testing.assert_allclose(tube.radial_stress([1.0, 2.5]), [-0.3, -0.1], rtol=1e-12)
