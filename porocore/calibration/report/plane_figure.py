"""Figure of the plane of two unknowns: their 95 % region, the paths of both profiles."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from porocore.calibration.inference.infer import Inference
from porocore.calibration.inference.plane import ParameterPlane
from porocore.calibration.problem import Unknown
from porocore.calibration.report.contents import unknown_label, values_at
from porocore.report.figures.style import (
    BLACK,
    BLUE,
    DASHED,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILLION,
    legend_above,
    lighter,
    named,
    new_figure,
    styled,
)
from porocore.states import Array

#: Points of a smooth rim between two rays.
BETWEEN = 24
#: Ratio of the ends of an axis from which it is logarithmic.
WIDE = 10.0
#: Share of the region's size by which the axes go beyond it.
MARGIN = 0.12


@styled
def plane_figure(inference: Inference, truth: Array | None = None) -> Figure:
    """Draw the plane of the two unknowns that the data determine least.

    Parameters
    ----------
    inference
        Must have a plane.
    truth : (k,)
        Values with which data were made up.
    """
    plane = inference.plane
    assert plane is not None
    pair = tuple(inference.unknowns[i] for i in plane.indices)
    figure = new_figure(5.4, 4.6)
    axes = figure.add_subplot()
    shown = [inference.data_intervals[i].coordinates[:, plane.indices] for i in plane.indices]
    if len(plane.angles):
        shown = [_region(axes, plane, pair)]
    # The first path is wider, since both cover each other in a valley.
    for index, colour, width in zip(plane.indices, (lighter(PURPLE, 0.35), ORANGE), (3.0, 1.1), strict=True):
        path = inference.data_intervals[index].coordinates[:, plane.indices]
        name = named(inference.unknowns[index].name.replace("_", " "))
        axes.plot(
            *_values(pair, path), ".-", ms=3 + width, lw=width, color=colour, label=f"profile of {name}"
        )
    axes.plot(
        *_values(pair, plane.best[None]), "P", ms=8, color=BLACK, mec="white", ls="", label="best of the data"
    )
    if truth is not None:
        axes.plot(*truth[list(plane.indices)], "*", ms=11, color=GREEN, mec="white", ls="", label="truth")
    _limits(axes, pair, np.concatenate(shown))
    axes.set_xlabel(unknown_label(pair[0]))
    axes.set_ylabel(unknown_label(pair[1]))
    legend_above(figure, axes, columns=2)
    return figure


def _region(axes: Axes, plane: ParameterPlane, pair: tuple[Unknown, ...]) -> Array:
    """Draw the region and its form to first order, and return coordinates of its rim."""
    rim = plane.points(*smooth_rim(plane))
    axes.fill(*_values(pair, rim), color=lighter(BLUE, 0.85), lw=0)
    _outline(axes, plane, pair)
    angles = np.linspace(0, 2 * np.pi, 200)
    first = plane.points(angles, np.full(200, float(np.median(plane.linear_radii))))
    axes.plot(*_values(pair, first), color=GREY, ls=DASHED, lw=1.2, label="to first order")
    return rim


def smooth_rim(plane: ParameterPlane) -> tuple[Array, Array]:
    """Return angles and radii of the rim, monotone between neighbouring rays and periodic."""
    from scipy.interpolate import PchipInterpolator

    turn, count = 2 * np.pi, len(plane.angles)
    wrapped = np.concatenate([plane.angles - turn, plane.angles, plane.angles + turn])
    curve = PchipInterpolator(wrapped, np.tile(np.log(np.maximum(plane.radii, 1e-12)), 3))
    angles = np.linspace(plane.angles[0], plane.angles[0] + turn, BETWEEN * count + 1)
    return angles, np.exp(curve(angles))


def _outline(axes: Axes, plane: ParameterPlane, pair: tuple[Unknown, ...]) -> None:
    """Draw the rim where it is closed, and marks where the region goes on."""
    angles, radii = smooth_rim(plane)
    x, y = _values(pair, plane.points(angles, radii))
    following = np.arange(len(angles)) // BETWEEN % len(plane.angles)
    between = plane.closed[following] & plane.closed[(following + 1) % len(plane.angles)]
    x, y = np.where(between, x, np.nan), np.where(between, y, np.nan)
    axes.plot(x, y, color=BLUE, label="95 % region of the data")
    if not plane.closed.all():
        ends = _values(pair, plane.rim[~plane.closed])
        axes.plot(
            *ends,
            "D",
            ms=5,
            mfc="white",
            mec=VERMILLION,
            ls="",
            label="goes on here",
            clip_on=False,
            zorder=4,
        )


def _values(pair: tuple[Unknown, ...], coordinates: Array) -> tuple[Array, Array]:
    x, y = (values_at(one, column) for one, column in zip(pair, coordinates.T, strict=True))
    return x, y


def _limits(axes: Axes, pair: tuple[Unknown, ...], rim: Array) -> None:
    for which, (unknown, column) in enumerate(zip(pair, rim.T, strict=True)):
        low, high = float(column.min()), float(column.max())
        margin = MARGIN * (high - low)
        ends = unknown.value(low - margin), unknown.value(high + margin)
        (axes.set_xlim, axes.set_ylim)[which](*ends)
        if unknown.scale == "log" and high - low > np.log(WIDE):
            (axes.set_xscale, axes.set_yscale)[which]("log")
