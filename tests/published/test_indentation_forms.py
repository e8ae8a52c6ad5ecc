"""Indentation in closed and half-closed form against the equations that it solves, limits and published curves."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm, schur
from scipy.special import j0, spherical_jn

from porocore.macro import indentation
from porocore.macro.indentation import (
    Cone,
    ElasticIndentation,
    Paraboloid,
    PoroelasticIndentation,
    Punch,
    Sphere,
    relaxation_fit,
)

NU, SHEAR = 0.3, 2.0
PUNCH = Punch(2.0)
MODULUS = 2 * SHEAR / (1 - NU)
INDENTERS = [Sphere(1.0), Paraboloid(1.0), Cone(70.0), Cone(70.0, 0.05), Punch(0.1), Punch(0.1, 0.02)]
DRAINAGE = [("sealed", "drained"), ("drained", "drained"), ("sealed", "sealed"), ("drained", "sealed")]


def elastic(indenter):
    return ElasticIndentation(indenter, SHEAR, NU)


def poroelastic(indenter=PUNCH, **others):
    return PoroelasticIndentation(
        **{"depth": 0.5, "shear": SHEAR, "poisson": NU, "conductivity": 0.7} | others, indenter=indenter
    )


def whole(function, radius, corners=()):
    """Integrate over the disc; r = radius sin φ takes the root at the edge away, parts crowd at their ends."""
    ends = np.concatenate([[0.0], np.arcsin(np.array(corners) / radius), [np.pi / 2]])
    halves = 2.0 ** -np.arange(1, 16)
    shares = np.concatenate([[0.0], halves[::-1], 1 - halves[1:], [1.0]])
    points, weights = np.polynomial.legendre.leggauss(12)
    total = 0.0
    for low, high in pairwise(ends):
        parts = low + (high - low) * shares
        lengths = np.diff(parts)[:, None]
        angles = (parts[:-1, None] + lengths * (points + 1) / 2).ravel()
        r = radius * np.sin(angles)
        values = function(r) * 2 * np.pi * r * radius * np.cos(angles)
        total += float(values @ (lengths * weights / 2).ravel())
    return total


def test_hertz():
    body, depth = elastic(Paraboloid(3.0)), 0.2
    a = np.sqrt(3.0 * depth)
    assert body.contact_radius(depth) == pytest.approx(a, rel=1e-12)
    assert body.force(depth) == pytest.approx(4 / 3 * MODULUS * np.sqrt(3.0) * depth**1.5, rel=1e-12)
    r = np.linspace(0, 1.2 * a, 14)
    largest = 2 * MODULUS * a / (np.pi * 3.0)
    np.testing.assert_allclose(
        body.pressure(r, depth), largest * np.sqrt(np.clip(1 - (r / a) ** 2, 0, None)), atol=1e-12
    )


def test_the_sphere_of_sneddon():
    body, R, depth = elastic(Sphere(3.0)), 3.0, 1.0
    a = body.contact_radius(depth)
    assert a / 2 * np.log((R + a) / (R - a)) == pytest.approx(depth, rel=1e-12)
    force = MODULUS * ((a**2 + R**2) / 2 * np.log((R + a) / (R - a)) - a * R)
    assert body.force(depth) == pytest.approx(force, rel=1e-12)


def test_the_cone_and_the_punch_of_sneddon():
    depth, slope = 0.2, np.tan(np.deg2rad(70))
    cone, a = elastic(Cone(70.0)), 2 / np.pi * depth * np.tan(np.deg2rad(70))
    assert cone.contact_radius(depth) == pytest.approx(a, rel=1e-12)
    assert cone.force(depth) == pytest.approx(2 / np.pi * MODULUS * slope * depth**2, rel=1e-12)
    r = np.linspace(0.02, 0.98, 9) * a
    np.testing.assert_allclose(cone.pressure(r, depth), MODULUS / 2 / slope * np.arccosh(a / r), rtol=3e-3)
    punch = elastic(Punch(1.5))
    assert punch.force(depth) == pytest.approx(2 * MODULUS * 1.5 * depth, rel=1e-12)
    r = np.linspace(0, 1.4, 8)
    np.testing.assert_allclose(
        punch.pressure(r, depth), MODULUS * depth / np.pi / np.sqrt(1.5**2 - r**2), rtol=1e-12
    )


def test_the_rounded_punch_of_ciavarella():
    """δ R/a = √(a² − b²) − b arccos(b/a) for an arc that is a parabola near the flat part."""
    punch, b, R = Punch(1.0, 0.2), 0.8, 0.2
    body = elastic(punch)
    for depth, near in ((1e-4, 2e-3), (1e-6, 1e-4)):
        a = body.contact_radius(depth)
        assert a / R * (np.sqrt(a**2 - b**2) - b * np.arccos(b / a)) == pytest.approx(depth, rel=near)
    assert body.force(1e-6) == pytest.approx(2 * MODULUS * b * 1e-6, rel=2e-2)


def test_a_rounded_cone_ends_as_a_sphere_and_as_a_cone():
    sphere, cone, rounded = elastic(Sphere(0.05)), elastic(Cone(70.0)), elastic(Cone(70.0, 0.05))
    assert rounded.force(1e-3) == pytest.approx(sphere.force(1e-3), rel=1e-12)
    # A deep cone is as if its tip were not cut off.
    cut = 0.05 * (1 / np.sin(np.deg2rad(70)) - 1)
    assert rounded.force(1.0) == pytest.approx(cone.force(1.0 + cut), rel=1e-5)


@pytest.mark.parametrize("indenter", INDENTERS)
def test_the_pressure_makes_up_the_force(indenter):
    body, depth = elastic(indenter), 0.01
    a = body.contact_radius(depth)
    corners = [c for c in indenter.corners if c < a]
    assert whole(lambda r: body.pressure(r, depth), a, corners) == pytest.approx(body.force(depth), rel=3e-7)


@pytest.mark.parametrize("indenter", INDENTERS)
def test_the_force_is_the_slope_of_the_energy(indenter):
    """dF/dδ = 2 E* a, whatever the profile is (Pharr, Oliver & Brotzen 1992)."""
    body, depth, h = elastic(indenter), 0.01, 1e-5
    slope = (body.force(depth + h) - body.force(depth - h)) / (2 * h)
    assert slope == pytest.approx(2 * MODULUS * body.contact_radius(depth), rel=1e-6)


def test_an_indenter_that_is_all_in_contact_is_refused():
    with pytest.raises(ValueError, match="all of the indenter"):
        elastic(Punch(1.0, 0.2)).contact_radius(100.0)


# --- elastic layer ---------------------------------------------------------------------------------------------------


def layer(indenter, thickness, base="bonded", poisson=NU):
    return ElasticIndentation(indenter, SHEAR, poisson, thickness, base)


@pytest.mark.parametrize("base", ["bonded", "smooth"])
@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.49])
@pytest.mark.parametrize("x", [0.2, 1.0, 4.0])
def test_the_compliance_of_a_layer_obeys_navier(x, poisson, base):
    """(U, W, σ_rz, σ_zz) through a layer of thickness 1, whose top has the pressure 1 alone."""
    G, H = SHEAR, 2 * SHEAR * (1 - poisson) / (1 - 2 * poisson)
    lame = H - 2 * G
    strain = np.array([-lame * x, 0, 0, 1]) / H
    shear = lame * x * strain + [H * x**2, 0, 0, 0]
    through = expm(np.array([[0, x, 1 / G, 0], strain, shear, [0, 0, -x, 0]]))
    held = [0, 1] if base == "bonded" else [1, 2]
    top = np.linalg.solve(through[held, :2], through[held, 3])
    expected = x * SHEAR / (1 - poisson) * top[1]
    assert float(layer(PUNCH, 1.0, base, poisson).compliance(x)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("indenter", INDENTERS[:5])
@pytest.mark.parametrize("base", ["bonded", "smooth"])
def test_the_pressure_on_a_layer_makes_up_the_force(indenter, base):
    body, depth = layer(indenter, 0.06, base), 0.01
    a = body.contact_radius(depth)
    corners = [c for c in indenter.corners if c < a]
    assert whole(lambda r: body.pressure(r, depth), a, corners) == pytest.approx(body.force(depth), rel=3e-7)
    if indenter.fixed_radius is None:
        assert float(body.pressure(a * (1 - 1e-10), depth)) < 1e-3 * float(body.pressure(0.5 * a, depth))


def test_a_thick_layer_is_a_half_space_and_a_thin_one_is_confined():
    thick = layer(Sphere(1.0), 1e3)
    assert thick.force(0.1) == pytest.approx(elastic(Sphere(1.0)).force(0.1), rel=1e-3)
    modulus, radius = 2 * SHEAR * (1 - NU) / (1 - 2 * NU), 40.0
    thin = layer(Punch(radius), 1.0)
    # A rim bears as well, of one and the same width.
    more = [layer(Punch(a), 1.0).force(0.1) / (np.pi * a**2 * modulus * 0.1) - 1 for a in (20.0, radius)]
    assert 0 < more[1] < 1e-2
    assert more[0] == pytest.approx(2 * more[1], rel=1e-2)
    assert thin.pressure([0.0], 0.1) == pytest.approx(modulus * 0.1, rel=1e-4)


def test_a_sphere_on_an_incompressible_layer_follows_the_series():
    """1 + c χ + (7/6) c² χ² + …, c = (2/π) ∫ (1 − L) dx, χ = √(R δ)/h.

    Garcia & Garcia (2018, Biophys. J. 114:2923–2932) have four terms, of a c that was fitted over ν.
    """
    R, half_space = 100.0, ElasticIndentation(Paraboloid(100.0), SHEAR, 0.5)

    def ratio(chi):
        depth = chi**2 / R
        return layer(Paraboloid(R), 1.0, poisson=0.5).force(depth) / half_space.force(depth)

    x, weights = np.polynomial.legendre.leggauss(80)
    c = 24 / np.pi * float(weights @ (1 - layer(PUNCH, 1.0, poisson=0.5).compliance(12 * (x + 1))))
    assert c == pytest.approx(1.133, rel=1e-2)
    for chi in (0.005, 0.01, 0.02):
        assert ratio(chi) == pytest.approx(1 + c * chi + 7 / 6 * c**2 * chi**2, abs=2 * chi**3)
    for chi in (0.1, 0.2, 0.3):
        series = 1 + 1.133 * chi + 1.497 * chi**2 + 1.469 * chi**3 + 0.755 * chi**4
        assert ratio(chi) == pytest.approx(series, rel=5e-3)


# --- poroelastic half space ------------------------------------------------------------------------------------------


def decaying(body, xi, rate):
    """States (U, W, p, σ_rz, σ_zz, p′) of the surface that die out with depth, by Biot's equations in z."""
    G, H, alpha = body.shear, body.aggregate_modulus, body.biot
    lame, K = H - 2 * G, body.conductivity
    strain = np.array([-lame * xi, 0, alpha, 0, 1, 0]) / H  # W′
    matrix = np.array(
        [
            [0, xi, 0, 1 / G, 0, 0],
            strain,
            [0, 0, 0, 0, 0, 1],
            lame * xi * strain + [H * xi**2, 0, -alpha * xi, 0, 0, 0],
            [0, 0, 0, -xi, 0, 0],
            rate / K * alpha * strain + [rate / K * alpha * xi, 0, xi**2 + rate / K * body.storage, 0, 0, 0],
        ]
    )
    _, vectors, count = schur(matrix, sort="lhp")
    assert count == 3
    return vectors[:, :3]


