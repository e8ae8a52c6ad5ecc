"""Figures of a calibration: fits, fields, profiles, correlations, planes of two unknowns, posterior."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from porocore.commands.calibration.clouds import PRESSURE, FilmComponent
from porocore.commands.calibration.infer import Inference
from porocore.commands.calibration.plan import FittedField
from porocore.commands.calibration.posterior import Posterior
from porocore.commands.calibration.problem import Unknown
from porocore.commands.calibration.profiles import ROOT_95, ParameterPlane, ProfileInterval
from porocore.commands.calibration.results import Calibration
from porocore.core.units import pretty
from porocore.report.figures.style import (
    BLACK,
    BLUE,
    DASHED,
    DOTTED,
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

#: Unknowns at most whose correlations are written into the figure.
MOST_NUMBERS = 10


def _spaced(name: str) -> str:
    """Return a name in words, without underscores."""
    return named(name.replace("_", " "))


def _labelled(name: str, unit: str) -> str:
    """Return the label of an axis: a name in words, and the unit in brackets; a dash without one."""
    return f"{_spaced(name)} [{pretty(unit) or '–'}]"


def _along(unknown: Unknown, coordinates: Array) -> Array:
    """Return the values (n,) of an unknown at coordinates (n,)."""
    return np.array([unknown.value(float(x)) for x in coordinates])


@styled
def correlation_figure(inference: Inference) -> Figure:
    """Draw the correlations of the coordinates to first order, without priors, each with its number, or a dash."""
    names = [_spaced(one.name) for one in inference.unknowns]
    correlations = inference.correlations
    count = len(names)
    numbers = count <= MOST_NUMBERS
    figure = new_figure(2.4 + 0.75 * count, 1.3 + 0.62 * count) if numbers else new_figure(9.9, 7.5)
    axes = figure.add_subplot()
    image = axes.imshow(correlations, cmap="RdBu_r", vmin=-1, vmax=1)
    axes.set_xticks(range(count), names, rotation=30, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(count), names)
    axes.grid(visible=False)
    axes.tick_params(length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)
    for (i, j), value in np.ndenumerate(correlations) if numbers else ():
        text = _text(float(value)) if i != j else "1"
        axes.text(
            j, i, text, ha="center", va="center", fontsize=9, color="white" if abs(value) > 0.6 else "black"
        )
    figure.colorbar(image, ax=axes, shrink=0.85).set_label("correlation [–]")
    return figure


def _text(value: float) -> str:
    """Return two digits, and as many nines as there are up to four; a dash for NaN."""
    if value != value:
        return "–"
    for digits in (2, 3, 4):
        if abs(round(value, digits)) < 1:
            # Without the sign of a zero.
            return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", "−")
    return "> 0.9999" if value > 0 else "< −0.9999"


@styled
def field_figure(done: Calibration, field: FittedField) -> Figure:
    """Draw one field: fitted values with bars of their 95 % intervals, and the truth of made-up data."""
    if len(field.lines) > 1:
        return grid_figure(done, field)
    inference, members = done.inference, list(field.members)
    ((along, line),) = field.lines.items()
    places, values = np.array(line), inference.values[members]
    ends = [inference.intervals[i].values for i in members]
    bars = np.array(
        [
            [0.0 if low is None else value - low for value, (low, _) in zip(values, ends, strict=True)],
            [0.0 if high is None else high - value for value, (_, high) in zip(values, ends, strict=True)],
        ]
    )
    figure = new_figure(4.4, 3.2)
    axes = figure.add_subplot()
    if done.truth is not None:
        axes.plot(places, done.truth[members], color=BLACK, ls="--", label="truth")
    axes.errorbar(
        places, values, np.maximum(bars, 0.0), fmt="o-", ms=4, color=BLUE, ecolor=GREY, elinewidth=1.2, capsize=3,
        label="fit, 95 % intervals",
    )  # fmt: skip
    axes.set_xlabel(_labelled(along, field.unit))
    axes.set_ylabel(_labelled(field.name, inference.unknowns[members[0]].unit))
    legend_above(figure, axes, columns=2)
    return figure


#: Slices of a grid along its third axis that are drawn at most.
MOST_SLICES = 4


@styled
def grid_figure(done: Calibration, field: FittedField) -> Figure:
    """Draw the values on a grid, half the widths of their 95 % intervals, and the truth of made-up data.

    A cross stands where an interval has an open end. Of a grid along three axes there is a row for each slice.
    """
    inference, members = done.inference, list(field.members)
    axes_names, lines = [*field.lines], [np.array(line) for line in field.lines.values()]
    shape = [len(line) for line in lines]
    ends = [inference.intervals[i].values for i in members]
    half = np.array([np.nan if None in pair else (pair[1] - pair[0]) / 2 for pair in ends])  # type: ignore[operator]
    found = {"fit": inference.values[members], "half of the 95 % interval": half}
    if done.truth is not None:
        found = {"truth": done.truth[members], **found}
    slices = range(shape[2]) if len(shape) > 2 else range(1)
    slices = slices[:: -(-len(slices) // MOST_SLICES)]
    figure = new_figure(0.6 + 3.1 * len(found), 0.4 + 2.6 * len(slices))
    panels = figure.subplots(len(slices), len(found), squeeze=False, sharex=True, sharey=True)
    values = np.concatenate([each for name, each in found.items() if name in ("truth", "fit")])
    label = _labelled(field.name, inference.unknowns[members[0]].unit)
    for row, place in zip(panels, slices, strict=True):
        for axes, (name, each) in zip(row, found.items(), strict=True):
            flat = np.reshape(each, shape, order="F").reshape(shape[0], shape[1], -1)[..., place].T
            plain = name not in ("truth", "fit")
            limits = (0.0, np.nanmax([*half, 0.0]) or 1.0) if plain else (values.min(), values.max())
            image = axes.pcolormesh(
                lines[0], lines[1], flat, shading="nearest" if plain else "gouraud",
                cmap="Greys" if plain else "viridis", vmin=limits[0], vmax=limits[1], rasterized=True,
            )  # fmt: skip
            nodes = np.meshgrid(lines[0], lines[1])
            lost = np.isnan(flat)
            axes.plot(nodes[0][~lost], nodes[1][~lost], ".", ms=3, color=GREY)
            axes.plot(nodes[0][lost], nodes[1][lost], "x", ms=6, color=VERMILLION)
            axes.set_title(name if len(slices) == 1 else f"{name}, {axes_names[2]} = {lines[2][place]:.4g}")
            axes.grid(visible=False)
            axes.set_aspect("equal")
            figure.colorbar(image, ax=axes, shrink=0.85).set_label(label)
        row[0].set_ylabel(_labelled(axes_names[1], field.unit))
    for axes in panels[-1]:
        axes.set_xlabel(_labelled(axes_names[0], field.unit))
    return figure


#: Standard deviations at which residuals have the darkest colour.
DARKEST = 4.0
#: Area of all points of a picture, in squared points of type.
INK = 9000.0
#: Values that differ by less than this share of the largest one, or of the deviation, have one colour.
ROUNDING = 1e-9


def _shown_times(times: Array, largest: float) -> Array:
    """Return the first time, the last one, and that of the largest value, or else the middle one."""
    ends = {float(times[0]), float(times[-1])}
    between = largest if largest not in ends else float(times[len(times) // 2])
    return np.array(sorted({*ends, between}))


def _colour_ends(values: Array, deviation: float) -> tuple[float, float]:
    """Return the ends of a scale of colours: those of the values, a deviation to either side where they are constant.

    Rounding errors have no colours of their own.
    """
    low, high = float(values.min()), float(values.max())
    if high - low > ROUNDING * max(deviation, high, -low):
        return low, high
    return low - deviation, high + deviation


@styled
def film_figure(done: Calibration, curve: int) -> Figure:
    """Draw a measured field side by side with the fit and the residuals, a row for each of at most three times.

    Points are shown along the two axes in which they extend most.
    """
    observed = done.plan.curves[curve]
    series, rows = observed.series, np.flatnonzero(done.data.curve == curve)
    assert isinstance(series, FilmComponent)
    measured, fitted = done.data.values[rows], done.inference.best.prediction.values[rows]
    residuals = (measured - fitted) / done.data.deviations[rows]
    units = next(each.config.result_units for each in done.plan.experiments if observed in each.curves)
    places, unit = (
        series.places * units.factor("displacement"),
        units.name("displacement") if units.given else "",
    )
    first, second = sorted(np.argsort(-np.ptp(places, axis=0), kind="stable")[:2].tolist())
    times = np.unique(observed.displayed_times)
    shown = _shown_times(times, float(observed.displayed_times[np.abs(measured).argmax()]))
    size = np.ptp(places[:, [first, second]], axis=0)
    tall = float(np.clip(size[1] / max(size[0], 1e-300), 0.3, 3.0))
    high = min(2.4 * tall, 2.9)
    figure = new_figure(max(3 * high / tall + 3.4, 6.0), 0.6 + (high + 0.4) * len(shown))
    panels = figure.subplots(len(shown), 3, squeeze=False, sharex=True, sharey=True)
    ends = _colour_ends(np.concatenate([measured, fitted]), float(done.data.deviations[rows].max()))
    images: list[Any] = []
    for row, time in zip(panels, shown, strict=True):
        here = observed.displayed_times == time
        ink = min(60.0, max(2.0, INK / max(int(here.sum()), 1)))
        images = []
        for axes, values, words in zip(
            row, (measured, fitted, residuals), ("measured", "fitted", "residual"), strict=True
        ):
            plain = words == "residual"
            images.append(
                axes.scatter(
                    places[here, first], places[here, second], c=values[here], s=ink, lw=0, rasterized=True,
                    cmap="RdBu_r" if plain else "viridis", vmin=-DARKEST if plain else ends[0],
                    vmax=DARKEST if plain else ends[1],
                )
            )  # fmt: skip
            axes.set_aspect("equal")
            axes.grid(visible=False)
            # Above the panels, since a low one is shorter than its time.
            at = f"$t$ = {time:.4g} {pretty(observed.time_unit)}".rstrip() if words == "measured" else ""
            axes.set_title(f"{words}\n{at}" if time == shown[0] else at)
        row[0].set_ylabel(_labelled("xyz"[second], unit))
    for axes in panels[-1]:
        axes.set_xlabel(_labelled("xyz"[first], unit))
    turned = series.cloud.axes is not None and series.component != PRESSURE
    along = f" along camera axis {series.component + 1}" if turned else ""
    words = _labelled(done.data.names[curve] + along, observed.unit)
    figure.colorbar(images[0], ax=panels[:, :2], shrink=0.8, aspect=40).set_label(words)
    figure.colorbar(images[2], ax=panels[:, 2:], shrink=0.8, aspect=40).set_label("residual [standard dev.]")
    return figure


#: Ratio of last and first time from which the axis of time is logarithmic.
WIDE_TIMES = 50.0
#: The band of the residuals.
BAND = 2.0


@styled
def fit_figure(done: Calibration, curve: int) -> Figure:
    """Draw one curve: data with bars of one standard deviation, the best prediction, and the residuals below."""
    data, rows = done.data, done.data.rows(curve)
    unit, time_unit = (units[curve] if units else "" for units in (data.units, data.time_units))
    times, values, deviations = data.times[rows], data.values[rows], data.deviations[rows]
    predicted = done.inference.best.prediction.values[rows]
    figure = new_figure(5.4, 4.6)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2.6, 1.0))
    upper.errorbar(
        times, values, deviations, fmt="o", ms=3.4, mfc="white", mec=BLACK, mew=0.8, ecolor=GREY, elinewidth=0.8,
        label=f"{'data' if done.truth is None else 'synthetic data'}, ± 1 standard deviation",
    )  # fmt: skip
    upper.plot(times, predicted, color=BLUE, label="fit", zorder=3)
    upper.set_ylabel(_labelled(data.names[curve], unit))
    if 0 <= min(values.min(), predicted.min()) < 0.5 * values.max():
        upper.set_ylim(bottom=0)
    _residuals(lower, times, (values - predicted) / deviations)
    lower.set_xlabel(f"time $t$ [{pretty(time_unit) or '–'}]")
    if times[0] > 0 and times[-1] > WIDE_TIMES * times[0]:
        lower.set_xscale("log")
    figure.align_ylabels()
    legend_above(figure, upper, columns=2)
    return figure


def _residuals(axes: Axes, times: Array, residuals: Array) -> None:
    axes.axhspan(-BAND, BAND, color=lighter(BLUE, 0.85), lw=0)
    axes.axhline(0.0, color=BLUE, lw=1.0)
    axes.plot(times, residuals, "o", ms=3.4, mfc="white", mec=BLACK, mew=0.8)
    most = 1.15 * max(float(np.abs(residuals).max()), 1.3 * BAND)
    axes.set_ylim(-most, most)
    axes.set_ylabel("residual\n[standard dev.]")


#: Points of a smooth rim between two rays.
BETWEEN = 24
#: Ratio of the ends of an axis from which it is logarithmic.
WIDE_PLANE = 10.0
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
        name = _spaced(inference.unknowns[index].name)
        axes.plot(
            *_values(pair, path), ".-", ms=3 + width, lw=width, color=colour, label=f"profile of {name}"
        )
    axes.plot(
        *_values(pair, plane.best[None]), "P", ms=8, color=BLACK, mec="white", ls="", label="best of the data"
    )
    if truth is not None:
        axes.plot(*truth[list(plane.indices)], "*", ms=11, color=GREEN, mec="white", ls="", label="truth")
    _limits(axes, pair, np.concatenate(shown))
    axes.set_xlabel(_labelled(pair[0].name, pair[0].unit))
    axes.set_ylabel(_labelled(pair[1].name, pair[1].unit))
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
    x, y = (_along(one, column) for one, column in zip(pair, coordinates.T, strict=True))
    return x, y


def _limits(axes: Axes, pair: tuple[Unknown, ...], rim: Array) -> None:
    for which, (unknown, column) in enumerate(zip(pair, rim.T, strict=True)):
        low, high = float(column.min()), float(column.max())
        margin = MARGIN * (high - low)
        ends = unknown.value(low - margin), unknown.value(high + margin)
        (axes.set_xlim, axes.set_ylim)[which](*ends)
        if unknown.scale == "log" and high - low > np.log(WIDE_PLANE):
            (axes.set_xscale, axes.set_yscale)[which]("log")


#: Unknowns that are drawn at most, the first ones.
MOST = 8
BINS = 40
#: Share of the draws that the axes leave out on either side.
OUTER = 0.001


@styled
def posterior_figure(posterior: Posterior, best: Array, truth: Array | None = None) -> Figure:
    """Draw the density of each unknown with median and 95 % credible interval, and that of each pair.

    Parameters
    ----------
    posterior
        Its draws.
    best : (k,)
        Values where the sum of squares is least.
    truth : (k,)
        Values with which data were made up.
    """
    unknowns, values = posterior.unknowns[:MOST], posterior.values
    count = len(unknowns)
    figure = new_figure(1.2 + 2.0 * count, 1.0 + 1.8 * count)
    panels = figure.subplots(count, count, squeeze=False, sharex="col")
    ends = np.quantile(values, [OUTER, 1 - OUTER], axis=0).T
    edges = [np.linspace(low, high, BINS + 1) for low, high in ends]
    for row, column in np.ndindex(count, count):
        axes = panels[row, column]
        if column > row:
            axes.set_visible(False)
            continue
        if column == row:
            _alone(axes, posterior, row, edges[row])
        else:
            axes.hist2d(
                values[:, column],
                values[:, row],
                bins=[edges[column], edges[row]],
                cmap="Blues",
                rasterized=True,
            )
            axes.plot(best[column], best[row], "P", ms=7, color=BLACK, mec="white")
        if truth is not None:
            axes.axvline(truth[column], color=GREEN, lw=1.2)
            if column < row:
                axes.axhline(truth[row], color=GREEN, lw=1.2)
        axes.grid(visible=False)
        _label(axes, posterior, row, column, count)
    figure.align_ylabels()
    return figure


def _alone(axes: Axes, posterior: Posterior, index: int, edges: Array) -> None:
    """Draw the density of one unknown, its median and the ends of its interval that there are."""
    axes.hist(posterior.values[:, index], bins=edges.tolist(), density=True, color=lighter(BLUE, 0.6))
    axes.axvline(posterior.medians[index], color=BLUE, lw=1.4)
    for end in posterior.intervals[index]:
        if end is not None:
            axes.axvline(end, color=GREY, ls=DASHED, lw=1.2)
    axes.set_yticks([])


def _label(axes: Axes, posterior: Posterior, row: int, column: int, count: int) -> None:
    if row == count - 1:
        axes.set_xlabel(_labelled(posterior.unknowns[column].name, posterior.unknowns[column].unit))
        axes.tick_params(axis="x", rotation=30)
    if column == 0 and row > 0:
        axes.set_ylabel(_labelled(posterior.unknowns[row].name, posterior.unknowns[row].unit))
    elif row != column:
        axes.tick_params(labelleft=False)


#: Largest rise that is drawn.
HIGHEST = 6.5
#: Ratio of the ends of an axis from which it is logarithmic.
WIDE_PROFILE = 10.0
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
    axes.plot(_along(unknown, x), rise, color=BLUE, label="profile of the data", zorder=3)
    points, roots = alone.coordinates[:, i], alone.roots
    axes.plot(_along(unknown, points), roots**2, "o", ms=3, color=BLUE, zorder=3)
    edges = [low, high]
    if both is not alone:
        more, less = smooth_profile(both, i)
        edges += [float(more[0]), float(more[-1])]
        axes.plot(
            _along(unknown, more), less, color=VERMILLION, ls=(0, (5, 1.5, 1, 1.5)), label="with priors"
        )
    deviation = float(inference.without_priors.deviations[i])
    if np.isfinite(deviation):
        dense = np.linspace(low, high, POINTS)
        parabola = ((dense - inference.data_best.coordinates[i]) / deviation) ** 2
        axes.plot(_along(unknown, dense), parabola, color=GREY, ls=DASHED, lw=1.2, label="to first order")
    axes.axhline(ROOT_95**2, color=BLACK, ls=DOTTED, lw=1.2, label="95 %: rise 3.84")
    if truth is not None:
        axes.axvline(truth, color=GREEN, lw=1.4, label="truth")
    axes.set_ylim(0, HIGHEST)
    edges += [unknown.coordinate(value) for value in alone.values if value is not None]
    low, high = min(edges), max(edges)
    margin = 0.04 * (high - low)
    sides = _along(unknown, np.array([low - margin, high + margin]))
    _band(axes, alone, float(sides[0]), float(sides[1]))
    axes.set_xlim(*sides)
    if unknown.scale == "log" and high - low > np.log(WIDE_PROFILE):
        axes.set_xscale("log")
    axes.set_xlabel(_labelled(unknown.name, unknown.unit))


def _band(axes: Axes, interval: ProfileInterval, low: float, high: float) -> None:
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


def smooth_profile(interval: ProfileInterval, index: int) -> tuple[Array, Array]:
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
