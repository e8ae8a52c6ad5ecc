"""Figure of the profile likelihood of each unknown, with its 95 % interval."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from porocore.calibration.inference.infer import Inference
from porocore.calibration.inference.intervals import ROOT_95, ConfidenceInterval
from porocore.calibration.report.contents import unknown_label, values_at
from porocore.report.figures.style import (
    BLACK,
    BLUE,
    DASHED,
    DOTTED,
    GREEN,
    GREY,
    VERMILLION,
    legend_above,
    lighter,
    new_figure,
    styled,
)
from porocore.states import Array

#: Largest rise that is drawn.
HIGHEST = 6.5
#: Ratio of the ends of an axis from which it is logarithmic.
WIDE = 10.0
COLUMNS = 3
#: Half of the axis of a profile that is a single point, as a share of the bounds of the search.
ALONE = 0.02
POINTS = 200


@styled
def profile_figure(inference: Inference, truth: Array | None = None) -> Figure:
    """Draw the rise of the sum of squares over each unknown, the others optimised.

    Solid: of the data; dash-dotted: with priors, where there are any; dashed: to first order. The band is the 95 %
    interval without priors: up to the side of the panel where it has one end, and none where it has none.

    Parameters
    ----------
    inference
        Its profiles.
    truth : (k,)
        Values with which data were made up.
    """
    count = len(inference.unknowns)
    columns = 2 if count in (2, 4) else min(COLUMNS, count)
    rows = -(-count // columns)
    figure = new_figure(max(3.1 * columns, 4.4), 0.7 + 2.5 * rows)
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for i, axes in enumerate(panels.ravel()[:count]):
        _panel(axes, inference, i, None if truth is None else float(truth[i]))
    for axes in panels.ravel()[count:]:
        axes.set_visible(False)
    for axes in panels[:, 0]:
        axes.set_ylabel("rise of the sum of squares")
    # The first panel has the legend, and may have no band.
    panels[0, 0].fill_between([], [], color=lighter(BLUE, 0.85), lw=0, label="95 % interval of the data")
    legend_above(figure, panels[0, 0], columns=2 if columns < 3 else 3)
    return figure


def _panel(axes: Axes, inference: Inference, i: int, truth: float | None) -> None:
    unknown, alone = inference.unknowns[i], inference.data_intervals[i]
    both = inference.intervals[i]
    x, rise = smooth_profile(alone, i)
    low, high = float(x[0]), float(x[-1])
    if low == high:  # another unknown is at its bound from the first step on, to both sides
        half = ALONE * (unknown.coordinate(unknown.upper) - unknown.coordinate(unknown.lower))
        low, high = low - half, high + half
    axes.plot(values_at(unknown, x), rise, color=BLUE, label="profile of the data", zorder=3)
    points, roots = alone.coordinates[:, i], alone.roots
    axes.plot(values_at(unknown, points), roots**2, "o", ms=3, color=BLUE, zorder=3)
    edges = [low, high]
    if both is not alone:
        more, less = smooth_profile(both, i)
        edges += [float(more[0]), float(more[-1])]
        axes.plot(
            values_at(unknown, more), less, color=VERMILLION, ls=(0, (5, 1.5, 1, 1.5)), label="with priors"
        )
    deviation = float(inference.without_priors.deviations[i])
    if np.isfinite(deviation):
        dense = np.linspace(low, high, POINTS)
        parabola = ((dense - inference.data_best.coordinates[i]) / deviation) ** 2
        axes.plot(values_at(unknown, dense), parabola, color=GREY, ls=DASHED, lw=1.2, label="to first order")
    axes.axhline(ROOT_95**2, color=BLACK, ls=DOTTED, lw=1.2, label="95 %: rise 3.84")
    if truth is not None:
        axes.axvline(truth, color=GREEN, lw=1.4, label="truth")
    axes.set_ylim(0, HIGHEST)
    edges += [unknown.coordinate(value) for value in alone.values if value is not None]
    low, high = min(edges), max(edges)
    margin = 0.04 * (high - low)
    sides = values_at(unknown, np.array([low - margin, high + margin]))
    _band(axes, alone, float(sides[0]), float(sides[1]))
    axes.set_xlim(*sides)
    if unknown.scale == "log" and high - low > np.log(WIDE):
        axes.set_xscale("log")
    axes.set_xlabel(unknown_label(unknown))


def _band(axes: Axes, interval: ConfidenceInterval, low: float, high: float) -> None:
    """Shade the interval between the sides of the panel; an arrow points to one on which it has no end."""
    ends = [side if end is None else end for end, side in zip(interval.values, (low, high), strict=True)]
    if interval.values != (None, None):
        axes.axvspan(ends[0], ends[1], color=lighter(BLUE, 0.85), lw=0)
    for end, value, side in zip(ends, interval.values, ("left", "right"), strict=True):
        if value is None:
            axes.annotate(
                "no end",
                (end, 0.93 * HIGHEST),
                xytext=(10 if side == "left" else -10, 0),
                textcoords="offset points",
                ha=side,
                va="center",
                fontsize=9,
                color=BLUE,
                arrowprops={"arrowstyle": "->", "color": BLUE, "lw": 1.2},
            )


def smooth_profile(interval: ConfidenceInterval, index: int) -> tuple[Array, Array]:
    """Return coordinates (n,) of an unknown and the rise there, through the points of its profile.

    The signed root is interpolated, which is a straight line where the model is linear.
    """
    from scipy.interpolate import PchipInterpolator

    points = interval.coordinates[:, index]
    kept = np.concatenate([[True], np.diff(points) > 0])
    if kept.sum() < 2:
        return points[kept], interval.roots[kept] ** 2
    curve = PchipInterpolator(points[kept], interval.roots[kept])
    dense = np.linspace(points[0], points[-1], POINTS)
    return dense, curve(dense) ** 2