@pytest.mark.parametrize("constituents", [{}, {"biot": 0.7, "storage": 0.2}])
@pytest.mark.parametrize(("xi", "rate"), [(0.3, 2.0), (2.0, 0.1), (5.0, 40.0)])
def test_the_transformed_surface_obeys_biot(xi, rate, constituents):
    body = poroelastic(**constituents)
    kappa, m, beta = body._constants
    gamma = np.sqrt(xi**2 + rate / body.diffusivity)
    coupling = kappa * xi / (gamma + xi)
    states = decaying(body, xi, rate)
    for N, p in ((1.0, 0.0), (0.0, 1.0)):
        state = states @ np.linalg.solve(states[[3, 4, 2]], [0.0, -N, p])
        P = (N - coupling * p) / (beta - coupling)
        assert state[1] == pytest.approx(m * P / (2 * xi), rel=1e-7, abs=1e-7)
        assert -state[5] == pytest.approx(xi * P + gamma * (p - P), rel=1e-7, abs=1e-7)


@pytest.mark.parametrize(("under", "outside"), DRAINAGE)
@pytest.mark.parametrize("indenter", [PUNCH, Paraboloid(3.0), Cone(60.0)])
def test_first_it_is_undrained_and_at_last_drained(indenter, under, outside):
    body = poroelastic(indenter, under=under, outside=outside)
    assert body.instantaneous_force / body.relaxed_force == pytest.approx(2 * (1 - NU), rel=1e-12)
    unit = body.contact_radius**2 / body.diffusivity
    forces = [body.relaxation(tau * unit) for tau in (1e-4, 1e-2, 0.1, 1.0, 10.0, 1e6)]
    assert np.all(np.diff(forces) < 0)
    # √τ of a drained surface at first, 1/√τ at last
    assert 1 - 8e-2 < forces[0] < 1
    assert 0 < forces[-1] < 5e-4


