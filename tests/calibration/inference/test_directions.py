"""Unseen directions: of closed forms, in numbers and in words; none in well determined problems."""

import numpy as np
import pytest

from porocore.commands.calibration.directions import direction_words, non_identifiable_directions
from porocore.commands.calibration.problem import Unknown
from porocore.commands.calibration.suggestions import IdentifiabilityRule
from porocore.macro.analytic import Terzaghi

RULE = IdentifiabilityRule()
#: Radius, Poisson's ratio, modulus and viscosity as in a study of cartilage.
CELL = (
    Unknown("radius", 0.24, 0.15, 0.3, "log"),
    Unknown("poisson_ratio", 0.35, 0.2, 0.45),
    Unknown("modulus", 1.0, 0.1, 10.0, "log"),
    Unknown("viscosity", 1.0, 0.1, 10.0, "log"),
)


AT = np.array([np.log(0.24), 0.35, 0.0, 0.0])


def layer(x, load):
    """A layer of a porous solid with three channels, its moduli by the bound of Hashin and Shtrikman."""
    radius, nu, E, viscosity = np.exp(x[0]), x[1], np.exp(x[2]), np.exp(x[3])
    porosity = 3 * np.pi * radius**2 - 8 * np.sqrt(2) * radius**3
    solid, bulk, shear = 1 - porosity, E / 3 / (1 - 2 * nu), E / 2 / (1 + nu)
    drained = bulk * solid * 4 * shear / (4 * shear + 3 * porosity * bulk)
    f = shear / 6 * (9 * bulk + 8 * shear) / (bulk + 2 * shear)
    shear = 1 / (solid / (shear + f) + porosity / f) - f
    alpha = 1 - drained / bulk
    permeability = 0.35 * radius**4.2 / viscosity
    return Terzaghi(1.0, load, drained + 4 * shear / 3, alpha, (alpha - porosity) / bulk, permeability)


def confined(load=0.005):
    """Weighted Jacobian of the settlement in confined compression, 1 % noise, 40 times."""
    x = np.array([np.log(0.24), 0.35, 0.0, 0.0])
    times = np.geomspace(1e-3, 2, 40) / layer(x, load).consolidation_coefficient
    h, deviation = 1e-5, 0.01 * layer(x, load).final_settlement
    steps = h * np.eye(4)
    columns = [
        (layer(x + e, load).settlement(times) - layer(x - e, load).settlement(times)) / (2 * h) for e in steps
    ]
    return np.stack(columns, axis=1) / deviation, RULE.limits(CELL, x)


def test_confined_compression_hides_exactly_one_direction():
    jacobian, limits = confined()
    (found,) = non_identifiable_directions(jacobian, limits)
    # A linear layer has three numbers (stiffness, immediate share, time), so one of four unknowns' moves is free.
    assert found.deviation > 1e4
    # shared numbers of a prototype with a finite element cell: radius + 7 %, ν − 0.043, E + 19 %, μ + 36 %.
    move = found.direction / found.direction[0] * np.log(1.07)
    assert move[1] == pytest.approx(-0.043, abs=0.02)
    assert np.exp(move[2:]) - 1 == pytest.approx([0.19, 0.36], abs=0.1)
    assert direction_words(found, CELL, limits, AT) == (
        "radius + 7.5 %, poisson_ratio − 0.059, modulus + 25 % and viscosity + 46 % together change no curve by more "
        "than its noise (less than 0.001 standard deviations of a value)."
    )


def test_the_step_of_a_direction_changes_the_exact_curves_as_little_as_told():
    jacobian, limits = confined()
    (found,) = non_identifiable_directions(jacobian, limits)
    x = np.array([np.log(0.24), 0.35, 0.0, 0.0])
    times = np.geomspace(1e-3, 2, 40) / layer(x, 0.005).consolidation_coefficient
    # Along the curved line that keeps stiffness, immediate share and time, by small steps of the direction here.
    y = x + 1e-2 * found.step
    change = layer(y, 0.005).settlement(times) - layer(x, 0.005).settlement(times)
    assert np.abs(change).max() < 1e-4 * layer(x, 0.005).final_settlement


def test_four_singular_values_of_the_prototype_name_one_direction():
    unseen = np.array([np.log(1.07), -0.043, np.log(1.19), np.log(1.36)])
    basis = np.linalg.qr(np.column_stack([unseen, np.eye(4)[:, [0, 1, 2]]]))[0]
    rows = np.diag([0.012, 244, 33, 31]) @ basis.T
    limits = RULE.limits(CELL, np.array([np.log(0.24), 0.35, 0.0, 0.0]))
    (found,) = non_identifiable_directions(rows, limits)
    cosine = abs(found.direction @ unseen) / np.linalg.norm(unseen)
    assert cosine == pytest.approx(1, abs=1e-3)
    assert found.deviation == pytest.approx(1 / 0.012, rel=1e-3)
    assert direction_words(found, CELL, limits, AT).startswith(
        "radius + 8.8 %, poisson_ratio − 0.053, modulus + 24 % and viscosity + 46 % together change no curve"
    )


