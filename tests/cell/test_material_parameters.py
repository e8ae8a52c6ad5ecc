"""Slopes of energies and stresses by every number of a material, by region too; swelling of a solid."""

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.family.family import parameter_quantities
from porocore.cell.materials.hyperelastic import PlacedMaterials
from porocore.cell.materials.material import Swollen
from porocore.core.models.strict import is_number, walk, with_number
from tests.helpers.solids import MATERIALS, deformations, make

FIBRES = {"kind": "holzapfel-gasser-ogden", "shear_modulus": 0.3, "bulk_modulus": 1, "k1": 0.5, "k2": 2}
ALL = {
    **MATERIALS,
    "fibres by angles": make(
        {
            **FIBRES,
            "dispersion": 0.1,
            "toe": 0.3,
            "directions": [{"plane": "xy", "angle": 30}, {"plane": "zx", "angle": -70}],
        }
    ),
    "every function": make(
        {
            "kind": "expression",
            "energy": "c*(I1 - 3 - 2*log(J)) + ramp(b*(I1 - 3.1))*sqrt(a**2)*exp(sin(d)*(J - 1)**2)",
            "parameters": {"c": 0.3, "a": -0.4, "b": 0.2, "d": 0.3},
        }
    ),
}


def numbers_of(material):
    """Path and value of every number of a material but components of directions."""
    return {
        place.path: place.value
        for place in walk(type(material), material)
        if is_number(place.annotation) and place.path != ("swelling",)
    }


def by_difference(solid, path, F):
    """Fourth-order central difference of Ψ and P."""
    value = numbers_of(solid)[path]
    h = 1e-3 * max(abs(value), 0.1)

    def at(steps):
        moved = with_number(solid, path, lambda number: number + steps * h)
        return moved.energy_density(F), moved.stress(F)

    values = [at(k) for k in (-2, -1, 1, 2)]
    return [(a - 8 * b + 8 * c - d) / (12 * h) for a, b, c, d in zip(*values, strict=True)]


@pytest.mark.parametrize("name", ALL)
def test_slopes_by_every_number_agree_with_differences(name):
    solid, F = ALL[name], deformations()
    numbers = numbers_of(solid)
    assert numbers
    for path, value in numbers.items():
        if path[0] == "directions" and path[-1] != "angle":
            continue
        for exact, near in zip(solid.parameter_slopes(path, F), by_difference(solid, path, F), strict=True):
            scale = np.abs(near).max() + 1e-12 / max(abs(value), 0.1)
            # Kinks of the third derivative of the ramp leave more.
            assert np.abs(exact - near).max() <= (2e-5 if "ramp" in solid_text(solid) else 1e-8) * scale, path


def solid_text(solid):
    return getattr(solid, "formula", "")


@pytest.mark.parametrize("name", ["neo-hookean", "expression with fibres", "ogden"])
def test_slopes_of_a_swollen_solid_agree_with_differences(name):
    elastic, F, h = ALL[name], deformations(), 1e-3
    swollen = elastic.model_copy(update={"swelling": 1.1}).on(None)
    key = next(iter(numbers_of(elastic)))
    values = [Swollen(elastic, 1.1 + k * h) for k in (-2, -1, 1, 2)]
    for which, exact in zip(
        ("energy_density", "stress"), swollen.parameter_slopes(("swelling",), F), strict=True
    ):
        a, b, c, d = (getattr(solid, which)(F) for solid in values)
        assert np.allclose(exact, (a - 8 * b + 8 * c - d) / (12 * h), rtol=1e-7, atol=1e-8)
    by_energy, by_stress = swollen.parameter_slopes(key, F)
    of_elastic = elastic.parameter_slopes(key, F / 1.1)
    assert np.allclose(by_energy, 1.1**3 * of_elastic[0])
    assert np.allclose(by_stress, 1.1**2 * of_elastic[1])