def test_compressible_constituents():
    body = poroelastic(biot=0.7, storage=0.2)
    lame = body.aggregate_modulus - 2 * SHEAR + 0.7**2 / 0.2
    assert body.undrained_poisson == pytest.approx(lame / (2 * (lame + SHEAR)), rel=1e-12)
    assert body.relaxation(1e-4 * 4 / body.diffusivity) == pytest.approx(1, abs=2e-2)
    assert body.relaxation(1e6 * 4 / body.diffusivity) == pytest.approx(0, abs=5e-4)


@pytest.mark.parametrize(("outside", "flow"), [("drained", False), ("sealed", True)])
@pytest.mark.parametrize("indenter", [PUNCH, Paraboloid(3.0), Cone(60.0)])
def test_at_last_the_half_space_rises_below_the_force(indenter, outside, flow):
    """The pressure far away lowers the surface by one and the same length, which only the force decides.

    From ∫ (m/2) (1/(β − κ′) − 1/(β − κ/2)) dξ F/(2 π s), with κ′ of a surface that is drained or sealed everywhere.
    """
    body = poroelastic(indenter, outside=outside, under="sealed")
    kappa, m, beta = body._constants

    def excess(u):
        root = np.sqrt(u**2 + 1)
        coupling = kappa * u / (root + u) * (u / root if flow else 1.0)
        return m / 2 * (1 / (beta - kappa / 2) - 1 / (beta - coupling))

    u, weights = np.polynomial.legendre.leggauss(200)
    u = (u + 1) / 2
    deep = (excess(u) + excess(1 / u) / u**2) @ weights / 2
    t = 1e4 * body.contact_radius**2 / body.diffusivity
    less = body.relaxed_force / (2 * np.pi) * deep / np.sqrt(np.pi * body.diffusivity * t)
    expected = 2 * MODULUS * body.contact_radius * less / (body.instantaneous_force - body.relaxed_force)
    assert body.relaxation(t) == pytest.approx(expected, rel=2e-2)


