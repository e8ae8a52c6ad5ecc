"""Figure of a stability map: onsets over two inputs, or the indicators along one line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from porocore.cell.stability.map import EVENTS, MapPlan, StabilityLine, eigenvalue_titled, input_factor
from porocore.cell.stability.modes import FAMILIES, WAVES
from porocore.core.inputs import NAMES
from porocore.core.units import units_now
from porocore.report.figures import style
from porocore.report.figures.style import axis_label, new_figure, styled
from porocore.states import Array, Status

SYMBOLS = {"H11": "$H_{11}$", "H22": "$H_{22}$", "H33": "$H_{33}$", "p": "pore pressure $p$"}
#: Percent of the wall in contact from which a map is shaded.
LEAST_SHARE = 0.01
_OF_WAVE: dict[str, dict[str, Any]] = {
    "0": {"color": style.VERMILLION, "marker": "s", "ls": style.DASHED},
    "100": {"color": style.ORANGE, "marker": "^", "ls": "-"},
    "110": {"color": style.BLUE, "marker": "o", "ls": "-"},
    "111": {"color": style.GREEN, "marker": "D", "ls": "-"},
}
_NAMES = {
    "0": "mode of period one",
    "100": "period two along one axis (100)",
    "110": "period two along two axes (110)",
    "111": "period two along three axes (111)",
}
#: Look and name of the onset of each kind of trouble, and the events that are one.
_ONSETS: tuple[tuple[str, tuple[str, ...], dict[str, Any]], ...] = (
    (
        "crease: the wall meets a mirror plane",
        ("crease",),
        {"color": style.BLACK, "marker": "", "ls": "-", "lw": 2.4},
    ),
    *((_NAMES[name], waves, _OF_WAVE[name]) for name, waves in FAMILIES.items()),
    (
        "loss of rank-one convexity of $W$",
        ("acoustic",),
        {"color": style.PURPLE, "marker": "v", "ls": style.DOTTED},
    ),
)


@styled
def stability_figure(plan: MapPlan, lines: Sequence[StabilityLine]) -> Figure:
    """Draw a finished map: over both inputs where there are several lines, else along the only one."""
    return _over_both(plan, lines) if len(lines) > 1 else _along(plan, lines[0])


def _over_both(plan: MapPlan, lines: Sequence[StabilityLine]) -> Figure:
    inputs = [NAMES.index(plan.leading), NAMES.index(plan.across)]
    _, across = inputs
    factors = np.array([input_factor(plan.leading), input_factor(plan.across)])
    lines = sorted(lines, key=lambda line: float(line.start[across]))
    figure = new_figure(7.6, 5.6)
    axes = figure.subplots()
    _contact(figure, axes, lines, inputs, factors)
    states = np.concatenate([line.states()[:, inputs] for line in lines]) * factors
    status = np.concatenate([line.status for line in lines])
    solved = np.isin(status, [s for s in Status if s.has_values])
    axes.plot(*states[solved].T, ls="", marker=".", ms=3.5, color=style.GREY, label="solved state")
    if not solved.all():
        failed = states[~solved].T
        axes.plot(
            *failed,
            ls="",
            marker="x",
            ms=7,
            mew=1.6,
            color=style.VERMILLION,
            label="no solution; the line ends",
        )
    for label, events, look in _ONSETS:
        points = np.array([line.onset(*events)[inputs] for line in lines]) * factors
        if np.isfinite(points).any():
            axes.plot(*points.T, label=label, ms=5.5, **look)
    axes.set(xlabel=_label(plan.leading), ylabel=_label(plan.across))
    for limits, setter in ((states[:, 0], axes.set_xlim), (states[:, 1], axes.set_ylim)):
        low, high = float(limits.min()), float(limits.max())
        setter(low - 0.03 * (high - low), high + 0.03 * (high - low))
    figure.legend(loc="outside upper left", ncols=2, handlelength=2.6, columnspacing=1.4)
    return figure


def _label(name: str) -> str:
    """Return the label of the axis of an input."""
    return axis_label(SYMBOLS[name], "pressure" if name == "p" else "", units_now())


def _contact(
    figure: Figure, axes: Axes, lines: Sequence[StabilityLine], inputs: Sequence[int], factors: Array
) -> None:
    """Shade the share of the wall in contact; nothing where there is none."""
    leading, across = inputs
    largest = max((float(np.nanmax(line.contact_share, initial=0.0)) for line in lines), default=0.0)
    if largest <= 0:
        return
    # The grid bends with the crease, so that no shade reaches over it between two lines.
    grid, share = (np.stack(part) for part in zip(*map(_contact_along, lines), strict=True))
    x = np.stack(
        [
            line.start[leading] + s * (line.goal - line.start)[leading]
            for line, s in zip(lines, grid, strict=True)
        ]
    )
    y = np.stack([np.full(len(s), line.start[across]) for line, s in zip(lines, grid, strict=True)])
    levels = np.array(MaxNLocator(8).tick_values(0.0, 100 * largest))
    levels[0] = LEAST_SHARE
    greys = [str(level) for level in np.linspace(0.95, 0.6, len(levels) - 1)]
    filled = axes.contourf(x * factors[0], y * factors[1], 100 * share, levels=levels, colors=greys)
    bar = figure.colorbar(filled, ax=axes, shrink=0.85, pad=0.02)
    bar.set_ticks(list(levels[1:]))
    bar.set_label("pore wall in contact [%]")


def _contact_along(line: StabilityLine) -> tuple[Array, Array]:
    """Return places along a line before and behind its crease, and the share of the wall in contact there.

    Between the states, from nothing at the crease on; NaN behind the line's end.
    """
    known = np.isfinite(line.contact_share)
    at, contact = line.share[known], line.contact_share[known]
    crease = float(line.onsets[EVENTS.index("crease")].mean())
    crease = crease if np.isfinite(crease) else 1.0
    if 0 < crease < 1:
        after = int(np.searchsorted(at, crease))
        at, contact = np.insert(at, after, crease), np.insert(contact, after, 0.0)
    places = np.concatenate([np.linspace(0.0, crease, 61), np.linspace(crease, 1.0, 121)])
    return places, np.interp(places, at, contact, right=np.nan)


def _along(plan: MapPlan, line: StabilityLine) -> Figure:
    asked = np.isfinite(line.eigenvalues).any()
    figure = new_figure(7.6, 7.6 if asked else 6.0)
    ratios = (1, 1.3, 1, 1) if asked else (1, 1, 1)
    panels = list(figure.subplots(len(ratios), 1, sharex=True, height_ratios=ratios))
    factor, units = input_factor(plan.leading), units_now()
    x, stress = line.states()[:, NAMES.index(plan.leading)] * factor, units.factor("stress")
    for name, waves in FAMILIES.items():
        columns = [WAVES.index(wave) for wave in waves]
        pivots = np.where(line.pivots[:, columns] < 0, np.nan, line.pivots[:, columns]).sum(axis=1)
        look = {**_OF_WAVE[name], "ms": 4.5}
        panels[0].plot(x, pivots, label=_NAMES[name], drawstyle="steps-mid", **look)
        if asked:
            panels[1].plot(x, _least(line.eigenvalues[:, columns]) * stress, **look)
    panels[0].set_ylabel("unstable modes")
    panels[0].yaxis.set_major_locator(MaxNLocator(4, integer=True))
    if asked:
        name = "lowest eigenvalue"
        panels[1].set_ylabel(eigenvalue_titled(name, "$d^2$") if units.given else rf"{name} [$E/d^2$]")
    panels[-2].plot(x, line.acoustic * stress, color=style.PURPLE, marker="v", ms=4.5)
    panels[-2].set_ylabel(f"acoustic\nminimum [{units.name('stress') if units.given else '$E$'}]")
    panels[-1].plot(x, 100 * line.contact_share, color=style.BLACK, marker=".")
    panels[-1].set_ylabel("wall in\ncontact [%]")
    panels[-1].set_xlabel(_label(plan.leading))
    crease = line.onset("crease")[NAMES.index(plan.leading)] * factor
    for axes in panels:
        if axes in panels[1:-1]:
            axes.axhline(0.0, color=style.GREY, lw=1.0)
        if np.isfinite(crease):
            axes.axvline(
                float(crease),
                color=style.BLACK,
                ls=style.DASHED,
                lw=1.2,
                label="crease" if axes is panels[0] else None,
            )
        axes.margins(x=0.02)
    figure.align_ylabels()
    figure.legend(loc="outside upper left", ncols=2, handlelength=2.6, columnspacing=1.4)
    return figure


def _least(values: Array) -> Array:
    """Return the least value of each row; NaN where nothing is known."""
    known = np.where(np.isfinite(values), values, np.inf).min(axis=1)
    return np.where(np.isfinite(known), known, np.nan)
