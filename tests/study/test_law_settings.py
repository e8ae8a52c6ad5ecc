"""Settings of laws with memory: what they change of a study, and which numbers the solved problem gets."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.family.family import possible_parameters
from porocore.core.units import GAS_CONSTANT, Scales, value_of
from porocore.errors import ConfigurationError
from porocore.macro.composition.fields import as_field
from porocore.macro.composition.law_numbers import is_of_the_law, key_of_number, of_the_cell
from porocore.macro.problem import body_mesh
from porocore.study.config.config import RunConfig
from porocore.study.config.loading import load_config
from porocore.study.run import composition
from tests.bad_input.bad_row import study
from tests.bad_input.rows_laws import FAMILY

SERIES = {"branches": [{"strength": 0.5, "time": 3.0}, {"strength": 0.0, "time": 40.0}]}
CHARGED = {"macro.charges": {"density": "0.2 + 0.1*y", "bath": {"table": [[0, 0.15], [5, 1]]}}}
SCALES = {
    "scales": {"modulus": "0.5 MPa", "length": "1 mm", "pore": "1 um", "viscosity": "1 mPa*s"},
    "cell.viscosity": "1 mPa*s",
}


@pytest.fixture
def load(tmp_path):
    def loaded(changes=None) -> RunConfig:
        path = tmp_path / "study.yaml"
        path.write_text(study(changes))
        return load_config(path)

    return loaded


def before_the_body(config):
    found = config.stages
    return found.cell, found.sampling, found.test, found.training


@pytest.mark.parametrize(
    "changes", [{"cell.material.relaxation": SERIES}, CHARGED], ids=["relaxation", "charges"]
)
def test_laws_with_memory_are_of_the_body_alone(load, changes):
    plain, other = load(), load(changes)
    assert before_the_body(plain) == before_the_body(other)
    assert plain.stages.macro != other.stages.macro
    assert load(changes).stages == other.stages


def test_each_number_of_a_relaxation_is_part_of_the_identity(load):
    stages = {load({"cell.material.relaxation": SERIES}).stages.macro}
    for changes in ({"strength": 0.6, "time": 3.0}, {"strength": 0.5, "time": 3.5}):
        branches = [changes, SERIES["branches"][1]]
        stages.add(load({"cell.material.relaxation": {"branches": branches}}).stages.macro)
    assert len(stages) == 3


def evolving(rate, field=0.25, **constants):
    evolution = {"radius": {"rate": rate, "constants": constants}}
    return {**FAMILY, "macro.evolution": evolution, "macro.fields": {"radius": field}}


def test_a_rate_that_follows_the_body_frees_the_parameter_from_its_first_value(load):
    """Samples then stand for the whole range, not for the one value that the body begins with."""
    config = load(evolving("-k*flux", k=0.01))
    assert load(FAMILY).used_parameters == ((0.25,),)
    assert config.used_parameters == ()
    assert config.stages.cell == load(FAMILY).stages.cell


@pytest.mark.parametrize(
    ("rate", "last"),
    [("-k*radius", 0.25 * np.exp(-0.12)), ("-k*radius**2", 0.25 / (1 + 0.25 * 0.12)), ("-10*k", 0.2)],
    ids=["decay", "of second order", "to the end of the range"],
)
def test_samples_are_spent_where_a_known_course_goes(load, rate, last):
    """The run ends at t = 12; values are told apart in steps of a fortieth of the range."""
    config = load(evolving(rate, k=0.01))
    rows = np.array(config.used_parameters)[:, 0]
    assert rows.max() == pytest.approx(0.25, abs=1e-9)
    assert rows.min() == pytest.approx(last, abs=0.00126)
    np.testing.assert_allclose(np.diff(rows), 0.0025, rtol=1e-9)
    *_, values = config.values_in_body(None, [0.0, 6.0, 12.0])
    np.testing.assert_allclose(values, last, rtol=1e-6)


def test_a_known_course_may_go_by_the_place(load):
    config = load(evolving("-0.001*y", "0.25 + 0.005*y/7.5"))
    *_, values = config.values_in_body(None, [0.0, 12.0])
    y = body_mesh(config.macro).quadrature_points[..., 1].ravel()
    expected = np.maximum(0.25 + 0.005 * y / 7.5 - 0.012 * y, 0.2)
    np.testing.assert_allclose(np.sort(values[:, 0]), np.sort(expected), rtol=1e-9)


def test_a_rate_without_a_value_is_refused(load):
    config = load(evolving("0.001*sqrt(y - 3)"))
    with pytest.raises(
        ConfigurationError, match=r"macro\.evolution\.radius: the rate '0\.001\*sqrt\(y - 3\)' is no"
    ):
        list(config.values_in_body(None, [0.0, 12.0]))


def test_settings_are_read_again_as_they_were_written(load, tmp_path):
    config = load(
        {
            **FAMILY,
            **CHARGED,
            "cell.material.relaxation": SERIES,
            "macro.evolution": {"radius": {"law": "degradation", "constants": {"degradation_rate": 0.1}}},
        }
    )
    path = tmp_path / "again.yaml"
    path.write_text(config.resolved_yaml())
    assert load_config(path) == config


def test_cell_solvers_never_see_the_relaxation(monkeypatch):
    seen = []

    class Solver:
        conductivities = ("piola",)

        def __init__(self, **options):
            pass

        def prepare(self, cell, **how):
            seen.append(cell)

    monkeypatch.setattr(
        composition, "registry", lambda: type("Registry", (), {"get": lambda self, kind, name: Solver})()
    )
    cell = Cell(material={"relaxation": SERIES})
    family = Cell(material={"relaxation": SERIES, "poisson_ratio": {"range": [0.2, 0.3]}})
    regions = Cell(materials={name: {"relaxation": SERIES} for name in ("core", "shell")})
    composition.prepare_cell("any", {}, cell)
    composition.prepare_cell("any", {}, regions)
    seen.append(composition.prepare_family("any", {}, family)[1].cell.at([0.25]))
    assert seen == [Cell(), Cell(materials={"core": {}, "shell": {}}), seen[2]]
    assert [each.relaxation for each in seen] == [None] * 3
    assert cell.in_equilibrium.identity == cell.identity == Cell().identity
    assert cell.solid.identity == Cell().solid.identity
    assert cell.relaxation == regions.relaxation == family.relaxation != None  # noqa: E711


def test_numbers_of_a_relaxation_are_no_parameters_of_the_cell():
    relaxing = Cell(material={"relaxation": SERIES})
    assert possible_parameters(relaxing) == possible_parameters(Cell())
    of_two = Cell(materials={"relaxation": {"relaxation": SERIES}, "core": {"relaxation": SERIES}})
    assert "relaxation.poisson_ratio" in possible_parameters(of_two).values()


def test_the_solved_problem_has_the_numbers_of_its_laws(load):
    changes = {
        **FAMILY,
        **CHARGED,
        "cell.material.relaxation": SERIES,
        "macro.evolution": {"radius": {"rate": "-k*flux", "constants": {"k": 0.1}}},
    }
    fields = load(changes).problem(-0.04).fields
    plain = {name: value for name, value in fields.items() if isinstance(value, float)}
    assert plain == {
        "radius": 0.25,
        "relaxation.1.strength": 0.5,
        "relaxation.1.time": 3.0,
        "relaxation.2.strength": 0.0,
        "relaxation.2.time": 40.0,
        "evolution.radius.k": 0.1,
    }
    assert fields["charges.density"] == "0.2 + 0.1*y"
    bath = as_field(fields["charges.bath"])
    at = [float(bath.in_time(np.ones(1), t)[0]) for t in (0.0, 2.5, 7.0)]
    np.testing.assert_allclose(at, [0.15, 0.575, 1.0], rtol=1e-15)
    assert of_the_cell(fields) == ("radius",)
    assert load(changes).macro.problem(-0.04).fields == {"radius": 0.25}


def test_baths_of_surfaces_have_units_and_are_read_again(load, tmp_path):
    dilute = {"table": [["0 s", "0.3 M"], ["10 s", "0.03 M"]]}
    surfaces = {"y+": "0.15 mol/l", "y-": dilute}
    config = load(
        {
            **SCALES,
            "macro.charges": {"density": "0.2 mEq/ml", "bath": surfaces},
            "macro.boundary.y-": {"displacement": [0, 0, 0], "pressure": 0},
        }
    )
    unit, baths = 0.5e6 / float(GAS_CONSTANT), config.macro.charges.bath
    assert baths["y+"] == pytest.approx(150 / unit, rel=1e-15)
    assert [value for _, value in baths["y-"].table] == pytest.approx([300 / unit, 30 / unit], rel=1e-15)
    field = config.problem(1.0).fields["charges.bath"]
    assert field.surfaces == baths
    assert field.corners == config.macro.charges.corners == tuple(time for time, _ in baths["y-"].table)
    path = tmp_path / "again.yaml"
    path.write_text(config.resolved_yaml())
    again = load_config(path)
    assert again == config
    assert again.stages == config.stages
    assert load({**CHARGED}).stages.macro != config.stages.macro


def test_regions_have_the_relaxation_of_their_cell(load):
    solid = {"relaxation": {"branches": [{"strength": 2, "time": 1}]}}
    config = load(
        {
            "cell.material.relaxation": SERIES,
            "cells": {"soft": {"material": solid}, "stiff": {}},
            "macro.regions": {
                "low": {"below": 2.0, "cell": "soft"},
                "high": {"above": 6.0, "cell": "stiff"},
                "middle": {"above": 3.0, "below": 4.0},
            },
        }
    )
    problem = config.problem(1.0)
    assert list(problem.fields) == [
        "relaxation.1.strength",
        "relaxation.1.time",
        "relaxation.2.strength",
        "relaxation.2.time",
    ]
    assert problem.regions["low"].fields == {"relaxation.1.strength": 2.0, "relaxation.1.time": 1.0}
    assert problem.regions["high"].fields == problem.regions["middle"].fields == {}


@pytest.mark.parametrize(
    ("name", "cell", "key"),
    [
        ("relaxation.1.strength", None, "cell.material.relaxation.branches.0.strength"),
        ("relaxation.2.time", "soft", "cells.soft.material.relaxation.branches.1.time"),
        ("charges.density", None, "macro.charges.density"),
        ("evolution.radii.x.k", None, "macro.evolution.radii.x.constants.k"),
    ],
)
def test_numbers_of_laws_have_the_keys_of_the_file(name, cell, key):
    assert is_of_the_law(name)
    assert key_of_number(name, cell) == key


def test_a_region_is_not_called_like_a_law(load):
    material = {"poisson_ratio": {"range": [0.2, 0.3]}}
    with pytest.raises(
        ConfigurationError, match=r"cell: the parameter 'charges.poisson_ratio' is called like a number of a"
    ):
        load(
            {
                "cell.material": None,
                "cell.materials": {"charges": material, "core": {}},
                "closure": "potential",
            }
        )


def test_concentrations_are_multiples_of_the_modulus_by_the_gas_constant(load):
    config = load(
        {
            **SCALES,
            "macro.charges": {"density": "0.2 mEq/ml", "bath": "0.15 M", "temperature": "25 °C"},
        }
    )
    charges = config.macro.charges
    unit = 0.5e6 / float(GAS_CONSTANT)
    assert charges.density == pytest.approx(200 / unit, rel=1e-15)
    assert charges.bath == pytest.approx(150 / unit, rel=1e-15)
    assert charges.osmotic == 298.15
    # R T (√(200² + 300²) − 300) mol/m³
    expected = 8.31446261815324 * 298.15 * (np.sqrt(200.0**2 + 300.0**2) - 300)
    assert charges.osmotic_pressure(charges.density, charges.bath) * 0.5e6 == pytest.approx(
        expected, rel=1e-12
    )
    assert charges.osmotic_pressure(0.0, charges.bath) == 0.0


@pytest.mark.parametrize(
    "text", ["0.2 mol/l", "200 mmol/l", "200 mM", "0.2 M", "0.2 mEq/ml", "200 mEq/l", "200 mol/m³"]
)
def test_units_of_concentrations(text):
    scales = Scales(modulus=1e6, length=1.0, pore=1.0)
    assert value_of(text, "concentration", scales) == float(200 * GAS_CONSTANT / 10**6)


def test_constants_of_named_rates_have_units(load):
    law = {"law": "growth", "constants": {"growth_rate": "0.1 1/h", "homeostatic_stress": "2 kPa"}}
    config = load({**FAMILY, **SCALES, "macro.evolution": {"radius": law}})
    hour = config.scales.factor("time") / 3600
    constants = config.macro.evolution["radius"].constants
    assert constants["growth_rate"] == pytest.approx(0.1 * hour, rel=1e-12)
    assert constants["homeostatic_stress"] == 0.004
