"""Effective properties of cells against closed forms, bounds, exact identities and solves under uniaxial stress."""

import math

import numpy as np
import pint
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import root

from porocore import CellProblem
from porocore.core.units import OutputUnits, ResultUnits, Scales
from porocore.errors import ConfigurationError
from porocore.macro.laws.linear import PROPERTIES, EffectiveProperties, LinearCoefficients

POISSON = 0.3
#: Bulk and shear modulus of a solid of E = 1.
K_S, G_S = 1 / 3 / (1 - 2 * POISSON), 1 / 2 / (1 + POISSON)
MESH = {"size": 0.3, "fluid_size": 0.15}


def problem(mesh=MESH, **geometry):
    solid = {"kind": "neo-hookean", "poisson_ratio": POISSON}
    cell = {"geometry": geometry, "material": solid, "mesh": mesh, "viscosity": 0.5}
    return CellProblem(cell, store=False)


def test_a_nearly_incompressible_solid_is_refused_by_its_key():
    solid = {"kind": "neo-hookean", "poisson_ratio": 0.49999999}
    geometry, mesh = {"kind": "orthogonal-channels"}, {"size": 0.5, "fluid_size": 0.4}
    cell = CellProblem({"geometry": geometry, "material": solid, "mesh": mesh}, store=False)
    with pytest.raises(
        ConfigurationError, match=r"cell.material.poisson_ratio: the undeformed cell ended with"
    ):
        assert cell.properties


@pytest.fixture(scope="module")
def cubic():
    return problem(kind="orthogonal-channels", radius=0.25)


@pytest.fixture(scope="module")
def channel():
    return problem(kind="orthogonal-channels", radii=[0, 0, 0.3])


@pytest.fixture(scope="module")
def orthotropic():
    return problem(
        {"size": 0.5, "fluid_size": 0.5, "element": "linear"},
        kind="orthogonal-channels",
        radii=[0.12, 0.2, 0.28],
    )


def test_a_channel_has_the_permeability_of_poiseuille_and_the_stiffness_of_parallel_fibres(channel):
    found = channel.properties
    exact = math.pi * 0.3**4 / 8
    assert_allclose(found.permeability, np.diag([0, 0, exact]), atol=1e-3 * exact)
    assert_allclose(found.conductivity, found.permeability / 0.5, rtol=1e-15)
    # Under stress along the channel the solid has one stress and the wall none.
    assert found.young_moduli[2] == pytest.approx(1 - found.porosity, rel=1e-6)
    assert_allclose(found.poisson_ratios[2, :2], POISSON, rtol=1e-6)
    assert found.porosity == pytest.approx(math.pi * 0.3**2, rel=5e-4)
    assert found.consolidation_coefficients[:2] == pytest.approx([0, 0], abs=1e-6)
    assert (found.isotropy, math.isnan(found.anisotropy_ratio)) == ("anisotropic", True)


@pytest.mark.parametrize("name", ["cubic", "channel", "orthotropic"])
def test_biots_coefficients_are_those_of_one_solid_constituent(name, request):
    """α = I − C_eff : C_s⁻¹ : I and 1/M_B = (tr α/3 − φ)/K_s, exact on any mesh."""
    found = request.getfixturevalue(name).properties
    C = found.stiffness_voigt
    assert_allclose(np.diag(found.biot_tensor), 1 - C[:3, :3].sum(axis=1) / 3 / K_S, rtol=1e-6)
    expected = (np.trace(found.biot_tensor) / 3 - found.porosity) / K_S
    assert found.storage == pytest.approx(expected, rel=1e-6)
    assert found.biot_modulus == pytest.approx(1 / expected, rel=1e-6)


def test_a_cubic_cell_lies_below_the_bounds_of_hashin_and_shtrikman(cubic):
    found, f = cubic.properties, cubic.properties.porosity
    assert found.isotropy == "cubic"
    bulk = found.stiffness_voigt[:3, :3].sum() / 9
    upper = K_S + f / (-1 / K_S + 3 * (1 - f) / (3 * K_S + 4 * G_S))
    assert 0.7 * upper < bulk < upper
    # Both shear moduli below Voigt's average, and their own averages below the bound of isotropic media.
    easy, hard = sorted([found.shear_moduli[0], (1 - 1e-12) * _second_shear(found)])
    assert hard < (1 - f) * G_S
    upper = G_S + f / (-1 / G_S + 6 * (1 - f) * (K_S + 2 * G_S) / (5 * G_S * (3 * K_S + 4 * G_S)))
    assert 1 / (0.6 / found.shear_moduli[0] + 0.4 / _second_shear(found)) < upper
    assert found.anisotropy_ratio == pytest.approx(found.shear_moduli[0] / _second_shear(found), rel=1e-9)
    assert easy > 0


def _second_shear(found):
    return (found.stiffness_voigt[0, 0] - found.stiffness_voigt[0, 1]) / 2