@pytest.mark.parametrize(("under", "outside"), DRAINAGE)
@pytest.mark.parametrize("indenter", [PUNCH, Paraboloid(3.0)])
def test_the_transforms_obey_the_conditions_of_the_surface(indenter, under, outside):
    """Surface displacement below the indenter, and pressure or flow, from the transforms by another rule."""
    body = poroelastic(indenter, under=under, outside=outside)
    a, rate = body.contact_radius, 3.0
    solution = np.real(body._solution(rate, 256.0))
    kappa, m, beta = body._constants
    xi = (np.arange(100_000) + 0.5) * (0.01 / a)
    gamma = np.sqrt(xi**2 + rate / body.diffusivity)
    coupling = kappa * xi / (gamma + xi)
    n, sign = np.arange(len(solution) // 2 if under != outside else len(solution)), 1
    sign = (-1.0) ** n[:, None]
    N = a * (solution[: len(n)] @ (sign * spherical_jn(2 * n[:, None], xi * a)))
    if under == outside:
        P = N / (beta - (coupling if under == "drained" else coupling * xi / gamma))
        Q = -P if under == "drained" else -xi / gamma * P
    elif under == "sealed":
        p = 1 / xi * (solution[len(n) :] @ (sign * spherical_jn(2 * n[:, None] + 1, xi * a)))
        P = (N - coupling * p) / (beta - coupling)
        Q = p - P
    else:
        flow = solution[len(n) :] @ (sign * spherical_jn(2 * n[:, None], xi * a))
        P = (gamma * N - coupling * flow) / (beta * gamma - coupling * xi)
        Q = (beta * flow - xi * N) / (beta * gamma - coupling * xi)
    # A smooth end takes the cut of the integral away.
    end = np.exp(-((xi / xi[-1] * 6) ** 2))

    def at(r, transform):
        return float(np.sum(transform * end * xi * j0(xi * r)) * (xi[1] - xi[0]))

    given = [
        body.depth - float(r**2 / (2 * 3.0) if indenter.fixed_radius is None else 0)
        for r in (0.3 * a, 0.7 * a)
    ]
    for r, w in zip((0.3 * a, 0.7 * a), given, strict=True):
        assert at(r, m / 2 / xi * P) == pytest.approx(w / rate, rel=2e-4)
    scale = at(0.3 * a, N)
    assert scale > 0
    assert at(1.3 * a, N) == pytest.approx(0, abs=1e-4 * scale)
    if outside == "drained":
        assert at(1.3 * a, P + Q) == pytest.approx(0, abs=1e-4 * scale)
    else:
        assert at(1.3 * a, xi * P + gamma * Q) == pytest.approx(0, abs=2e-3 * scale / a)
    if under == "drained":
        assert at(0.3 * a, P + Q) == pytest.approx(0, abs=1e-4 * scale)
    else:
        assert at(0.3 * a, xi * P + gamma * Q) == pytest.approx(0, abs=2e-3 * scale / a)


@pytest.mark.parametrize(("under", "outside"), DRAINAGE)
def test_pressures_of_the_half_space(under, outside):
    body = poroelastic(Paraboloid(3.0), under=under, outside=outside)
    a = body.contact_radius
    t = 0.2 * a**2 / body.diffusivity
    assert whole(lambda r: body.contact_pressure(r, t), a) == pytest.approx(body.force(t), rel=1e-9)
    r = np.array([0.0, 0.5, 0.9, 0.999]) * a
    p, N = body.pore_pressure(r, t), body.contact_pressure(r, t)
    if under == "drained":
        assert not p.any()
    else:
        assert np.all(np.diff(p) < 0)
        assert np.all(p[:3] < N[:3])
        assert np.all(p > 0)
        # The edge of a sealed zone in a drained surface is met like a crack's tip.
        ratio = p[3] / body.pore_pressure(np.array(0.99 * a), t)
        assert ratio == pytest.approx(np.sqrt(0.1), rel=0.1) if outside == "drained" else ratio > 0.9


def test_more_terms_change_nothing(monkeypatch):
    times = [tau * 4 / 0.7 / poroelastic().aggregate_modulus for tau in (1e-3, 0.1, 3.0)]
    found = [poroelastic().relaxation(t) for t in times]
    monkeypatch.setattr(indentation, "TERMS", 26)
    indentation._quadrature.cache_clear()
    more = [poroelastic().relaxation(t) for t in times]
    indentation._quadrature.cache_clear()
    np.testing.assert_allclose(found, more, atol=2e-6)


def test_a_ramp_is_a_sum_of_sudden_depths():
    sudden, ramped = poroelastic(), poroelastic(ramp=0.4)
    points, weights = np.polynomial.legendre.leggauss(12)
    for t in (0.3, 0.9):
        low = max(t - 0.4, 0.0)
        # s = low + (t − low) x², for the force begins with a root of s.
        x = (points + 1) / 2
        forces = np.array([sudden.force(low + (t - low) * v**2) for v in x])
        mean = float(weights @ (forces * x)) * (t - low) / 0.4
        assert ramped.force(t) == pytest.approx(mean, rel=1e-6)


def test_creep_is_the_inverse_of_relaxation():
    """Their transforms per load: F̄ δ̄ = 1/s², so that the two convolve to t."""
    body = poroelastic(depth=1.0)
    t = 0.5
    points, weights = np.polynomial.legendre.leggauss(10)
    angle = np.pi / 4 * (points + 1)
    s = t * np.sin(angle) ** 2
    product = np.array([body.force(v) * body.creep(1.0, t - v) for v in s])
    assert np.pi / 4 * float(weights @ (product * t * np.sin(2 * angle))) == pytest.approx(t, rel=1e-5)
    assert body.creep(1.0, 1e9) == pytest.approx(1 / body.relaxed_force, rel=1e-4)
    with pytest.raises(ValueError, match="sharp edge"):
        poroelastic(Sphere(5.0)).creep(1.0, 1.0)


# --- published curves ------------------------------------------------------------------------------------------------

TAU = np.array([1e-3, 1e-2, 0.03, 0.1, 0.3, 1.0])


def curve(indenter, **others):
    body = poroelastic(indenter, **others)
    return np.array([body.relaxation(tau * body.contact_radius**2 / body.diffusivity) for tau in TAU])


def test_the_fits_begin_at_one_and_end_at_zero():
    for shape in ("sphere", "cone", "punch", "punch-2017"):
        assert relaxation_fit(shape, 0.0) == pytest.approx(1, abs=2e-3)
        assert relaxation_fit(shape, 1e6) == pytest.approx(0, abs=1e-10)


def test_the_punch_follows_both_published_fits():
    """Sealed below and drained outside; the other conditions of drainage are ten times as far away."""
    found = curve(PUNCH)
    np.testing.assert_allclose(found, relaxation_fit("punch", TAU), atol=0.015)
    np.testing.assert_allclose(found, relaxation_fit("punch-2017", TAU), atol=0.025)
    assert np.abs(curve(PUNCH, under="drained") - relaxation_fit("punch", TAU)).max() > 0.15
    assert np.abs(curve(PUNCH, outside="sealed") - relaxation_fit("punch", TAU)).max() > 0.12


@pytest.mark.parametrize(
    ("shape", "indenter", "reach"), [("sphere", Paraboloid(3.0), 2**0.5), ("cone", Cone(60.0), np.pi / 2)]
)
def test_sphere_and_cone_follow_the_fits_of_a_wider_sealed_zone(shape, indenter, reach):
    """The fits of 2010 lie above a zone that is sealed in contact alone, by up to 0.14.

    They are those of a surface that is sealed as far as the profile cuts the undeformed surface, within 0.03.
    """
    a = poroelastic(indenter).contact_radius
    near = np.abs(curve(indenter) - relaxation_fit(shape, TAU)).max()
    wide = np.abs(curve(indenter, sealed_radius=reach * a) - relaxation_fit(shape, TAU)).max()
    assert wide < 0.03 < 0.1 < near < 0.14
