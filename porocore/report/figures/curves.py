"""Curves against time and along a column: settlement, pressure, probes, reactions, profiles."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from porocore.core.units import units_now
from porocore.interfaces.solution import History, MacroSolution, Profile, has_radius
from porocore.report.figures import style
from porocore.report.figures.style import axis_label, legend_above, lighter, named, new_figure, styled
from porocore.report.metrics import solution_metrics, time_within
from porocore.report.words.results import only_suction, rises
from porocore.states import Array

MARKS = ((0.95, "o"), (0.99, "D"))
#: Of further laws, in order.
OTHERS = ((style.GREEN, (0, (7, 1.5))), (style.PURPLE, (0, (4, 1.2, 1, 1.2))), (style.ORANGE, (0, (2, 1))))


@dataclass(frozen=True)
class _Panel:
    """A quantity of the body against time."""

    label: str
    quantity: str
    of: Callable[[History], Array]


SETTLEMENT = _Panel("settlement max$(-u_2)$", "displacement", lambda history: history.settlement)
HEAVE = _Panel("heave max$(u_2)$", "displacement", lambda history: history.heave)
DISPLACEMENT = _Panel("largest displacement max$|u|$", "displacement", lambda history: history.displacement)
PRESSURE = _Panel("largest", "pressure", lambda history: history.pressure_max)
SUCTION = _Panel("least", "pressure", lambda history: history.pressure_min)
DRAINED = _Panel("drained volume", "volume", lambda history: history.drained)
#: The publication's own measure of it.
PAPER = _Panel("", "volume", lambda history: history.drained_paper)


def _panels(solutions: Sequence[MacroSolution], settles: bool) -> list[_Panel]:
    """Return what is drawn: heave of a body that rises by all laws, the least pressure where there is only suction."""
    found = [solution_metrics(each) for each in solutions]
    upright = any(each["moves_along_y"] for each in found)
    moved = (HEAVE if all(map(rises, found)) else SETTLEMENT) if upright else DISPLACEMENT
    pressure = SUCTION if all(map(only_suction, found)) else PRESSURE
    # In two lines, for its panel is low.
    label = f"{pressure.label} {pressure_label(solutions[0])}".replace(" fluid", "\nfluid")
    named_pressure = replace(pressure, label=label)
    return [*([moved] if settles else []), named_pressure, DRAINED]


def pressure_label(solution: MacroSolution) -> str:
    """Return the name of the unknown p with its symbol."""
    symbol = r"$\mu$" if solution.has_charges else "$p$"
    return f"{solution.pressure} {symbol}"


@styled
def history_figure(
    nonlinear: MacroSolution,
    linear: MacroSolution | None,
    *others: MacroSolution,
    log_time: bool = False,
    settles: bool = True,
    published: bool = False,
) -> Figure:
    """Draw histories of one load, the cell's law against linear poroelasticity.

    Parameters
    ----------
    nonlinear, linear
        Two solutions of one problem; None: without the linear one.
    *others
        Further nonlinear ones, such as with another closure; each is then called by its law.
    log_time
        Logarithmic time axis; the state at rest, t = 0, is then left out.
    settles
        Whether the settlement is a result; one that is prescribed is not drawn.
    published
        Draw the publication's own measure of the drained volume too, dotted.

    The panels are largest settlement, largest pore pressure, drained volume. Where the body moves further up than down
    the first is the largest heave, where it hardly moves along y the largest displacement. Where no pressure is
    positive the second is the least one.
    """
    figure = new_figure(5.4, 7.6 if settles else 5.4)
    rows = list(figure.subplots(3 if settles else 2, 1, sharex=True))
    curves = _curves(nonlinear, linear, others)
    panels = _panels([each for each, *_ in curves], settles)
    for solution, colour, stroke, label in curves:
        _draw(rows, panels, solution, log_time, {"color": colour, "ls": stroke, "label": label})
        if published:
            how = {"color": colour, "ls": style.DOTTED, "lw": 2.4, "alpha": 0.75}
            _draw(rows[-1:], [PAPER], solution, log_time, how)
    drawn = [each.history for each, *_ in curves]
    marked = any(
        time_within(each.time, each.settlement, share) is not None for each in drawn for share, _ in MARKS
    )
    _shared_legend(rows[-1], MARKS if SETTLEMENT in panels and marked else (), published)
    for axes, panel in zip(rows, panels, strict=True):
        axes.set_ylabel(axis_label(panel.label, panel.quantity))
    rows[-1].set_xlabel(axis_label("time $t$", "time") + (", logarithmic" if log_time else ""))
    for axes in rows:
        if axes.dataLim.ymin >= 0:
            axes.set_ylim(bottom=0)
        axes.margins(x=0.01)
    if log_time:
        rows[-1].set_xscale("log")
    else:
        rows[-1].set_xlim(left=0)
    figure.align_ylabels()
    legend_above(figure, rows[-1], columns=2)
    return figure


def _draw(
    rows: Sequence[Axes],
    panels: Sequence[_Panel],
    solution: MacroSolution,
    log_time: bool,
    how: dict[str, Any],
) -> None:
    """Draw one solution in all panels; the state at rest is left out of a logarithmic axis."""
    units, history = units_now(), solution.history
    by = units.factor("time")
    time, shown = history.time, history.time > 0 if log_time else history.time >= 0
    for axes, panel in zip(rows, panels, strict=True):
        values = panel.of(history) * units.factor(panel.quantity)
        axes.plot(time[shown] * by, values[shown], **how)
        for share, mark in MARKS if panel is SETTLEMENT else ():
            _mark(axes, time * by, values, share, mark, how["color"])


def _curves(
    nonlinear: MacroSolution, linear: MacroSolution | None, others: tuple[MacroSolution, ...]
) -> list[tuple[MacroSolution, str, Any, str]]:
    """Return each solution with its colour, line style and label."""
    return [
        (nonlinear, style.NONLINEAR, "-", nonlinear.law if others else "nonlinear"),
        *([] if linear is None else [(linear, style.LINEAR, style.DASHED, "linear")]),
        *(
            (other, colour, stroke, other.law)
            for other, (colour, stroke) in zip(others, OTHERS, strict=False)
        ),
    ]


def _shared_legend(axes: Axes, marks: Sequence[tuple[float, str]], published: bool) -> None:
    """Add empty grey curves, whose legend explains the strokes and markers that all laws share."""
    if published:
        axes.plot([], [], color="0.35", ls=style.DOTTED, lw=2.4, label="drained, the paper's measure")
    for share, marker in marks:
        axes.plot([], [], color="0.35", ls="", marker=marker, ms=5, label=f"{100 * share:.0f} % of final")


def _mark(axes: Axes, time: Array, value: Array, share: float, marker: str, colour: str) -> None:
    when = time_within(time, value, share)
    if when is not None:
        axes.plot(
            when, np.interp(when, time, value), marker=marker, ms=5.5, color=colour, mec="white", mew=0.8
        )


@dataclass(frozen=True)
class ProfileField:
    """Field of a :class:`~porocore.interfaces.solution.Profile`: label, values, quantity, and by node or by element.

    A quantity of None is a plain number whose label has a unit.
    """

    label: str
    plain: str
    take: Callable[[Profile], Array]
    quantity: str | None = ""
    nodal: bool = False


PROFILE_FIELDS: dict[str, ProfileField] = {
    "p": ProfileField("pore pressure $p$", "pore pressure", lambda f: f.p, "pressure", nodal=True),
    "settlement": ProfileField(
        "settlement $-u_2$", "settlement", lambda f: -f.u[:, 1], "displacement", nodal=True
    ),
    "H22": ProfileField(
        r"$\partial u_2 / \partial X_2$",
        "macroscopic displacement gradient ∂u₂/∂X₂",
        lambda f: f.grad_u[:, 1, 1],
    ),
    "mean_grad_22": ProfileField(
        r"$\langle\nabla_Y u^1\rangle_{22}$",
        "mean microscopic displacement gradient, component 22",
        lambda f: f.mean_grad[:, 1, 1],
    ),
    "mean_grad_11": ProfileField(
        r"$\langle\nabla_Y u^1\rangle_{11}$",
        "mean microscopic displacement gradient, component 11",
        lambda f: f.mean_grad[:, 0, 0],
    ),
    "K22": ProfileField(
        r"conductivity $(K_t)_{22}$",
        "transformed conductivity along the column",
        lambda f: f.conductivity[:, 1, 1],
        "conductivity",
    ),
    "K11": ProfileField(
        r"conductivity $(K_t)_{11}$",
        "transformed conductivity across the column",
        lambda f: f.conductivity[:, 0, 0],
        "conductivity",
    ),
    "F22": ProfileField(
        r"deformation $\bar F_{22}$",
        "mean deformation gradient, component 22",
        lambda f: f.deformation[:, 1, 1],
    ),
    "F11": ProfileField(
        r"deformation $\bar F_{11}$",
        "mean deformation gradient, component 11",
        lambda f: f.deformation[:, 0, 0],
    ),
    "P22": ProfileField(
        "total stress $P_{E,22}$", "total stress along the column", lambda f: f.stress[:, 1, 1], "stress"
    ),
    "flux": ProfileField(
        r"fluid flux $(\bar G w)_2$", "fluid flux upwards", lambda f: f.flux[:, 1], "velocity"
    ),
}


@dataclass(frozen=True, eq=False)
class ColumnAxis:
    """Nodes and elements along the y axis through the corner of least x and z, in order of y."""

    nodes: npt.NDArray[np.int64]  #: (k,) indices
    node_y: Array  #: (k,)
    elements: npt.NDArray[np.int64]  #: (e,) indices
    element_y: Array  #: (e,) centres
    ends: Array  #: (e, 2) least and largest y of each element

    @classmethod
    def from_solution(cls, solution: MacroSolution) -> ColumnAxis:
        """Return the axis of a box mesh."""
        points, cells = solution.points, solution.cells
        slack = 1e-9 * float(np.ptp(points, axis=0).max())
        corner = points.min(axis=0)
        on_axis = (np.abs(points[:, [0, 2]] - corner[[0, 2]]) < slack).all(axis=1)
        nodes = np.flatnonzero(on_axis)
        nodes = nodes[np.argsort(points[nodes, 1], kind="stable")]
        elements = np.flatnonzero(on_axis[cells].any(axis=1))
        ends = np.stack(
            [points[cells[elements], 1].min(axis=1), points[cells[elements], 1].max(axis=1)], axis=1
        )
        order = np.argsort(ends[:, 0], kind="stable")
        return cls(nodes, points[nodes, 1], elements[order], ends[order].mean(axis=1), ends[order])

    def series(self, profile: Profile, quantity: ProfileField) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
        """Return positions, values and flags (outside the training range), each (k,) or (e,)."""
        flagged = profile.flagged[self.elements] > 0
        if not quantity.nodal:
            return self.element_y, quantity.take(profile)[self.elements], flagged
        slack = 1e-9 * float(self.node_y[-1] - self.node_y[0])
        low, high = self.ends[flagged].T
        inside = (self.node_y[:, None] >= low - slack) & (self.node_y[:, None] <= high + slack)
        return self.node_y, quantity.take(profile)[self.nodes], inside.any(axis=1)


@styled
def profile_figure(
    nonlinear: MacroSolution,
    linear: MacroSolution | None,
    quantity: str | ProfileField,
    *,
    others: Sequence[MacroSolution] = (),
    times: Sequence[float] | None = None,
    rest: float | None = None,
) -> Figure:
    """Draw one field along the column, solid for the cell's law and dashed for linear poroelasticity.

    Parts in which the cell law was flagged are pale with hollow markers.

    Parameters
    ----------
    nonlinear, linear
        Two solutions with profiles at the same times; None: without the linear one.
    quantity
        A key of :data:`PROFILE_FIELDS`, or one of one's own.
    others
        Solutions with other closures, drawn dotted.
    times
        Which profiles to show, six at most; None: all but the closing one (if there are others).
    rest
        Value of the undeformed cell, drawn as a line.

    Raises
    ------
    ValueError
        The quantity is unknown, or a solution has no profile at one of the times.
    """
    what = field_of(nonlinear, quantity)
    times = chosen_times(nonlinear) if times is None else times
    units = units_now()
    length, factor = units.factor("displacement"), units.factor(what.quantity or "")
    figure = new_figure(5.4, 4.0)
    axes = figure.add_subplot()
    line = ColumnAxis.from_solution(nonlinear)
    compared: list[tuple[MacroSolution, Any, str]] = (
        [] if linear is None else [(linear, style.DASHED, "linear")]
    )
    compared += [(other, style.DOTTED, f"closure {other.law}") for other in others]
    for time, colour in zip(times, style.TIME_COLOURS, strict=False):
        for solution, stroke, _ in compared:
            y, value, _ = ColumnAxis.from_solution(solution).series(profile_at(solution, time), what)
            axes.plot(y * length, value * factor, color=colour, ls=stroke, lw=1.3)
        y, value, flagged = line.series(profile_at(nonlinear, time), what)
        if flagged.any():
            _flagged_parts(axes, y * length, value * factor, flagged, colour)
        value, label = np.where(flagged, np.nan, value * factor), f"$t$ = {units.text(time, 'time', 6)}"
        axes.plot(y * length, value, color=colour, label=label)
    for _, stroke, label in compared:
        axes.plot([], [], color="0.35", ls=stroke, lw=1.3, label=label)
    if rest is not None:
        axes.axhline(rest * factor, color=style.GREY, ls=style.DASHED, lw=1.0, label="undeformed cell")
    axes.set_xlabel(axis_label("position along the column $X_2$", "displacement"))
    axes.set_ylabel(what.label if what.quantity is None else axis_label(what.label, what.quantity))
    axes.margins(x=0.02)
    if any(
        line.series(profile_at(nonlinear, time), what)[2].any() for time in times[: len(style.TIME_COLOURS)]
    ):
        axes.plot([], [], color="0.65", marker="o", ms=3.6, mfc="white", mec="0.5", label="flagged")
    legend_above(figure, axes, columns=3)
    return figure


def field_of(solution: MacroSolution, quantity: str | ProfileField) -> ProfileField:
    """Return a field of the profiles of a solution, by the name that it has there; ValueError if it is unknown."""
    if not isinstance(quantity, str):
        return quantity
    if quantity not in PROFILE_FIELDS:
        raise ValueError(f"unknown quantity '{quantity}'; choose from {', '.join(PROFILE_FIELDS)}")
    found = PROFILE_FIELDS[quantity]
    return (
        replace(found, label=pressure_label(solution), plain=solution.pressure) if quantity == "p" else found
    )


def _flagged_parts(axes: Axes, y: Array, value: Array, flagged: npt.NDArray[np.bool_], colour: str) -> None:
    """Draw the whole curve pale, with hollow markers where it is flagged."""
    every = max(1, len(y) // 24)
    axes.plot(y, value, color=lighter(colour), lw=1.7)
    spots = np.flatnonzero(flagged)[::every]
    axes.plot(y[spots], value[spots], ls="", marker="o", ms=3.6, mfc="white", mec=lighter(colour, 0.4))


def is_column(solution: MacroSolution) -> bool:
    """Tell whether the body is a column of single elements along y, which profiles along its axis describe fully."""
    return solution.cells.shape[1] == 27 and len(ColumnAxis.from_solution(solution).elements) == len(
        solution.cells
    )


def chosen_times(solution: MacroSolution) -> tuple[float, ...]:
    """Return the times of the profiles after rest, without the last one if there are others; six at most."""
    times = tuple(profile.time for profile in solution.after_rest)
    return times[: max(1, len(times) - 1)][: len(style.TIME_COLOURS)]


def profile_at(solution: MacroSolution, time: float) -> Profile:
    """Return the profile at ``time``; ValueError if none was kept."""
    for profile in solution.profiles:
        if abs(profile.time - time) <= 1e-9 * max(1.0, abs(time)):
            return profile
    kept = ", ".join(f"{profile.time:g}" for profile in solution.profiles)
    raise ValueError(f"the {solution.law} solution has no profile at t = {time:g}; it has {kept or 'none'}")


#: A peak within this share of the time, and the most of what happens with it, would be a line of one pixel.
EARLY = 0.05
#: A curve that ends this share below its peak has one.
FALLS = 0.01
#: Panel of the forces of indenters.
FORCES = "forces of indenters"
#: A component below this share of the largest of its kind is round-off, or of no interest, and not drawn.
VISIBLE = 1e-3


@dataclass(frozen=True)
class Panel:
    """Curves of one kind of quantity.

    Attributes
    ----------
    label
        Of the axis, without its unit.
    quantity
        Of :data:`porocore.core.units.QUANTITIES`.
    plain
        In words.
    curves
        Name of each, and its values.
    sign
        What is positive, where that is a convention.
    """

    label: str
    quantity: str
    plain: str
    curves: dict[str, Array]
    sign: str = ""


def panels(solution: MacroSolution) -> Iterator[Panel]:
    """Yield panels of pressures and displacements of probes, forces and inflows, as far as there are any."""
    probes, compression, inflow = (
        {named(name): values for name, values in kind.items()}
        for kind in (solution.probes, solution.compression, solution.inflow)
    )
    displacements = {f"{name} $u_{i + 1}$": v[:, i] for name, v in probes.items() for i in range(3)}
    pressures, forces = {n: v[:, 3] for n, v in probes.items()}, "forces of held or moved surfaces"
    for panels_of_kind in (
        [Panel(pressure_label(solution), "pressure", "pressure at the probes", pressures)],
        [Panel("displacement", "displacement", "displacement of the probes", displacements)],
        [
            Panel("compressive force", "force", forces, compression, "positive in compression"),
            Panel(
                "force on the body", "force", f"other {forces}", _others(solution), "positive along the axis"
            ),
        ],
        *_indenters(solution),
        [
            Panel(
                "inflow of fluid",
                "flow",
                "inflow through surfaces of given pressure"
                + (" and their images in the whole body" if solution.copies > 1 else ""),
                inflow,
                "positive into the body",
            )
        ],
    ):
        sizes = [np.abs(v).max() for panel in panels_of_kind for v in panel.curves.values()]
        largest = max(map(float, sizes), default=0.0)
        for panel in panels_of_kind:
            kept = {name: v for name, v in panel.curves.items() if np.abs(v).max() > VISIBLE * largest}
            if kept:
                yield replace(panel, curves=kept)


def _indenters(solution: MacroSolution) -> Iterator[list[Panel]]:
    """Yield panels of the columns of all indenters that are drawn against time."""
    for column, label, quantity, plain, sign in (
        (0, "force of the indenter", "force", FORCES, "positive along its direction"),
        (1, "displacement of the indenter", "displacement", "displacement of indenters", ""),
        (
            3,
            "contact radius",
            "displacement",
            "contact radius of indenters",
            "of a circle of the touched area",
        ),
        (4, "largest contact pressure", "pressure", "largest contact pressure of indenters", ""),
    ):
        curves = {
            named(name): values[:, column]
            for name, values in solution.contact.items()
            if column != 3 or has_radius(values)
        }
        if curves:
            yield [Panel(label, quantity, plain, curves, sign)]


@styled
def indentation_figure(nonlinear: MacroSolution, linear: MacroSolution | None) -> Figure:
    """Draw the force of each indenter against its displacement, linear poroelasticity dashed."""
    figure, units = new_figure(5.4, 3.6), units_now()
    axes = figure.add_subplot()

    def line(values: Array, **how: Any) -> None:
        axes.plot(values[:, 1] * units.factor("displacement"), values[:, 0] * units.factor("force"), **how)

    for i, (name, values) in enumerate(nonlinear.contact.items()):
        colour = style.TIME_COLOURS[i % len(style.TIME_COLOURS)]
        # Of what happens within a step nothing is known, so that the steps are marked.
        line(values, color=colour, marker=".", ms=3.5, label=named(name))
        if linear is not None and name in linear.contact:
            line(linear.contact[name], color=colour, ls=style.DASHED, lw=1.3)
    if linear is not None:
        axes.plot([], [], color="0.35", ls=style.DASHED, lw=1.3, label="linear")
    axes.set_xlabel(axis_label("displacement of the indenter", "displacement"))
    axes.set_ylabel(axis_label("force of the indenter", "force"))
    legend_above(figure, axes, columns=3)
    return figure


def _others(solution: MacroSolution) -> dict[str, Array]:
    """Return the components of the forces that are not the compressive force on the same surface."""
    found = {}
    for name, force in solution.reactions.items():
        pressed = solution.compression.get(name)
        for i, axis in enumerate("xyz"):
            values = force[:, i]
            if pressed is None or not _same(np.abs(values), np.abs(pressed)):
                found[f"{named(name)}, along {axis}"] = values
    return found


def _same(one: Array, other: Array) -> bool:
    return bool(np.abs(one - other).max() <= VISIBLE * np.abs(other).max())


def early_peak(time: Array, curves: Iterable[Array]) -> float | None:
    """Return the time of the first peak if it and most of what happens come early in the run; otherwise None."""
    end, early = float(time[-1]), time[1:] <= EARLY * time[-1]
    peaks, changes = [], np.zeros(len(time) - 1)
    for values in curves:
        size = np.abs(values)
        if size[-1] < (1 - FALLS) * size.max():
            peaks.append(float(time[size.argmax()]))
        changes += np.abs(np.diff(values)) / max(float(np.ptp(values)), np.finfo(float).tiny)
    first = min(peaks, default=end)
    happens = changes[early].sum() >= changes.sum() / 2
    return first if 0 < first <= EARLY * end and happens else None


def _logarithmic_after(axes: Axes, bend: float, end: float) -> None:
    """Give the axis of time one scale from 0 to ``bend`` and a logarithmic one from there to ``end``."""
    axes.set_xscale("symlog", linthresh=bend, linscale=0.6)
    decades = 10.0 ** np.arange(np.floor(np.log10(bend)), np.ceil(np.log10(end)) + 1)
    later = [each for each in decades if 1.5 * bend < each <= end * 1.001]
    axes.set_xticks([0.0, bend, *later], [_short(each) for each in (0.0, bend, *later)])
    axes.set_xticks([], minor=True)


def _short(time: float) -> str:
    return f"{float(f'{time:.3g}'):g}"


def end_of_rise(solution: MacroSolution, panel: Panel) -> float | None:
    """Return the time at which the largest curve peaks, if it falls from there; otherwise None."""
    values = np.abs(max(panel.curves.values(), key=lambda each: float(np.abs(each).max())))
    step = int(values.argmax())
    falls = step < len(values) - 2 and values[-1] < (1 - FALLS) * values[step]
    return float(solution.history.time[step]) if falls else None


@styled
def relaxation_figure(nonlinear: MacroSolution, linear: MacroSolution | None, plain: str) -> Figure:
    """Draw the panel called ``plain``, which falls, against the logarithm of the time from its peak."""
    panel = next(p for p in panels(nonlinear) if p.plain == plain)
    figure = new_figure(5.4, 3.6)
    axes = figure.add_subplot()
    begin = end_of_rise(nonlinear, panel) or 0.0
    _draw_series(axes, panel, nonlinear, linear, begin)
    axes.set_xscale("log")
    axes.set_xlabel(axis_label("time from the peak", "time") + ", logarithmic")
    legend_above(figure, axes, columns=3)
    return figure


@styled
def series_figure(nonlinear: MacroSolution, linear: MacroSolution | None, plain: str) -> Figure:
    """Draw the panel called ``plain`` against time, the cell's law solid and linear poroelasticity dashed."""
    panel = next(p for p in panels(nonlinear) if p.plain == plain)
    figure = new_figure(5.4, 3.6)
    axes, t = figure.add_subplot(), units_now().factor("time")
    _draw_series(axes, panel, nonlinear, linear)
    axes.set_xlabel(axis_label("time $t$", "time"))
    forces = [values[:, 0] for values in nonlinear.contact.values()]  # by which all figures of a hold are cut
    bend = early_peak(nonlinear.history.time, (*panel.curves.values(), *forces))
    if bend is not None:
        _logarithmic_after(axes, bend * t, float(nonlinear.history.time[-1]) * t)
        axes.set_xlabel(f"{axes.get_xlabel()}, logarithmic after {_short(bend * t)}")
    legend_above(figure, axes, columns=3)
    return figure


