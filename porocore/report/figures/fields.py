"""Figures of the cells of a body: parameters, regions and material axes, along a column or in a middle section."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from porocore.core.units.results import ResultUnits, spoken
from porocore.interfaces.element_cells import ElementCells
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.section import Section, most_telling, sections
from porocore.report.figures.profiles import ColumnAxis, is_column
from porocore.report.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY,
    TIME_COLOURS,
    VERMILLION,
    axis_label,
    legend_above,
    lighter,
    named,
    new_figure,
    styled,
)
from porocore.report.words.body_cells import BodyCells
from porocore.states import Array

if TYPE_CHECKING:
    from porocore.report.page import Picture, Pictures

COLOURS = "viridis"
#: Colours of regions: the rest of the body first.
REGIONS = ["#e8e8e8", *(lighter(colour, 0.35) for colour in (SKY, ORANGE, GREEN, PURPLE, VERMILLION, BLUE))]
#: Colours of the three material axes.
AXES = (BLUE, VERMILLION, GREEN)
#: Lines of an axis along the longer side of a section, and their length as a share of their distance.
LINES, LENGTH = 14, 0.8
#: A field that varies by less than this share of its size is uniform, and is not drawn.
UNIFORM = 1e-9
#: Longest and shortest side of a section on the page [inches].
LONGEST, SHORTEST = 4.2, 1.1
#: Greatest width of one of two sections beside each other [inches].
BESIDE = 2.4


@styled
def field_along_column(
    line: ColumnAxis,
    values: Sequence[tuple[float, Array]],
    label: str,
    cells: ElementCells,
    units: ResultUnits,
) -> Figure:
    """Draw a field along a column at some times, element by element, over bands of the regions.

    ``values`` are times and values (elements,), one pair where the field does not change; ``label`` has the unit.
    """
    figure = new_figure(5.4, 3.4)
    axes = figure.add_subplot()
    length = units.factor("displacement")
    edges = np.append(line.ends[:, 0], line.ends[-1, 1]) * length
    _bands(axes, line, cells, length)
    for (time, field), colour in zip(values, TIME_COLOURS, strict=False):
        said = f"$t$ = {units.text(time, 'time', 6)}" if len(values) > 1 else None
        axes.stairs(field[line.elements], edges, baseline=None, color=colour, lw=1.8, label=said)
    axes.set_xlabel(axis_label("position along the column $X_2$", "displacement", units))
    axes.set_ylabel(label)
    axes.set_xlim(edges[0], edges[-1])
    axes.margins(y=0.08)
    if axes.get_legend_handles_labels()[1]:
        legend_above(figure, axes, columns=3)
    return figure


def _bands(axes: Any, line: ColumnAxis, cells: ElementCells, length: float) -> None:
    """Colour the regions along a column."""
    region, told = cells.region[line.elements], set[int]()
    for number, (low, high) in zip(region.tolist(), line.ends * length, strict=True):
        if number:
            label = None if number in told else cells.regions[number - 1]
            axes.axvspan(low, high, color=_colour(number), lw=0, zorder=0, label=label)
            told.add(number)


@styled
def field_in_section(
    among: Sequence[Section], values: Sequence[tuple[float, Array]], label: str, units: ResultUnits
) -> Figure:
    """Draw a field in the middle section in which it varies most, at some times side by side.

    ``values`` and ``label`` are as in :func:`field_along_column`.
    """
    section = most_telling(among, np.stack([field for _, field in values], axis=1))
    figure, panels = _panels(section, len(values))
    inside = section.element[section.element >= 0]
    shown = np.concatenate([field[inside] for _, field in values])
    norm = Normalize(float(np.nanmin(shown)), float(np.nanmax(shown)))
    for axes, (time, field) in zip(panels, values, strict=True):
        _image(axes, section, section.image(field), units, norm=norm, cmap=COLOURS)
        if len(values) > 1:
            axes.set_title(f"$t$ = {units.text(time, 'time', 6)}")
    figure.colorbar(ScalarMappable(norm, COLOURS), ax=list(panels), label=label, shrink=0.8)
    _labels(panels, section, units)
    return figure


@styled
def regions_in_section(among: Sequence[Section], cells: ElementCells, units: ResultUnits) -> Figure:
    """Draw the regions in the middle section in which most of them are, with their names."""
    present = [np.unique(cells.region[each.element[each.element >= 0]]) for each in among]
    best = max(range(len(among)), key=lambda i: (len(present[i]), -i))
    section = among[best]
    figure, (axes,) = _panels(section, 1)
    count = len(cells.regions) + 1
    colours = ListedColormap([_colour(number) for number in range(count)])
    _image(axes, section, section.image(cells.region), units, norm=Normalize(-0.5, count - 0.5), cmap=colours)
    names = ["elsewhere", *map(named, cells.regions)]
    figure.legend(
        handles=[Patch(fc=_colour(k), ec=GREY, lw=0.6, label=names[k]) for k in present[best]],
        loc="outside upper left",
        ncols=4,
        handlelength=1.2,
        columnspacing=1.3,
    )
    _labels([axes], section, units)
    return figure


@styled
def axes_in_section(
    among: Sequence[Section], axes_of: Array, cells: ElementCells, units: ResultUnits
) -> Figure:
    """Draw the material axes (elements, 3, 3) as lines in the middle section in which they vary most, over the regions.

    A line is the projection of an axis onto the section: one across it is a dot.
    """
    section = most_telling(among, lambda each: axes_of[:, list(each.sides)])
    figure, (axes,) = _panels(section, 1)
    count = len(cells.regions) + 1
    colours = ListedColormap([lighter(_colour(number), 0.5) for number in range(count)])
    _image(axes, section, section.image(cells.region), units, norm=Normalize(-0.5, count - 0.5), cmap=colours)
    right, up = section.places()
    step = max(1, round(max(len(right), len(up)) / LINES))
    rows, columns = (
        found.ravel()
        for found in np.meshgrid(
            np.arange(step // 2, len(up), step), np.arange(step // 2, len(right), step), indexing="ij"
        )
    )
    element = section.element[rows, columns]
    rows, columns, element = (each[element >= 0] for each in (rows, columns, element))
    length = units.factor("displacement")
    distance = step * max(np.ptp(right) / max(len(right) - 1, 1), np.ptp(up) / max(len(up) - 1, 1)) * length
    places = np.stack([right[columns], up[rows]], axis=1) * length
    for k, colour in enumerate(AXES):
        along = axes_of[element][:, list(section.sides), k]
        ends = places[:, None, :] + LENGTH * distance / 2 * along[:, None, :] * np.array([-1, 1])[:, None]
        for first, last in ends:
            axes.plot(*np.stack([first, last]).T, color=colour, lw=1.4, solid_capstyle="round")
        axes.plot(*places[np.linalg.norm(along, axis=1) < 0.15].T, "o", ms=2.2, color=colour, mew=0)
        axes.plot([], [], color=colour, lw=1.6, label=f"axis {k + 1}")
    legend_above(figure, axes, columns=3)
    _labels([axes], section, units)
    return figure


@styled
def axes_along_column(line: ColumnAxis, axes_of: Array, cells: ElementCells, units: ResultUnits) -> Figure:
    """Draw the components of the first two of the material axes (elements, 3, 3) along a column."""
    figure = new_figure(5.4, 4.4)
    panels = figure.subplots(2, 1, sharex=True)
    length = units.factor("displacement")
    edges = np.append(line.ends[:, 0], line.ends[-1, 1]) * length
    for k, panel in enumerate(panels):
        _bands(panel, line, cells, length)
        for i, colour in enumerate(AXES):
            panel.stairs(
                axes_of[line.elements, i, k],
                edges,
                baseline=None,
                color=colour,
                lw=1.8,
                label=f"along $X_{i + 1}$",
            )
        panel.set_ylabel(f"material axis {k + 1} [–]")
        panel.set_ylim(-1.1, 1.1)
        panel.set_xlim(edges[0], edges[-1])
    panels[-1].set_xlabel(axis_label("position along the column $X_2$", "displacement", units))
    legend_above(figure, panels[0], columns=3)
    return figure


def _panels(section: Section, count: int) -> tuple[Figure, Sequence[Any]]:
    """Return a figure with panels that have the shape of the section, and these."""
    lengths = section.ends[:, 1] - section.ends[:, 0]
    width, height = np.clip(LONGEST * lengths / lengths.max(), SHORTEST, LONGEST)
    if count > 1 and width > BESIDE:
        width, height = BESIDE, max(BESIDE / width * height, SHORTEST)
    figure = new_figure(min(count * (width + 0.5) + 1.7, 7.2), height + 1.1)
    panels = figure.subplots(1, count, squeeze=False)[0]
    for axes in panels:
        axes.set_aspect("equal")
        axes.grid(visible=False)
    return figure, panels


def _image(axes: Any, section: Section, image: Array, units: ResultUnits, **how: Any) -> None:
    length = units.factor("displacement")
    (left, right), (bottom, top) = section.ends * length
    axes.imshow(
        image,
        origin="lower",
        extent=(left, right, bottom, top),
        interpolation="nearest",
        aspect="equal",
        **how,
    )
    axes.autoscale(enable=False)


def _labels(panels: Sequence[Any], section: Section, units: ResultUnits) -> None:
    """Name the sides of a section, and where it is."""
    names = [f"$X_{axis + 1}$" for axis in section.sides]
    texts = [axis_label(name, "displacement", units) if units.given else name for name in names]
    for axes in panels:
        axes.set_xlabel(texts[0])
    panels[0].set_ylabel(texts[1])
    at = units.text(section.at, "displacement", 3)
    panels[0].annotate(
        f"$X_{section.across + 1}$ = {at}", (0.0, 0.0), (0, -34), "axes fraction", "offset points",
        fontsize=8, color=BLACK, va="top",
    )  # fmt: skip


def _uniform(values: Array) -> bool:
    """Return whether values that are known are the same up to round-off."""
    known = values[np.isfinite(values)]
    return not len(known) or float(np.ptp(known)) <= UNIFORM * float(np.abs(known).max())


def _colour(number: int) -> Any:
    """Return the colour of a region by its number; 0 is the rest of the body."""
    return REGIONS[0] if number == 0 else REGIONS[1 + (number - 1) % (len(REGIONS) - 1)]


def body_fields(solution: MacroSolution, body: BodyCells, pictures: Pictures) -> list[Picture]:
    """Return the pictures of a body of many cells: regions, parameters, porosity and K at rest, material axes."""
    units, cells = spoken(), body.cells
    column = is_column(solution)
    line = ColumnAxis.from_solution(solution) if column else None
    among = () if column else sections(solution.points, solution.cells)
    where = "along the column" if column else "in a middle section"

    def field(name: str, values: Sequence[tuple[float, Array]], label: str) -> Picture:
        text = f"{name} {where}"
        if line is not None:
            return pictures.svg(f"body_{name}", field_along_column(line, values, label, cells, units), text)
        return pictures.png(f"body_{name}", field_in_section(among, values, label, units), text)

    found: list[Picture] = []
    if cells.regions and line is None:
        drawn = regions_in_section(among, cells, units)
        found.append(pictures.png("body_regions", drawn, f"Regions of the body {where}"))
    shown = [
        (name, body.field(name), named(name), body.quantities.get(name, "")) for name in cells.parameters
    ]
    if body.porosity is not None:
        shown.append(("porosity", [(0.0, body.porosity)], r"porosity at rest $\varphi_f$", ""))
    K = body.conductivity[:, 1, 1]
    shown.append(("conductivity", [(0.0, K)], "conductivity at rest $K_{22}$", "conductivity"))
    found += [
        field(
            name,
            [(time, at * units.factor(quantity)) for time, at in values],
            axis_label(label, quantity, units),
        )
        for name, values, label, quantity in shown
        if not _uniform(np.concatenate([at for _, at in values]))
    ]
    last = cells.axes_at(body.shown[-1])
    if last is not None:
        drawn = (
            axes_along_column(line, last, cells, units)
            if line is not None
            else axes_in_section(among, last, cells, units)
        )
        found.append(pictures.png("body_axes", drawn, f"Material axes {where}"))
    return found