def test_stress_and_tangent_of_a_swollen_solid_are_derivatives():
    solid, F, h = Swollen(ALL["mooney-rivlin"], 1.2), deformations(), 1e-6
    assert np.abs(solid.stress(1.2 * np.eye(3))).max() < 1e-14
    for i, j in ((0, 0), (1, 2)):
        step = np.zeros((3, 3))
        step[i, j] = h
        difference = (solid.energy_density(F + step) - solid.energy_density(F - step)) / (2 * h)
        assert np.allclose(solid.stress(F)[..., i, j], difference, rtol=1e-6, atol=1e-8)
        difference = (solid.stress(F + step) - solid.stress(F - step)) / (2 * h)
        assert np.allclose(solid.tangent(F)[..., i, j], difference, rtol=1e-6, atol=1e-7)


def test_slopes_by_region_are_zero_elsewhere():
    soft, stiff = make({"poisson_ratio": 0.2}), make({"poisson_ratio": 0.4, "swelling": 1.1})
    placed = PlacedMaterials((("soft", soft, np.array([0, 2])), ("stiff", stiff.on(None), np.array([1]))))
    F = deformations()[:6].reshape(3, 2, 3, 3)
    by_energy, by_stress = placed.parameter_slopes(("stiff", "poisson_ratio"), F)
    exact = stiff.on(None).parameter_slopes(("poisson_ratio",), F[[1]])
    assert np.array_equal(by_energy[[1]], exact[0])
    assert np.array_equal(by_stress[[1]], exact[1])
    assert not by_energy[[0, 2]].any()
    assert placed.mean_stretch == pytest.approx(1 + 0.1 / 3)


def test_a_solid_that_does_not_swell_is_dumped_as_before():
    assert make({"poisson_ratio": 0.3}).model_dump() == {"kind": "neo-hookean", "poisson_ratio": 0.3}
    swollen = Cell(material={"swelling": {"range": [1, 1.2]}})
    assert [p.name for p in swollen.parameters] == ["swelling"]
    assert Cell(**swollen.model_dump()) == swollen


def test_a_direction_by_its_angle_is_that_vector():
    angle = make({**FIBRES, "directions": [{"plane": "yz", "angle": 30}]})
    vector = make({**FIBRES, "directions": [[0, np.sqrt(0.75), 0.5]]})
    assert np.allclose(angle.stress(deformations()), vector.stress(deformations()), rtol=1e-13, atol=1e-13)
    family = Cell(material={**FIBRES, "directions": [{"plane": "xy", "angle": {"range": [-10, 10]}}]})
    assert [p.name for p in family.parameters] == ["directions.0.angle"]
    assert family.point_group.name == "2/m"
    assert not family.mirrored
    assert family.at([0]).mirrored


@pytest.mark.parametrize(
    ("energy", "parameters", "stresses"),
    [
        (
            "m/2*(I1 - 3 - 2*log(J)) + f/a*(exp(a*(I1 - 3)**2) - 1)",
            {"m": 0.8, "f": 1.0, "a": 6.0},
            {"m", "f"},
        ),
        ("m*(1 - s)*(I1 - 3 - 2*log(J)) + m*s*(J - 1)**2", {"m": 0.8, "s": 0.3}, {"m"}),
        ("0.4*(I1 - 3 - 2*log(J)) + c*(J - 1)**2", {"c": 0.8}, set()),
        ("a*b*(I1 - 3 - 2*log(J))", {"a": 0.8, "b": 0.5}, set()),
        ("(a*b)**0.5*(I1 - 3 - 2*log(J))", {"a": 0.8, "b": 0.5}, {"a", "b"}),
    ],
)
def test_which_parameters_of_a_formula_are_stresses_follows_from_the_formula(energy, parameters, stresses):
    """An exponent in kPa would be nonsense, and a modulus without a unit none that a reader of a report can use."""
    ranges = {name: {"range": [value, 1.1 * value]} for name, value in parameters.items()}
    cell = Cell(material={"kind": "expression", "energy": energy, "parameters": ranges})
    assert parameter_quantities(cell) == {name: "stress" if name in stresses else "" for name in parameters}