def test_young_and_poisson_are_those_of_solves_under_uniaxial_stress(orthotropic):
    """Finite strains of ±1e-4, with the lateral ones sought that leave the sides free."""
    found = orthotropic.properties

    def stress(diagonal):
        return np.diag(orthotropic.response(np.diag(diagonal), tangent=False).stress[0])

    for axis in range(3):
        sides = [i for i in range(3) if i != axis]
        ends = []
        for e in (-1e-4, 1e-4):
            guess = np.full(3, -POISSON * e)
            guess[axis] = e

            def free(lateral, guess=guess, sides=sides):
                trial = guess.copy()
                trial[sides] = lateral
                return stress(trial)[sides] * 1e4

            lateral = root(free, guess[sides], tol=1e-7).x
            guess[sides] = lateral
            ends.append((stress(guess)[axis], *lateral))
        slope = (np.array(ends[1]) - ends[0]) / 2e-4
        assert found.young_moduli[axis] == pytest.approx(slope[0], rel=1e-5)
        assert_allclose(found.poisson_ratios[axis, sides], -slope[1:], rtol=1e-5)


def test_shear_moduli_are_those_of_solves_under_shear(orthotropic):
    found, places = orthotropic.properties, ((1, 2), (0, 2), (0, 1))
    for (i, j), modulus in zip(places, found.shear_moduli, strict=True):
        H = np.zeros((2, 3, 3))
        H[0, i, j] = H[0, j, i] = 1e-4
        H[1] = -H[0]
        stress = orthotropic.response(H, tangent=False).stress
        assert modulus == pytest.approx((stress[0] - stress[1])[i, j] / 4e-4, rel=1e-5)


def test_a_solid_cell_has_the_moduli_of_its_solid():
    found = problem(kind="no-pores").properties
    assert (found.isotropy, found.anisotropy_ratio) == ("isotropic", pytest.approx(1))
    assert_allclose(found.young_moduli, 1)
    assert_allclose(found.shear_moduli, G_S)
    assert (found.porosity, found.storage, found.biot_modulus) == (pytest.approx(0), 0, math.inf)
    assert found.in_units()["biot_modulus"]["dimensionless"] is None
    assert not found.consolidation_coefficients.any()


@pytest.mark.parametrize(
    ("scales", "asked", "units"),
    [
        (Scales(modulus=2e6, length=1, pore=3e-5, viscosity=1e-3), {}, "m Pa s"),
        (
            Scales(force=5.0, length=5e-3, pore=3e-5, viscosity=2e-3),
            {"length": "mm", "stress": "MPa", "time": "min", "force": "N"},
            "mm MPa min",
        ),
        (Scales(modulus=2e6, length=0.02, pore=3e-5), {"length": "um", "stress": "kPa"}, "µm kPa s"),
    ],
)
def test_units_are_those_of_pint_by_hand(cubic, scales, asked, units):
    """E, d and μ_c alone set the units of a cell: the length of the body has no part in them."""
    found, ureg = cubic.properties, pint.UnitRegistry()
    modulus = scales.modulus or scales.force / scales.length**2
    E = modulus * ureg.Pa
    d, mu = scales.pore * ureg.m, scales.viscosity * ureg.Pa * ureg.s
    length, stress, time = (ureg(name) for name in units.split())
    stated = {
        "young_moduli": (found.young_moduli * E / stress, stress),
        "biot_modulus": (found.biot_modulus * E / stress, stress),
        "storage": (found.storage / E * stress, 1 / stress),
        "permeability": (found.permeability * d**2 / ureg.m**2, ureg.m**2),
        "conductivity": (
            found.conductivity * d**2 / mu * stress * time / length**2,
            length**2 / stress / time,
        ),
        "consolidation_coefficients": (
            found.consolidation_coefficients * E * d**2 / mu * time / length**2,
            length**2 / time,
        ),
    }
    told = found.in_units(ResultUnits(scales, OutputUnits(**asked)))
    for name, (value, unit) in stated.items():
        assert_allclose(told[name]["value"], value.to("").magnitude, rtol=1e-12)
        assert (1 * ureg(told[name]["unit"]) / unit).to("").magnitude == pytest.approx(1, rel=1e-14)
    assert told["porosity"] == {"value": found.porosity, "unit": "1"}
    assert set(told) == set(PROPERTIES)


def test_without_scales_numbers_say_what_they_are_multiples_of(cubic):
    found = cubic.properties
    told = found.in_units()
    assert told["young_moduli"] == {"dimensionless": found.young_moduli.tolist(), "multiple_of": "E"}
    assert told["consolidation_coefficients"]["multiple_of"] == "E d²/μ_c"
    assert told["poisson_ratios"]["value"][0][0] is None
    # Of an image the edge of the cell is known.
    image = found.in_units(length=4e-5)
    assert image["permeability"]["unit"] == "m²"
    assert_allclose(image["permeability"]["value"], found.permeability * 1.6e-9)
    assert "value" not in image["young_moduli"]


def test_a_stiffness_is_classed_by_its_own_numbers():
    """Hexagonal numbers, with equal moduli in the plane, are neither cubic nor isotropic."""

    def of(shear, third=1.0):
        C = np.zeros((3, 3, 3, 3))
        for i in range(3):
            for j in range(3):
                C[i, i, j, j] = 0.4 if i != j else third if i == 2 else 1.0
                if i != j:
                    C[i, j, i, j] = C[i, j, j, i] = shear
        one = np.eye(3)
        c = LinearCoefficients(C, 0.5 * one, 0.5 * one, 0.1, one, np.zeros((3,) * 4), np.zeros((3, 3)))
        return EffectiveProperties.of(c, 0.3, 1.0)

    assert of(0.3).isotropy == "isotropic"
    assert (of(0.2).isotropy, of(0.2).anisotropy_ratio) == ("cubic", pytest.approx(2 / 3))
    assert of(0.3, third=1.2).isotropy == "anisotropic"
