"""The report of a family of cells and of a body of many cells: figures over parameters, fields, tables, sentences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from porocore.cell.cell import Cell
from porocore.core.inputs import InputSpace
from porocore.core.units import OutputUnits, ResultUnits, Scales, using_units
from porocore.interfaces.cell import ElementCells
from porocore.macro.body.kinds import sections
from porocore.report.context import SamplingSummary
from porocore.report.figures.body import (
    axes_along_column,
    axes_in_section,
    body_fields,
    field_along_column,
    field_in_section,
    regions_in_section,
)
from porocore.report.figures.cell import error_figure, rest_figure, spread_figure
from porocore.report.figures.curves import ColumnAxis
from porocore.report.figures.sampling import samples_of
from porocore.report.html import render
from porocore.report.metrics import LoadCase
from porocore.report.words.cell import conductivity_sentence
from porocore.report.words.held_out import OutputCheck
from porocore.report.words.parameters import (
    BodyCells,
    FamilySummary,
    ParameterRange,
    RestField,
    binned_rms,
    family_figures,
    group_errors,
    parameter_rows,
    region_rows,
    volumes_of,
)
from porocore.report.words.results import visited_shares
from porocore.states import Status
from porocore.study.notes.parameters import parameter_ranges
from tests.helpers.report_page import Page

RADIUS = ParameterRange("radius", "cell.geometry.radius", 0.1, 0.3)
MODULUS = ParameterRange("c10", "cell.material.c10", 0.5, 2.0, "stress")
UNITS = ResultUnits(
    Scales(modulus=1e4, pore=1e-4, viscosity=1e-3, length=1e-2), OutputUnits(stress="kPa", length="mm")
)


@pytest.fixture(scope="module")
def solution(column):
    """A column of 4 × 6 × 4 elements with an inclusion, whose pores grow upwards in time, and whose axes turn."""
    plain = column(elements=(4, 6, 4))
    x, y, _ = plain.points[plain.cells[:, :8]].mean(axis=1).T
    count, e = len(plain.profiles), len(y)
    share = np.linspace(0, 1, count)[:, None]
    values = np.stack([0.15 + 0.1 * share * y / y.max(), np.full((count, e), 1.0)], axis=2)
    values[:, :, 1] += y > 5
    axes = Rotation.from_rotvec(np.outer(x / x.max(), [0, 0, 1.0])).as_matrix()[None]
    region = np.where(np.abs(y - 3.75) < 1, 1, 0)
    return replace(plain, element_cells=ElementCells(region, ("inclusion",), ("radius", "c10"), values, axes))


@pytest.fixture(scope="module")
def body(solution):
    K = 2.0 * np.broadcast_to(np.eye(3), (len(solution.cells), 3, 3))
    porosity = np.linspace(0.2, 0.3, len(solution.cells))
    times = tuple(profile.time for profile in solution.profiles)
    cells = solution.element_cells
    return BodyCells(cells, times, volumes_of(solution), K, porosity, {"radius": "", "c10": "stress"})


@pytest.fixture(scope="module")
def upright(column):
    """A column of single elements."""
    plain = column(elements=(1, 6, 1))
    values = np.linspace(0.15, 0.25, 6)[None, :, None]
    axes = Rotation.from_rotvec(np.outer(np.linspace(0, 1, 6), [0, 0, 1.0])).as_matrix()[None]
    region = np.array([1, 1, 0, 0, 0, 2])
    return replace(plain, element_cells=ElementCells(region, ("deep", "crust"), ("radius",), values, axes))


@pytest.fixture(scope="module")
def family():
    points = np.stack([np.linspace(p.lower, p.upper, 5) for p in (RADIUS, MODULUS)])
    members = np.array([[0.12, 0.6], [0.2, 1.0], [0.28, 1.9]])

    def stiffness(r, c):
        return c * (1 - 2 * r)

    curves = np.stack([stiffness(points[0], 1.25), stiffness(0.2, points[1])])
    low = np.stack([stiffness(points[0], 0.5), stiffness(0.3, points[1])])
    high = np.stack([stiffness(points[0], 2.0), stiffness(0.1, points[1])])
    field = RestField("stiffness", "stiffness", "stress", stiffness(*members.T), curves, low, high)
    porosity = RestField("porosity", "porosity", "", members[:, 0], points, points, points)
    return FamilySummary((RADIUS, MODULUS), members, points, (porosity, field), failed=1)


def check(plain="P_E,22", error=1e-3, span=0.1, outside=None):
    theta = np.column_stack([np.linspace(0.1, 0.3, 9), np.linspace(2.0, 0.5, 9)])
    solved = np.linspace(0, 1, 9)
    beyond = np.zeros(9, bool) if outside is None else outside
    return OutputCheck(plain, plain, solved, solved + error * np.arange(9), span, beyond, parameters=theta)


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def labels(figure):
    return [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel()) if text]


def test_the_undeformed_cell_over_a_parameter_has_units_members_and_a_band(family):
    with using_units(UNITS):
        figure = rest_figure(family, 1)
    _, stiffness = figure.axes[:2]
    factor = UNITS.factor("stress")
    line, dots = stiffness.get_lines()
    np.testing.assert_allclose(line.get_xdata(), family.points[1] * factor)
    np.testing.assert_allclose(line.get_ydata(), family.fields[1].curves[1] * factor)
    np.testing.assert_allclose(dots.get_xdata(), family.members[:, 1] * factor)
    band = stiffness.collections[0].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == pytest.approx((0.5 * 0.4 * factor, 2.0 * 0.8 * factor))
    assert labels(figure)[-2:] == ["c10 [kPa]", "stiffness\n[kPa]"]
    assert legend(figure) == ["others anywhere in their ranges", "surrogate, others in the middle", "solved"]
    alone = replace(
        family,
        parameters=family.parameters[:1],
        members=family.members[:, :1],
        points=family.points[:1],
    )
    assert legend(rest_figure(alone, 0)) == ["surrogate", "solved"]


def test_members_are_not_drawn_over_a_parameter_that_they_do_not_have(family):
    """The members of a swelling solid are dry, and made an exact surrogate look wrong by a fifth."""
    dry = replace(family, parameters=(RADIUS, replace(MODULUS, solved=False)))
    assert "solved" in legend(rest_figure(dry, 0))
    assert "solved" not in legend(rest_figure(dry, 1))


@pytest.mark.parametrize(
    ("material", "solved"),
    [
        ({"poisson_ratio": 0.3, "swelling": {"range": [0.98, 1.05]}}, {"radius": True, "swelling": False}),
        ({"poisson_ratio": 0.3, "swelling": 1.04}, {"radius": False}),
        ({"poisson_ratio": {"range": [0.2, 0.4]}}, {"radius": True, "poisson_ratio": True}),
    ],
)
def test_members_are_solved_before_the_solid_swells(material, solved):
    cell = Cell.model_validate(
        {
            "geometry": {"kind": "orthogonal-channels", "radius": {"range": [0.2, 0.3]}},
            "material": {"kind": "neo-hookean", **material},
        }
    )
    assert {each.name: each.solved for each in parameter_ranges(cell)} == solved


def test_errors_are_grouped_by_output_and_binned():
    beyond = np.arange(9) == 8
    groups = group_errors(
        [check(outside=beyond), check("P_E,11", 3e-3, 0.05, beyond), check("fluid volume φ")]
    )
    assert [group.plain for group in groups] == ["P_E", "fluid volume φ"]
    # The largest component, over the span of the one that varies most; what lies beyond the range is left out.
    np.testing.assert_allclose(groups[0].percent, 100 * 3e-3 * np.arange(8) / 0.1, rtol=1e-12)
    assert len(groups[1].percent) == 9
    rms = binned_rms(np.array([0.0, 0.1, 0.9, 1.0]), np.array([3.0, 4.0, 1.0, 1.0]), np.linspace(0, 1, 4))
    np.testing.assert_allclose(rms, [np.sqrt(12.5), np.nan, 1.0])
    assert group_errors([replace(check(), parameters=None)]) == []
    figure = error_figure(RADIUS, 0, groups)
    assert len(figure.axes) == 2
    np.testing.assert_allclose(figure.axes[0].get_lines()[0].get_xdata(), groups[0].parameters[:, 0])
    assert figure.axes[0].get_xlim() == (0.1, pytest.approx(0.3))
    assert labels(figure)[0] == "error of $P_E$\n[% of range]"
    # Whole decades, so that each panel has two numbers at least.
    low, high = figure.axes[0].get_ylim()
    assert np.log10([low, high]) == pytest.approx(np.round(np.log10([low, high])))
    assert high / low >= 10 - 1e-9


def test_states_over_a_parameter_stand_beside_the_body():
    x = np.linspace(0.1, 0.3, 16)
    training = np.arange(16) < 12
    values, volumes = np.array([0.11, 0.29]), np.array([1.0, 3.0])
    axes = spread_figure(RADIUS, x, training, (values, volumes)).axes[0]
    heights = np.array([bar.get_height() for bar in axes.patches if hasattr(bar, "get_height")])
    assert heights.sum() == pytest.approx(100)
    shares = next(patch for patch in axes.patches if hasattr(patch, "get_data")).get_data().values
    assert (shares[0], shares[-1]) == pytest.approx((25, 75))
    assert "without use" not in legend(spread_figure(RADIUS, x, np.ones(16, bool)))


def test_rows_and_figures_of_parameters(family):
    used = {"radius": (0.15, 0.25), "c10": (1.0, 1.0)}
    with using_units(UNITS):
        rows = parameter_rows(family, used)
    assert rows[0] == ("radius", "cell.geometry.radius", "0.1000 to 0.3000", "0.1500 to 0.2500")
    assert rows[1] == ("c10 [kPa]", "cell.material.c10", "5.000 to 20.00", "10.00")
    (found, _) = family_figures(family, group_errors([check()]), used)
    assert (found["range"], found["in_body"]) == ([0.1, 0.3], [0.15, 0.25])
    off = {"radius": (0.9999999999999998, 1.0400000000000003)}
    assert family_figures(family, [], off)[0]["in_body"] == [1.0, 1.04]
    thirds = found["rms_error_percent_by_third"]["P_E"]
    expected = [100 * 1e-3 / 0.1 * np.sqrt(np.mean(np.arange(3 * k, 3 * k + 3) ** 2)) for k in range(3)]
    np.testing.assert_allclose(thirds, expected, rtol=1e-12)
    theta = group_errors([check()])[0].parameters[:, 0]
    assert found["held_out_members_by_third"] == [
        len({r for r in theta if low <= r < high}) for low, high in ((0, 1 / 6), (1 / 6, 7 / 30), (7 / 30, 1))
    ]
    shared = replace(check(), parameters=np.full((9, 2), 0.12))
    assert family_figures(family, group_errors([shared]), used)[0]["held_out_members_by_third"] == [1, 0, 0]
    assert family_figures(family, [], off)[0]["held_out_members_by_third"] == [0, 0, 0]


def test_regions_are_told_with_their_share_and_what_they_hold(body):
    with using_units(UNITS):
        heads, rows = region_rows(body)
    assert heads[:4] == ["region", "share of the volume", "radius", "c10 [kPa]"]
    assert heads[4] == "porosity at t = 0"
    assert [row[:2] for row in rows] == [["elsewhere", "66.7 %"], ["inclusion", "33.3 %"]]
    assert rows[0][3] == "10.00 to 20.00"
    assert rows[1][3] == "10.00"
    assert body.used()["c10"] == (1.0, 2.0)
    values, volumes = body.over("c10")
    # The upper third at all four kept times.
    share = volumes[values == 2].sum() / volumes.sum()
    assert share == pytest.approx(1 / 3)
    assert [time for time, _ in body.field("radius")] == [body.times[0], body.times[-1]]
    assert len(body.field("c10")) == 1
    named = replace(body, cell_names=("sand", "clay"))
    assert [row[1] for row in region_rows(named)[1]] == ["sand", "clay"]


def test_fields_along_a_column_have_regions_and_steps(upright):
    line, cells = ColumnAxis.from_solution(upright), upright.element_cells
    figure = field_along_column(line, [(0.0, cells.field("radius", 0))], "radius [–]", cells)
    (axes,) = figure.axes
    steps = next(patch for patch in axes.patches if hasattr(patch, "get_data")).get_data()
    np.testing.assert_allclose(steps.values, np.linspace(0.15, 0.25, 6))
    np.testing.assert_allclose(steps.edges, np.linspace(0, 7.5, 7))
    assert legend(figure) == ["deep", "crust"]
    both = [(0.0, cells.field("radius", 0)), (3.0, 2 * cells.field("radius", 0))]
    assert legend(field_along_column(line, both, "radius", cells))[2:] == ["$t$ = 0", "$t$ = 3"]
    turned = axes_along_column(line, cells.axes_at(0), cells)
    first = [p.get_data().values for p in turned.axes[0].patches if hasattr(p, "get_data")]
    np.testing.assert_allclose(first[0], np.cos(np.linspace(0, 1, 6)))
    np.testing.assert_allclose(first[1], np.sin(np.linspace(0, 1, 6)))


def test_fields_in_a_section_have_a_common_scale_and_units(solution, body):
    among, cells = sections(solution.points, solution.cells), body.cells
    with using_units(UNITS):
        figure = field_in_section(among, body.field("radius"), "radius [–]")
    first, last, bar = figure.axes
    images = [axes.get_images()[0] for axes in (first, last)]
    assert images[0].get_clim() == images[1].get_clim() == (0.15, pytest.approx(0.25))
    assert first.get_xlabel() in ("$X_1$ [mm]", "$X_3$ [mm]")
    assert (first.get_ylabel(), bar.get_ylabel()) == ("$X_2$ [mm]", "radius [–]")
    assert first.get_ylim() == pytest.approx((0, 75))
    regions = regions_in_section(among, cells)
    assert legend(regions) == ["elsewhere", "inclusion"]
    shown = regions.axes[0].get_images()[0].get_array()
    assert set(np.unique(shown).tolist()) == {0.0, 1.0}
    lines = axes_in_section(among, cells.axes_at(0), cells)
    assert legend(lines) == ["axis 1", "axis 2", "axis 3"]
    # A turn about y is seen from above.
    turned = Rotation.from_rotvec(np.outer(np.linspace(0, 0.6, len(cells.region)), [0, 1.0, 0])).as_matrix()
    seen = axes_in_section(among, turned, cells).axes[0]
    assert (seen.get_xlabel(), seen.get_ylabel()) == ("$X_1$", "$X_3$")


def test_the_page_has_the_cell_over_its_parameters_and_the_cells_of_the_body(context, solution, body, family):
    inputs = InputSpace.from_ranges(
        {"H22": (-0.4, 0.04), "p": (-0.02, 0.24)}, {"radius": (0.1, 0.3), "c10": (0.5, 2)}
    )
    inputs = replace(inputs, used=((0.15, 1.0), (0.2, 1.0), (0.25, 2.0)))
    x = np.random.default_rng(0).uniform(inputs.lower, inputs.upper, (40, 4))
    status = np.full(40, int(Status.converged))
    sampling = SamplingSummary(inputs, x, status, status == Status.converged)
    surrogate = replace(context.surrogate, outputs=(check(),))
    case = LoadCase(solution, None)
    made = replace(
        context, sampling=sampling, surrogate=surrogate, cases=(case,), family=family, body=body,
        cell=replace(context.cell, which="in the middle of the ranges"), published=None,
    )  # fmt: skip
    page = Page(render(made))
    for said in (
        "undeformed cell, in the middle of the ranges",
        "The undeformed cell was solved for 3 members; for 1 more it has no solution",
        "cell.material.c10",
        "Cells of the body",
        "and values of its parameters",
        "only at values of the parameters that occur in the body",
    ):
        assert said in page.words
    pictures = [image["alt"] for image in page.all("img")]
    for text in (
        "The undeformed cell over radius",
        "Errors on held-out states over c10, of 9 members",
        "Solved states over radius",
        "Regions of the body in a middle section",
        "radius in a middle section",
        "porosity in a middle section",
        "Material axes in a middle section",
    ):
        assert text in pictures
    # K is the same everywhere.
    assert "conductivity in a middle section" not in pictures
    assert "radius from 0.10 to 0.30" in samples_of(made).axes[0].get_xlabel()
    assert len(visited_shares(solution, sampling)) == len(solution.profiles)


def test_k_is_compared_with_the_cell_of_its_own_place(context, solution, body):
    last = solution.profiles[-1].reference_conductivity
    case = LoadCase(solution, None)
    assert "Compared with the cell of its own place at t = 0, K_ref,22 is unchanged" in conductivity_sentence(
        case, context.cell, replace(body, conductivity=last)
    )
    said = conductivity_sentence(case, context.cell, replace(body, conductivity=2 * last))
    assert "K_ref,22 is lowered." in said
    assert "In the undeformed cells at t = 0, both are" in said


def test_fields_of_the_body_are_drawn_in_the_units_of_their_labels(solution, body):
    """The colour bar ends at the values of the table of regions."""
    drawn = {}

    class Kept:
        def png(self, name, figure, text):
            drawn[name] = figure.axes[-1]
            return text

    spread = np.linspace(1.0, 3.0, len(body.conductivity))[:, None, None] * np.eye(3)
    with using_units(UNITS):
        body_fields(solution, replace(body, conductivity=spread), Kept())
    modulus, conductivity = (drawn[f"body_{name}"] for name in ("c10", "conductivity"))
    assert modulus.get_ylim() == pytest.approx((10.0, 20.0))  # 1 and 2 of 10 kPa
    assert "kPa" in modulus.get_ylabel()
    factor = UNITS.factor("conductivity")
    assert factor != 1
    shown = np.array(conductivity.get_ylim()) / factor
    assert 1 <= shown[0] < shown[1] <= 3
    assert drawn["body_radius"].get_ylim() == pytest.approx((0.15, 0.25), abs=0.02)


def test_fields_along_a_column_are_drawn_in_the_units_of_their_labels(upright):
    """A K without its unit stood at an axis with one."""
    drawn = {}

    class Kept:
        def svg(self, name, figure, text):
            drawn[name] = figure.axes[0]
            return text

        png = svg

    K = np.linspace(1.0, 3.0, 6)[:, None, None] * np.eye(3)
    times = tuple(profile.time for profile in upright.profiles)
    cells = BodyCells(upright.element_cells, times, volumes_of(upright), K, np.linspace(0.2, 0.3, 6))
    with using_units(UNITS):
        body_fields(upright, cells, Kept())
    for name, quantity, ends in (("conductivity", "conductivity", (1, 3)), ("porosity", "", (0.2, 0.3))):
        axes = drawn[f"body_{name}"]
        (steps,) = [patch.get_data().values for patch in axes.patches if hasattr(patch, "get_data")]
        np.testing.assert_allclose(steps[[0, -1]], np.array(ends) * UNITS.factor(quantity))
        assert f"[{UNITS.name(quantity)}]" in axes.get_ylabel()
