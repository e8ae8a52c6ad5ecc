"""Rates of parameters: quantities by hand, exact derivatives, equal stretches, refused names, named rates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.macro.laws.rates import NAMED_RATES, QUANTITIES, Rate, RatePoints
from porocore.testing.expect import STEPS, central_difference

N, PARAMETERS, CONSTANTS = 6, ("radius", "radii.x"), ("k", "target")
RNG = np.random.default_rng(11)
POINTS = RatePoints(
    time=np.full(N, 0.7),
    grad_u=0.3 * RNG.standard_normal((N, 3, 3)),
    p=0.2 * RNG.standard_normal(N),
    parameters=RNG.uniform(0.2, 0.4, (N, 2)),
    fluid_volume=RNG.uniform(0.2, 0.5, N),
    stress=0.5 * RNG.standard_normal((N, 3, 3)),
    flux=RNG.standard_normal((N, 3)),
    position=RNG.standard_normal((N, 3)),
    potential=RNG.standard_normal(N),
)
GIVEN = RNG.uniform(0.5, 1.5, (N, 2))


def rate(formula: str) -> Rate:
    return Rate(formula, PARAMETERS, CONSTANTS)


def value(formula: str, points: RatePoints = POINTS) -> np.ndarray:
    return rate(formula).at(points, GIVEN).value


def test_quantities_by_hand():
    F = np.eye(3) + POINTS.grad_u
    J = np.linalg.det(F)
    stretches = np.linalg.svd(F, compute_uv=False)
    sigma = POINTS.stress @ F.swapaxes(1, 2) / J[:, None, None]
    effective = sigma + POINTS.p[:, None, None] * np.eye(3)
    mean = np.trace(effective, axis1=1, axis2=2) / 3
    symmetric = (effective + effective.swapaxes(1, 2)) / 2 - mean[:, None, None] * np.eye(3)
    expected = {
        "t": np.full(N, 0.7),
        **dict(zip("xyz", POINTS.position.T, strict=True)),
        "J": J,
        "I1": (F**2).sum(axis=(1, 2)),
        **{f"stretch_{k + 1}": stretches[:, k] for k in range(3)},
        "p": POINTS.p,
        "phi": POINTS.fluid_volume,
        "flux": np.linalg.norm(POINTS.flux, axis=1),
        "energy": POINTS.potential + POINTS.p * POINTS.fluid_volume,
        "mean_stress": mean,
        "von_mises": np.sqrt(1.5 * (symmetric**2).sum(axis=(1, 2))),
    }
    assert set(expected) == set(QUANTITIES)
    for name, by_hand in expected.items():
        np.testing.assert_allclose(value(name), by_hand, rtol=1e-12, err_msg=name)
    np.testing.assert_allclose(
        value("radii_x*radius - k/target"), POINTS.parameters.prod(axis=1) - GIVEN[:, 0] / GIVEN[:, 1]
    )


@pytest.mark.parametrize(
    "formula",
    [
        *QUANTITIES,
        "k*radius**2*flux - target*radii_x*exp(J - stretch_1*stretch_3)",
        "k*(mean_stress - target)*von_mises + phi*p*I1/stretch_2 + t*x",
    ],
)
def test_derivatives_by_every_field(formula):
    found = rate(formula).at(POINTS, GIVEN)
    for field in ("grad_u", "p", "parameters", "fluid_volume", "stress", "flux", "potential"):
        at = getattr(POINTS, field)
        for component in np.ndindex(at.shape[1:]):
            unit = np.zeros(at.shape)
            unit[(slice(None), *component)] = 1e-3

            def moved(step, field=field, unit=unit, at=at):
                return value(formula, replace(POINTS, **{field: at + step * unit}))

            by = central_difference(map(moved, STEPS), 1e-3)
            slope = getattr(found, field)[(slice(None), *component)]
            np.testing.assert_allclose(slope, by, rtol=2e-8, atol=2e-8, err_msg=field)
    for k in range(2):
        unit = 1e-3 * np.eye(2)[k]
        by = central_difference((rate(formula).at(POINTS, GIVEN + s * unit).value for s in STEPS), 1e-3)
        np.testing.assert_allclose(found.constants[:, k], by, rtol=1e-9, atol=1e-9)


def test_at_rest_and_without_stress_and_flux_all_derivatives_are_finite():
    still = RatePoints(
        *(np.zeros_like(getattr(POINTS, name)) for name in ("time", "grad_u", "p")),
        POINTS.parameters,
        POINTS.fluid_volume,
        np.zeros_like(POINTS.stress),
        np.zeros_like(POINTS.flux),
    )
    formula = "sqrt(flux) + von_mises**0.5 + flux**k + stretch_1*stretch_2*stretch_3"
    found = rate(formula).at(still, GIVEN)
    for name, slope in vars(found).items():
        assert np.isfinite(slope).all(), name
    np.testing.assert_allclose(found.grad_u, np.broadcast_to(np.eye(3), (N, 3, 3)), atol=1e-14)


def test_equal_stretches_in_a_symmetric_formula():
    Q = np.linalg.qr(RNG.standard_normal((3, 3)))[0]
    turned = replace(POINTS, grad_u=np.tile(Q @ np.diag([1.2, 1.2, 0.9]) - np.eye(3), (N, 1, 1)))
    by_stretches = rate("stretch_1**2 + stretch_2**2 + stretch_3**2").at(turned, GIVEN)
    by_invariant = rate("I1").at(turned, GIVEN)
    np.testing.assert_allclose(by_stretches.grad_u, by_invariant.grad_u, atol=1e-13)


@pytest.mark.parametrize(
    ("formula", "words"),
    [
        ("-k*radus", ["radus", "unknown name", "radius", "mean_stress", "target"]),
        ("k*radii.x", ["radii.x"]),
        ("maximum(flux)", ["unknown function"]),
        ("k*", ["no formula"]),
    ],
)
def test_a_formula_with_another_name_is_refused_with_the_list(formula, words):
    with pytest.raises(ConfigurationError) as error:
        rate(formula)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize("name", ["flux", "radius", "radii_x", "exp", "pi"])
def test_a_constant_with_a_name_that_is_taken_is_refused(name):
    with pytest.raises(ConfigurationError, match=f"'{name}' has two meanings"):
        Rate("radius", PARAMETERS, [name])


def test_a_constant_without_a_proper_name_is_refused():
    with pytest.raises(ConfigurationError, match="'k 1': expected the name of a constant"):
        Rate("radius", PARAMETERS, ["k 1"])


def test_the_place_of_points_without_one_is_refused():
    with pytest.raises(ConfigurationError, match="names the place x, y or z"):
        value("k*x", replace(POINTS, position=None))


def test_the_energy_of_a_law_without_one_is_refused():
    with pytest.raises(ConfigurationError, match="names the energy, but the law of the cells has none"):
        value("k*energy", replace(POINTS, potential=None))


def test_named_rates():
    F, k, target = np.eye(3) + POINTS.grad_u, *GIVEN.T
    own = POINTS.parameters[:, 1]
    sigma = np.einsum("nij,nij->n", POINTS.stress, F) / (3 * np.linalg.det(F)) + POINTS.p
    expected = {
        "clogging": -k * np.linalg.norm(POINTS.flux, axis=1) * (own - target),
        "growth": k * (sigma - target),
        "degradation": -k * own,
        "creep": k * (target - own),
    }
    assert set(expected) == set(NAMED_RATES)
    for name, by_hand in expected.items():
        named = NAMED_RATES[name].of("radii.x", PARAMETERS)
        assert named.constants == tuple(NAMED_RATES[name].constants)
        found = named.at(POINTS, GIVEN[:, : len(named.constants)])
        np.testing.assert_allclose(found.value, by_hand, rtol=1e-12, err_msg=name)
