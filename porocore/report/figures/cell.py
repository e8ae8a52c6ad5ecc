"""Picture of the cell's solid, and figures over the parameters of a cell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D

from porocore.cell.level_sets.grey_values import GreyValues, Parting
from porocore.cell.meshing.tetrahedra import boundary_facets
from porocore.core.units import units_now
from porocore.report.figures import style
from porocore.report.figures.body import pieces, towards
from porocore.report.figures.style import axis_label, legend_above, lighter, named, new_figure, styled
from porocore.report.words.parameters import (
    FamilySummary,
    GroupErrors,
    ParameterRange,
    binned_rms,
    group_errors,
)
from porocore.states import Array, BoolArray, IntArray

if TYPE_CHECKING:
    from porocore.report.context import ReportContext
    from porocore.report.page import Picture, Pictures


#: Pieces of each edge of a curved facet.
PIECES = 4
SOLID = to_rgb("#c9a27a")
WALL = to_rgb("#5b8db8")
#: Intervals of a histogram of grey values.
GREY_BINS = 128
#: Height and azimuth of the viewer in degrees.
VIEW = (24.0, -58.0)
#: Of a cube; a longer box is drawn smaller.
ZOOM = 1.1
#: Towards the light, in the frame of the picture.
LIGHT = np.array([0.25, -0.75, 0.9])


@styled
def cell_picture(points: Array, cells: IntArray) -> Figure:
    """Draw the surface of a tetrahedral mesh, shaded: faces of its box in one colour, pore surface in another.

    Parameters
    ----------
    points : (N, 3)
        Nodes.
    cells : (M, 4) or (M, 10)
        Linear or quadratic tetrahedra in VTK order, positively oriented.
    """
    triangles = surface_triangles(points, cells)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1).clip(1e-300)[:, None]
    seen = normals @ towards(*VIEW) > 0  # the back of a facet is hidden by solid in front of it
    triangles, normals = triangles[seen], normals[seen]
    figure = new_figure(4.2, 4.2)
    axes = figure.add_subplot(projection="3d", proj_type="ortho", computed_zorder=False)
    assert isinstance(axes, Axes3D)
    bright = 0.5 + 0.5 * (normals @ (LIGHT / np.linalg.norm(LIGHT))).clip(0, 1)
    face = _on_box(triangles, points)
    # A face of the box that the viewer sees has nothing in front of it, so the walls are painted first.
    for rows, colour, level in ((~face, WALL, 1), (face, SOLID, 2)):
        colours = np.array(colour) * bright[rows, None]
        axes.add_collection3d(
            Poly3DCollection(
                triangles[rows],
                facecolors=colours,
                edgecolors=colours,
                linewidths=0.3,
                zorder=level,
                rasterized=True,
            )
        )
    low, high = points.min(axis=0), points.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(tuple(high - low), zoom=ZOOM * min(1.0, _extent(np.ones(3)) / _extent(high - low)))
    axes.view_init(*VIEW)
    axes.set_axis_off()
    return figure


def surface_triangles(points: Array, cells: IntArray) -> Array:
    """Return triangles (k, 3, 3) of the surface, outward; curved ones in pieces."""
    facets = points[boundary_facets(cells)]
    if cells.shape[1] == 4:
        return facets
    values, triangles, _ = pieces(facets.shape[1], PIECES)
    places: Array = np.einsum("pa,kax->kpx", values, facets)
    return places[:, triangles].reshape(-1, 3, 3)


def _extent(edges: Array) -> float:
    """Return the larger of width and height of a box in the picture, over its diagonal."""
    azimuth = np.radians(VIEW[1])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    up = np.cross(towards(*VIEW), right)
    return float(max(np.abs(right) @ edges, np.abs(up) @ edges) / np.linalg.norm(edges))


def _on_box(triangles: Array, points: Array) -> npt.NDArray[np.bool_]:
    """Return the triangles (k,) bool that lie in a face of the bounding box."""
    low, high = points.min(axis=0), points.max(axis=0)
    slack = 1e-6 * float((high - low).max())
    flat = (np.abs(triangles - low) < slack).all(axis=1) | (np.abs(triangles - high) < slack).all(axis=1)
    on_box: npt.NDArray[np.bool_] = flat.any(axis=1)
    return on_box


#: Bins of errors, and of states, over the range of a parameter.
ERROR_BINS, STATE_BINS = 6, 8
#: Errors below this share of the largest shown one stand at the lower edge [% of % ].
LEAST_ERROR = 1e-5


@styled
def histogram_figure(parting: Parting) -> Figure:
    """Draw how many voxels have which grey value, coloured by phase, with the threshold as a line."""
    edges, counts, dark = _bins(parting.grey, parting.threshold)
    figure = new_figure(5.4, 3.0)
    axes = figure.add_subplot()
    below = np.arange(len(counts)) < dark
    phases: list[tuple[str, BoolArray, Any]] = [("all voxels", np.full(len(counts), True), style.GREY)]
    if parting.bright_pores is not None:
        share = 100 * parting.grey.share(parting.threshold)
        share = 100 - share if parting.bright_pores else share
        pores = ~below if parting.bright_pores else below
        phases = [(f"pores, {share:.3g} %", pores, WALL), (f"solid, {100 - share:.3g} %", ~pores, SOLID)]
    for label, rows, colour in phases:
        axes.stairs(np.where(rows, counts, 0), edges, fill=True, color=colour, label=label)
    axes.axvline(
        parting.threshold,
        color=style.BLACK,
        ls=style.DASHED,
        lw=1.2,
        label=f"threshold {parting.threshold:.6g} ({parting.name})",
    )
    axes.set_xlim(edges[0], edges[-1])
    axes.set_xlabel("grey value")
    axes.set_ylabel("voxels")
    legend_above(figure, axes, columns=3)
    return figure


def _bins(grey: GreyValues, threshold: float) -> tuple[Array, IntArray, int]:
    """Return the edges of at most about ``GREY_BINS`` equal intervals, their counts, and how many a threshold is above.

    Values at equal distances have equally many in each interval, which else would look like a comb.
    """
    low, high = min(grey.values[0], threshold), max(grey.values[-1], threshold)
    width = (high - low) / GREY_BINS
    step = np.diff(grey.values).min(initial=np.inf)
    multiples = np.diff(grey.values) / step
    if np.abs(multiples - np.rint(multiples)).max(initial=0.0) < 1e-3:
        width = step * np.ceil(width / step)
        # Between two values.
        threshold = grey.values[0] + step * (np.floor((threshold - grey.values[0]) / step + 1e-6) + 0.5)
    before, behind = np.ceil((threshold - low) / width + 0.5), np.ceil((high - threshold) / width + 0.5)
    edges = threshold + width * np.arange(-before, behind + 1)
    places = np.searchsorted(edges, grey.values, side="left") - 1
    return edges, np.bincount(places, grey.counts, len(edges) - 1).astype(np.int64), int(before)


@styled
def rest_figure(family: FamilySummary, k: int) -> Figure:
    """Draw the properties of the undeformed cell over one parameter.

    The line is the surrogate with the other parameters in the middle of their ranges, the band with these anywhere in
    them, the dots are the solved members, over a parameter for which these can be compared.
    """
    parameter, units = family.parameters[k], units_now()
    rows = (len(family.fields) + 1) // 2
    figure = new_figure(6.6, 0.6 + 2.3 * rows)
    panels = figure.subplots(rows, 2, sharex=True, squeeze=False)
    factor = units.factor(parameter.quantity)
    x, members = family.points[k] * factor, family.members[:, k] * factor
    alone = len(family.parameters) == 1
    for axes, field in zip(panels.ravel(), family.fields, strict=False):
        by = units.factor(field.quantity)
        if not alone:
            axes.fill_between(
                x, field.low[k] * by, field.high[k] * by, color=lighter(style.SKY, 0.55), lw=0,
                label="others anywhere in their ranges",
            )  # fmt: skip
        middle = "surrogate" if alone else "surrogate, others in the middle"
        axes.plot(x, field.curves[k] * by, color=style.BLUE, label=middle)
        if parameter.solved:
            axes.plot(
                members,
                field.members * by,
                "o",
                ms=3,
                mfc="white",
                mec=style.VERMILLION,
                mew=1.0,
                label="solved",
            )
        # On two lines, since the longest is longer than its panel.
        axes.set_ylabel(axis_label(field.label, field.quantity).replace(" [", "\n["))
        axes.set_ylim(bottom=min(0.0, float(np.nanmin(field.low[k])) * by))
    for axes in panels.ravel()[len(family.fields) :]:
        axes.set_visible(False)
    for axes in panels[-1]:
        axes.set_xlabel(parameter_label(parameter))
    legend_above(figure, panels[0, 0], columns=3)
    return figure


@styled
def error_figure(parameter: ParameterRange, k: int, errors: Sequence[GroupErrors]) -> Figure:
    """Draw the errors on held-out states over parameter ``k``, one panel for each output, logarithmic."""
    factor = units_now().factor(parameter.quantity)
    edges = np.linspace(parameter.lower, parameter.upper, ERROR_BINS + 1) * factor
    figure = new_figure(5.4, 0.7 + 1.75 * len(errors))
    panels = figure.subplots(len(errors), 1, sharex=True, squeeze=False)[:, 0]
    for axes, group in zip(panels, errors, strict=True):
        x, percent = group.parameters[:, k] * factor, group.percent
        shown = np.maximum(percent, LEAST_ERROR * percent.max(initial=0.0))
        axes.semilogy(x, shown, "o", ms=4, mfc=style.BLUE, mec="white", mew=0.4, label="held-out states")
        rms = binned_rms(x, percent, edges)
        axes.hlines(
            rms, edges[:-1], edges[1:], color=style.VERMILLION, lw=2.0, label="RMS of each sixth of the range"
        )
        axes.set_ylabel(f"error of {group.label}\n[% of range]")
        axes.set_xlim(edges[0], edges[-1])
        axes.set_ylim(_decades(shown))
    panels[-1].set_xlabel(parameter_label(parameter))
    legend_above(figure, panels[0], columns=2)
    return figure


@styled
def spread_figure(
    parameter: ParameterRange,
    x: Array,
    training: npt.NDArray[np.bool_],
    body: tuple[Array, Array] | None = None,
) -> Figure:
    """Draw how the solved states are spread over a parameter, beside the use of it in the body.

    Parameters
    ----------
    parameter
        On the axis.
    x : (n,)
        Its value in the solved states.
    training : (n,) bool
        Those that the surrogate was trained on.
    body
        Values in the body and volumes that have them; None: not known.
    """
    factor = units_now().factor(parameter.quantity)
    edges = np.linspace(parameter.lower, parameter.upper, STATE_BINS + 1) * factor
    figure = new_figure(5.4, 3.0)
    axes = figure.add_subplot()
    learned, left = (_shares(x[rows] * factor, None, edges, len(x)) for rows in (training, ~training))
    widths = np.diff(edges)
    axes.bar(
        edges[:-1], learned, widths, align="edge", color=style.BLUE, ec="white", lw=0.6, label="trained on"
    )
    if left.any():
        axes.bar(
            edges[:-1],
            left,
            widths,
            learned,
            align="edge",
            color=style.VERMILLION,
            ec="white",
            lw=0.6,
            label="without use",
        )
    if body is not None:
        values, volumes = body
        shares = _shares(values * factor, volumes, edges, float(volumes.sum()))
        axes.stairs(shares, edges, color=style.GREEN, lw=2.0, label="volume of the body", zorder=3)
    axes.set_xlim(edges[0], edges[-1])
    axes.set_xlabel(parameter_label(parameter))
    axes.set_ylabel("share of states, of the body [%]" if body is not None else "share of states [%]")
    legend_above(figure, axes, columns=3)
    return figure


def _decades(values: Array) -> tuple[float, float]:
    """Return the powers of ten between which positive values lie; about 1 without any."""
    known = values[values > 0]
    if not len(known):
        return 0.1, 10.0
    low, high = np.floor(np.log10(known.min())), np.ceil(np.log10(known.max()))
    return float(10.0**low), float(10.0 ** max(high, low + 1))


def parameter_label(parameter: ParameterRange) -> str:
    """Return the label of an axis of a parameter."""
    return axis_label(named(parameter.name), parameter.quantity)


def _shares(values: Array, weights: Array | None, edges: Array, whole: float) -> Array:
    """Return the shares of the whole in each bin [%]; what lies beyond an end by round-off counts there."""
    counts, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges, weights=weights)
    return np.asarray(100 * counts / whole)


def over_parameters(
    context: ReportContext, family: FamilySummary, pictures: Pictures
) -> list[tuple[str, list[Picture]]]:
    """Return the name of each parameter with its pictures: undeformed cell, held-out errors, spread of the states."""
    errors, sampling, found = group_errors(context.surrogate.outputs), context.sampling, []
    for k, parameter in enumerate(family.parameters):
        name = parameter.name
        drawn = [
            pictures.svg(f"cell_over_{name}", rest_figure(family, k), f"The undeformed cell over {name}"),
            pictures.svg(
                f"states_over_{name}",
                spread_figure(
                    parameter,
                    sampling.x[:, sampling.inputs.names.index(name)],
                    sampling.training,
                    None if context.body is None else context.body.over(name),
                ),
                f"Solved states over {name}",
            ),
        ]
        if errors:
            members = len(np.unique(errors[0].parameters, axis=0))
            text = f"Errors on held-out states over {name}, of {members} {'member' if members == 1 else 'members'}"
            drawn.insert(1, pictures.svg(f"errors_over_{name}", error_figure(parameter, k, errors), text))
        found.append((name, drawn))
    return found