def test_well_determined_problems_have_none():
    jacobian, limits = confined()
    assert non_identifiable_directions(jacobian[:, [0, 1, 3]], limits[[0, 1, 3]]) == ()
    rows = np.random.default_rng(2).normal(size=(50, 3)) * 10
    assert non_identifiable_directions(rows, np.full(3, 0.1)) == ()


def test_the_criterion_does_not_depend_on_units():
    rows = np.random.default_rng(3).normal(size=(50, 3)) @ np.diag([10.0, 1.2, 0.01])
    limits, factors = np.full(3, 0.1), np.array([1.0, 1e3, 1e-4])
    one, other = (
        non_identifiable_directions(rows, limits),
        non_identifiable_directions(rows / factors, limits * factors),
    )
    assert len(one) == len(other) == 2
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(b.step / factors, a.step, rtol=1e-9, atol=1e-12)


def pair(one, other, *rest, scale="log"):
    unknowns = tuple(Unknown(name, 1.0, 0.1, 10.0, scale) for name in ("a", "b", "c"))[: 2 + len(rest)]
    column = np.linspace(1, 2, 20) * 100
    columns = [one * column, other * column, *(each * column**2 for each in rest)]
    at = np.zeros(len(unknowns)) if scale == "log" else np.ones(len(unknowns))
    limits = RULE.limits(unknowns, at)
    found = non_identifiable_directions(np.stack(columns, axis=1), limits)
    return [direction_words(each, unknowns, limits, at) for each in found]


@pytest.mark.parametrize(
    ("one", "other", "scale", "words"),
    [
        (1, 1, "log", "Only the product a·b is identifiable, not the two separately. "),
        (1, -1, "log", "Only the ratio a/b is identifiable, not the two separately. "),
        (2, -1, "log", "Only the ratio a²/b is identifiable, not the two separately. "),
        (2, 3, "log", "Only the product a²·b³ is identifiable, not the two separately. "),
        (1, -2, "log", "Only the ratio a/b² is identifiable, not the two separately. "),
        (1, 1, "linear", "Only the sum a + b is identifiable, not the two separately. "),
        (1, -1, "linear", "Only the difference a − b is identifiable, not the two separately. "),
    ],
)
def test_a_pair_in_words(one, other, scale, words):
    (found,) = pair(one, other, 1.0, scale=scale)
    assert found.startswith(words)
    assert "c" not in found.removeprefix(words).split(" together")[0].split()


def test_no_power_is_told_that_is_none():
    (found,) = pair(1, -0.713)
    assert not found.startswith("Only")


def test_an_unknown_that_no_curve_sees():
    (found,) = pair(1.0, 0.0)
    assert found == (
        "b is not identifiable. b + 46 % alone changes no curve by more than its noise (less than 0.001 standard "
        "deviations of a value)."
    )


def test_two_unseen_directions_are_told_with_few_unknowns():
    unknowns = tuple(Unknown(name, 1.0, 0.1, 10.0, "log") for name in "abcd")
    column = np.linspace(1, 2, 20) * 100
    rows = np.stack([column, -column, 0 * column, column**2], axis=1)
    at, limits = np.zeros(4), np.full(4, np.log(1.1))
    found = non_identifiable_directions(rows, limits)
    words = sorted(direction_words(each, unknowns, limits, at).split(". ")[0] for each in found)
    assert words == ["Only the ratio a/b is identifiable, not the two separately", "c is not identifiable"]


def test_a_ratio_is_told_on_linear_scales_too():
    """Steps of a are relative on a logarithmic scale; those of b = 4 are absolute."""
    unknowns = (Unknown("a", 1.0, 0.1, 10.0, "log"), Unknown("b", 4.0, 0.1, 10.0))
    at, column = np.array([0.0, 4.0]), np.linspace(1, 2, 20) * 100
    limits = RULE.limits(unknowns, at)
    (found,) = non_identifiable_directions(np.stack([column, -column / 4.0], axis=1), limits)
    assert direction_words(found, unknowns, limits, at).startswith(
        "Only the ratio a/b is identifiable, not the two separately. "
    )
    signed = (unknowns[0], Unknown("b", 4.0, -10.0, 10.0))
    assert direction_words(found, signed, limits, at).startswith("a + ")