def _draw_series(
    axes: Axes,
    panel: Panel,
    nonlinear: MacroSolution,
    linear: MacroSolution | None,
    begin: float | None = None,
) -> None:
    """Draw the curves of a panel, against time or the time from ``begin`` on."""
    others = {} if linear is None else {p.plain: p.curves for p in panels(linear)}.get(panel.plain, {})
    t, factor = units_now().factor("time"), units_now().factor(panel.quantity)

    def line(solution: MacroSolution, values: Array, **how: Any) -> None:
        time = solution.history.time
        later = time > (-np.inf if begin is None else begin)
        axes.plot((time[later] - (begin or 0.0)) * t, values[later] * factor, **how)

    drawn: dict[str, list[str]] = {}
    for name, values in panel.curves.items():
        # Of curves that cover each other, such as the forces at both ends of a column, one is drawn.
        same = next((other for other in drawn if _same(values, panel.curves[other])), name)
        drawn.setdefault(same, []).append(name)
    for i, (name, names) in enumerate(drawn.items()):
        colour = style.TIME_COLOURS[i % len(style.TIME_COLOURS)]
        line(nonlinear, panel.curves[name], color=colour, label=" and ".join(names))
        if linear is not None and name in others:
            line(linear, others[name], color=colour, ls=style.DASHED, lw=1.3)
    if linear is not None:
        axes.plot([], [], color="0.35", ls=style.DASHED, lw=1.3, label="linear")
    sign = f"\n({panel.sign})" if panel.sign else ""
    axes.set_ylabel(axis_label(panel.label, panel.quantity) + sign)
    axes.margins(x=0.01)
