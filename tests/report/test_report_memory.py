"""What a user sees of laws with memory: words, tables, figures and metrics; the names of the pressure."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.materials.prony import Relaxation
from porocore.core.inputs import InputSpace
from porocore.core.units import OutputUnits, ResultUnits, Scales, using_units
from porocore.interfaces.cell import ElementCells
from porocore.interfaces.solution import all_series, write_series
from porocore.report.context import ReportContext
from porocore.report.dimensional import figures_with_units
from porocore.report.figures.curves import field_of, history_figure, panels
from porocore.report.figures.memory import course_figure, profile_field
from porocore.report.html import render
from porocore.report.metrics import LoadCase, solution_metrics
from porocore.report.words.memory import BodyMemory, figures_in_units, memory_sentences, memory_tables
from porocore.report.words.parameters import BodyCells, FamilySummary, ParameterRange, RestField, volumes_of
from porocore.states import Status
from tests.helpers.report_page import Page

UNITS = ResultUnits(
    Scales(modulus=1e4, pore=1e-4, viscosity=1e-3, length=1e-2), OutputUnits(stress="kPa", length="mm")
)
RADIUS = ParameterRange("radius", "cell.geometry.radius", 0.15, 0.3)
MODULUS = ParameterRange("c10", "cell.material.c10", 0.5, 2.0, "stress")
RELAXATION = Relaxation(branches=[{"strength": 0.5, "time": 3.0}])
#: Kept times of the column.
TIMES = (0.0, 1.0, 10.0, 100.0)


@pytest.fixture(scope="module")
def remembering(column):
    """A column of six elements with one branch, fixed charges, and two parameters that evolve, made up."""
    plain = column(elements=(1, 6, 1), times=TIMES[:3], beyond=None)
    e = len(plain.cells)
    y = plain.points[plain.cells[:, 26], 1] / 7.5
    profiles = []
    for k, profile in enumerate(plain.profiles):
        share = k / 3
        stress = np.zeros((e, 3, 3))
        stress[:, 1, 1] = -0.04 * (1 - share) * (k > 0)
        internal = {
            "radius": np.maximum(0.2 - 0.2 * share * y, 0.15),
            "c10": 1.0 + share * y,
            "overstress_1": stress,
            "overpressure_1": 0.01 * share + 0 * y,
            "pore_pressure": profile.element_p + 0.02 * (1 + y),
            "charge": np.full(e, 0.04),
        }
        profiles.append(replace(profile, internal=internal, cell_p=internal["pore_pressure"] - 0.01 * share))
    quantities = {
        "radius": "",
        "c10": "",
        "overstress_1": "stress",
        "overpressure_1": "pressure",
        "pore_pressure": "pressure",
        "charge": "concentration",
    }
    values = [np.stack([each.internal["radius"], each.internal["c10"]], axis=1) for each in profiles]
    cells = ElementCells(np.zeros(e, int), (), ("radius", "c10"), np.array(values))
    return replace(plain, profiles=tuple(profiles), element_cells=cells, quantities=quantities)


@pytest.fixture(scope="module")
def memory(remembering):
    return BodyMemory(remembering, ({"radius": RADIUS, "c10": MODULUS},), (RELAXATION,))


def test_figures_are_those_of_the_profiles(memory, remembering):
    found = memory.figures()
    (branch,) = found["relaxation"]
    assert (branch["strength"], branch["time"]) == ([0.5, 0.5], [3.0, 3.0])
    assert branch["overstress_largest"] == pytest.approx(0.04 * 2 / 3, rel=1e-12)
    assert (branch["time_of_largest_overstress"], branch["overstress_end"], branch["overstress_left"]) == (
        1,
        0,
        0,
    )
    assert (branch["overpressure_largest"], branch["overpressure_end"]) == (0.01, 0.01)
    charges, last = found["charges"], remembering.profiles[-1]
    assert charges["times"] == [*TIMES]
    y = remembering.points[remembering.cells[:, 26], 1] / 7.5
    low, mean, high = charges["osmotic_pressure"][-1]
    assert (low, mean, high) == pytest.approx((0.02 * (1 + y.min()), 0.03, 0.02 * (1 + y.max())), rel=1e-9)
    density = 0.04 / last.fluid_volume
    assert charges["fixed_charge_density"][-1] == pytest.approx(
        [density.min(), density.mean(), density.max()]
    )
    stretch = (1 + last.grad_u[:, 1, 1]) ** (1 / 3)
    assert charges["swelling_stretch"][-1] == pytest.approx([stretch.min(), stretch.mean(), stretch.max()])
    radius = found["evolution"]["radius"]
    assert (radius["at_first"], radius["at_end"]) == ([0.2, 0.2], [0.15, pytest.approx(0.2 - 0.2 * y.min())])
    assert (radius["share_at_lower_end"], radius["share_at_upper_end"]) == (pytest.approx(5 / 6), 0)
    assert radius["first_at_an_end"]["time"] == 1
    assert found["evolution"]["c10"]["first_at_an_end"] is None


def test_a_law_without_memory_has_no_figures(column):
    memory = BodyMemory(column(elements=(1, 4, 1)))
    assert memory.figures() == memory.courses() == memory_tables(memory) == {}
    assert memory_sentences(memory) == []


def test_metrics_have_units(memory):
    with using_units(UNITS):
        found = figures_with_units(figures_in_units(memory.figures(), memory, UNITS), UNITS)
    (branch,) = found["relaxation"]
    assert branch["overstress_largest"]["unit"] == "kPa"
    assert branch["overstress_largest"]["value"] == pytest.approx(10 * 0.04 * 2 / 3)
    assert branch["time"]["unit"] == "s"
    assert branch["overstress_left"] == 0
    density = found["charges"]["fixed_charge_density"]
    assert density["unit"] == "mol/m³"
    assert density["value"][0][0] == pytest.approx(density["dimensionless"][0][0] * 1e4 / 8.31446261815324)
    assert found["evolution"]["c10"]["at_first"] == {
        "value": [10.0, 10.0],
        "unit": "kPa",
        "dimensionless": [1.0, 1.0],
    }
    assert found["evolution"]["radius"]["at_first"] == [0.2, 0.2]


def test_the_memory_in_words(memory):
    with using_units(UNITS):
        relaxed, charged, radius, modulus = memory_sentences(memory)
    assert relaxed.startswith("The solid relaxes by one branch. ")
    assert "the largest overstress of a branch is 0.267 kPa at t = " in relaxed
    assert relaxed.endswith("less than 1 % of the overstress is left: the solid has relaxed.")
    assert "the osmotic pressure is 0.2167 to 0.3833 kPa at t = 0" in charged
    assert "The pore pressure is p = μ + π." in charged
    assert radius.startswith(
        "The parameter radius evolves: it is 0.2000 at first and 0.1500 to 0.1833 at the end."
    )
    assert "it stands at the lower end of its range in 83.3 % of the body" in radius
    assert "the first element at an end of the range is that at (0.500, " in radius
    assert modulus == "The parameter c10 evolves: it is 10.00 kPa at first and 10.83 to 19.17 kPa at the end."


def test_overstress_that_is_left_is_told(memory, remembering):
    last = remembering.profiles[-1]
    held = replace(
        last,
        internal=last.internal | {"overstress_1": 0.5 * remembering.profiles[1].internal["overstress_1"]},
    )
    solution = replace(remembering, profiles=(*remembering.profiles[:-1], held))
    said = memory_sentences(replace(memory, solution=solution))[0]
    assert said.endswith("At the end, the largest is 0.0133, 50.0 % of what was the largest of its branch.")
    grown = replace(last, internal=last.internal | {"overstress_1": last.stress})
    solution = replace(remembering, profiles=(*remembering.profiles[:-1], grown))
    assert memory_sentences(replace(memory, solution=solution))[0].endswith("is 0.200 at t = 100, the end.")
    still = [
        replace(each, internal=each.internal | {"overstress_1": 0 * each.internal["overstress_1"]})
        for each in remembering.profiles
    ]
    said = memory_sentences(replace(memory, solution=replace(remembering, profiles=tuple(still))))[0]
    assert said.endswith("there is no overstress.")


def test_tables_have_units_in_their_heads(memory):
    with using_units(UNITS):
        tables = memory_tables(memory)
    assert [*tables] == ["Overstress", "Fixed charges", "Parameters that evolve"]
    for heads, rows in tables.values():
        assert {len(row) for row in rows} == {len(heads)}
    heads, rows = tables["Fixed charges"]
    assert heads[1:] == [
        "osmotic pressure [kPa]",
        "fixed charge density [mol/m³]",
        "pore pressure [kPa]",
        "swelling stretch",
    ]
    assert rows[0][1] == "0.3000 (0.2167 to 0.3833)"
    _, rows = tables["Parameters that evolve"]
    assert rows[0] == ["radius", "0.1500 to 0.3000", "0.2000", "0.1500 to 0.1833", "83.3 %", "0.0 %"]
    assert rows[1][:2] == ["c10 [kPa]", "5.000 to 20.00"]


def test_a_region_has_the_range_of_its_cell(memory, remembering):
    """The parameter of the other cell may go farther, so that it does not stand at its end."""
    region = np.array([0, 0, 0, 1, 1, 1])
    cells = replace(remembering.element_cells, region=region, regions=("top",))
    wide = {"radius": replace(RADIUS, lower=0.1)}
    found = replace(
        memory, solution=replace(remembering, element_cells=cells), ranges=({"radius": RADIUS}, wide)
    )
    low = found.figures()["evolution"]["radius"]["share_at_lower_end"]
    assert low == pytest.approx(2 / 6)


def test_fields_over_time_and_along_the_column(memory, remembering):
    with using_units(UNITS):
        course = memory.courses()["osmotic_pressure"]
        figure = course_figure(memory, course)
        (axes,) = figure.axes
        assert axes.get_ylabel() == r"osmotic pressure $\pi$ [kPa]"
        (line,) = axes.get_lines()
        np.testing.assert_allclose(line.get_ydata(), 0.3, rtol=1e-9)
        np.testing.assert_allclose(line.get_xdata(), np.array(TIMES) * UNITS.factor("time"))
    field = profile_field(remembering, course)
    np.testing.assert_array_equal(
        field.take(remembering.profiles[2]), remembering.profiles[2].osmotic_pressure
    )


def test_the_pressure_of_a_charged_body_is_called_the_effective_one(remembering, column, tmp_path):
    plain = column(elements=(1, 4, 1))
    assert (plain.pressure, solution_metrics(plain)["pressure"]) == ("pore pressure", "pore pressure")
    assert field_of(plain, "p").label == "pore pressure $p$"
    assert solution_metrics(remembering)["pressure"] == "effective fluid pressure"
    assert field_of(remembering, "p").label == r"effective fluid pressure $\mu$"
    drawn = history_figure(remembering, None)
    assert any("largest effective\nfluid pressure" in axes.get_ylabel() for axes in drawn.axes)
    probed = replace(remembering, probes={"tip": np.ones((len(remembering.history.time), 4))})
    assert next(iter(panels(probed))).label == r"effective fluid pressure $\mu$"
    said = {each.name: each for each in all_series(probed)}
    assert said["pressure_max"].long_name == "largest effective fluid pressure"
    with open(write_series(tmp_path / "s.csv", probed, UNITS), encoding="utf-8") as file:
        heads = next(csv.reader(file))
    assert "pressure_max (effective fluid pressure) [kPa]" in heads
    assert "tip: p (effective fluid pressure) [kPa]" in heads
    with open(write_series(tmp_path / "p.csv", plain, UNITS), encoding="utf-8") as file:
        assert "pressure_max [kPa]" in next(csv.reader(file))


@pytest.fixture(scope="module")
def told(context, remembering) -> ReportContext:
    """The made-up report with the column that remembers."""
    rng = np.random.default_rng(1)
    inputs = InputSpace.from_ranges(
        {"p": (-0.02, 0.24), "H22": (-0.4, 0.04)}, {"radius": (0.15, 0.3), "c10": (0.5, 2)}
    )
    x = rng.uniform(inputs.lower, inputs.upper, (60, 4))
    status = np.full(60, int(Status.converged))
    points = np.array([[0.15, 0.3], [0.5, 2.0]])
    porosity = RestField("porosity", "porosity", "", np.array([0.4]), points, points, points)
    family = FamilySummary((RADIUS, MODULUS), np.array([[0.2, 1.0]]), points, (porosity,))
    body = BodyCells(
        remembering.element_cells,
        TIMES,
        volumes_of(remembering),
        np.eye(3) + np.zeros((len(remembering.cells), 3, 3)),
    )
    return replace(
        context,
        title="A column that remembers",
        sampling=replace(context.sampling, inputs=inputs, x=x, status=status, training=status == 1),
        cases=(LoadCase(remembering, None),),
        family=family,
        body=body,
        published=None,
        relaxations=(RELAXATION,),
        units=UNITS,
    )


def test_the_page_tells_the_memory(told, unpictured):
    assert told.ranges == ({"radius": RADIUS, "c10": MODULUS},)
    assert told.memory_of(told.cases[0].nonlinear).figures()["relaxation"][0]["strength"] == [0.5, 0.5]
    words = Page(render(told)).words
    for heading in ("Overstress", "Fixed charges", "Parameters that evolve"):
        assert heading in words
    assert words.index("The solid relaxes by one branch.") < words.index("Fixed charges")
    assert "the effective fluid pressure μ = p − π" in words
    assert "fixed charge density [mol/m³]" in words


def test_a_page_without_memory_does_not_tell_of_it(context, unpictured):
    words = Page(render(context)).words
    assert not any(
        each in words for each in ("remembers", "Overstress", "charge", "evolve", "effective fluid")
    )
