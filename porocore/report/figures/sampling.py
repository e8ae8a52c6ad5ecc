"""Figures of the solved states by status, and of a surrogate: errors and losses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy.spatial import ConvexHull, QhullError

from porocore.core.echo import choices
from porocore.core.inputs import NAMES, InputSpace
from porocore.core.units import units_now
from porocore.interfaces.solution import MacroSolution
from porocore.report.context import ReportContext, TrainingCurve
from porocore.report.figures import style
from porocore.report.figures.curves import is_column
from porocore.report.figures.style import axis_label, legend_above, new_figure, styled
from porocore.report.format import number
from porocore.report.words.held_out import OutputCheck, rms_percent, worst_percent
from porocore.states import Array, IntArray, Status

#: Inputs that no axis shows in a line.
IN_A_LINE = 2
#: Marker, colour, filled, size and label of each status; shape and fill tell them apart without colour.
MARKERS: dict[Status, tuple[str, str, bool, float, str]] = {
    Status.converged: ("o", style.BLUE, True, 3.6, "converged"),
    Status.contact: ("D", style.SKY, True, 4.2, "contact"),
    Status.unstable: ("^", style.ORANGE, True, 5.5, "unstable"),
    Status.overlap: ("s", style.VERMILLION, False, 4.6, "overlap"),
    Status.inverted: ("x", style.BLACK, True, 5.5, "inverted"),
    Status.not_converged: ("+", style.PURPLE, True, 7.0, "not converged"),
    Status.lost: ("v", style.GREY, False, 5.5, "lost"),
}


@styled
def samples_figure(
    inputs: InputSpace,
    x: Array,
    status: IntArray,
    *,
    training: npt.NDArray[np.bool_] | None = None,
    pair: tuple[str, str] | None = None,
    visited: Sequence[Array] = (),
    crease: tuple[float, float] | None = None,
    column: bool = True,
    quantities: Mapping[str, str] | None = None,
) -> Figure:
    """Draw the sampled states in the plane of two inputs, by status.

    Parameters
    ----------
    inputs
        The d sampled inputs.
    x : (n, d)
        Their values.
    status : (n,) int
        :class:`porocore.states.Status` of each.
    training : (n,) bool
        Rows that were trained on; their hull (projected) is outlined. None: no outline.
    pair
        Names of the inputs on the two axes; None: H22 and p if both were sampled, else the first two. A study
        of one input has an axis of that input only.
    visited : sequence of (k, d)
        States in the body at one time each: of a column a line along its axis, of any other body markers.
    crease : (2,)
        (a, b) of the line H_22 = a + b p beyond which ridges fold; drawn if the axes are H22 and p.
    column
        Whether the body is a column.
    quantities
        Quantity of each parameter of the cell that has a unit.

    Inputs on no axis are named under it with the range of their values in the sampled states.
    """
    columns = _columns(inputs, pair)
    figure = new_figure(6.4, 4.6 if len(columns) == 2 else 2.2)
    axes = figure.add_subplot()
    names = tuple(inputs.names[i] for i in columns)
    known = {"p": "pressure", **(quantities or {})}
    factors = [units_now().factor(known.get(name, "")) for name in names]
    plane = _project(x, columns, factors)
    if training is not None and training.any():
        _outline(axes, plane[training])
    _states(axes, plane, status)
    if crease is not None and names == ("H22", "p"):
        _crease(axes, crease, inputs)
    _visited(axes, [_project(path, columns, factors) for path in visited], column)
    axes.set_xlabel("\n".join([input_label(names[0], known), *_elsewhere(inputs, x, columns, known)]))
    if len(names) == 2:
        axes.set_ylabel(input_label(names[1], known))
    else:
        axes.yaxis.set_visible(False)
    legend_above(figure, axes, columns=3)
    return figure


def samples_of(context: ReportContext) -> Figure:
    """Draw the sampled states of a run, and those in its body at the kept times; see :func:`samples_figure`."""
    sampling = context.sampling
    parameters = () if context.family is None else context.family.parameters
    return samples_figure(
        sampling.inputs,
        sampling.x,
        sampling.status,
        training=sampling.training,
        visited=[path for case in context.cases for path in _in_body(case.nonlinear, sampling.inputs)],
        crease=context.cell.crease,
        column=is_column(context.cases[0].nonlinear),
        quantities={each.name: each.quantity for each in parameters},
    )


def _in_body(solution: MacroSolution, inputs: InputSpace) -> list[Array]:
    """Return the inputs at the elements of each kept profile, upwards."""
    height = solution.points[solution.cells, 1].mean(axis=1)
    order = np.argsort(height, kind="stable")
    return [
        inputs.gather(inputs.without_rotation(solution.cell_states(i)[order]))
        for i in range(len(solution.profiles))
    ]


def _visited(axes: Axes, paths: Sequence[Array], column: bool) -> None:
    """Draw the states in the body; a line carries markers, without which a path of one place is invisible."""
    for k, path in enumerate(paths):
        axes.plot(
            *path.T,
            color=style.GREEN,
            lw=1.6 if column else 0,
            marker="*",
            ms=7,
            mew=0,
            # The ends and a few between tell a line from a place.
            markevery=max(1, len(path) // 4) if column else None,
            label=f"states in the {'column' if column else 'body'}" if k == 0 else "_nolegend_",
            rasterized=not column,
            zorder=3,
        )


def _elsewhere(
    inputs: InputSpace, x: Array, columns: Sequence[int], quantities: Mapping[str, str]
) -> list[str]:
    """Return lines on the inputs that no axis shows."""
    others = [i for i in range(len(inputs)) if i not in columns]
    if not others or not len(x):
        return []
    told = []
    for i in others:
        name = inputs.names[i]
        quantity, units = quantities.get(name, ""), units_now()
        low, high = (number(float(end(x[:, i])) * units.factor(quantity), 2) for end in (np.min, np.max))
        unit = f" {units.name(quantity)}" if quantity and units.given else ""
        told.append(f"{_sign(name)} from {low} to {high}{unit}")
    lines = [", ".join(told[k : k + IN_A_LINE]) for k in range(0, len(told), IN_A_LINE)]
    return ["on no axis, but projected:", *lines]


def input_label(name: str, quantities: Mapping[str, str] | None = None) -> str:
    """Return the label of an input with its unit; ``quantities`` are those of parameters of the cell."""
    if name == "p":
        return axis_label("pore pressure $p$", "pressure", units_now())
    return axis_label(_sign(name), (quantities or {}).get(name, ""), units_now())


def _sign(name: str) -> str:
    """Return the sign of an input; a parameter of the cell goes by its name."""
    if name not in NAMES:
        return name
    return "$p$" if name == "p" else rf"$\partial u_{name[1]} / \partial X_{name[2]}$"


def _columns(inputs: InputSpace, pair: tuple[str, str] | None) -> list[int]:
    if pair is None:
        if len(inputs) == 1:
            return [0]
        pair = ("H22", "p") if {"H22", "p"} <= set(inputs.names) else (inputs.names[0], inputs.names[1])
    for name in pair:
        if name not in inputs.names:
            raise ValueError(f"'{name}' was not sampled; {choices(inputs.names, 'the inputs are')}")
    return [inputs.names.index(name) for name in pair]


def _project(x: Array, columns: list[int], factors: Sequence[float]) -> Array:
    shown = [x[:, column] * factor for column, factor in zip(columns, factors, strict=True)]
    return np.column_stack([shown[0], shown[1] if len(columns) == 2 else np.zeros(len(x))])


def _states(axes: Axes, points: Array, status: IntArray) -> None:
    for which, (marker, colour, filled, size, label) in MARKERS.items():
        rows = points[status == which]
        if len(rows):
            axes.plot(
                *rows.T,
                ls="",
                marker=marker,
                ms=size,
                mec=colour,
                mfc=colour if filled else "none",
                mew=1.0,
                label=f"{label} ({len(rows)})",
            )


def _outline(axes: Axes, points: Array) -> None:
    try:
        corners = points[ConvexHull(points / np.ptp(points, axis=0).clip(1e-300)).vertices]
    except (QhullError, ValueError):  # too few points, or all on one line
        return
    axes.fill(*corners.T, fc=style.SKY, alpha=0.13, lw=0)
    axes.plot(*np.vstack([corners, corners[:1]]).T, color=style.GREY, lw=1.1, label="sampled range")


def _crease(axes: Axes, crease: tuple[float, float], inputs: InputSpace) -> None:
    p = inputs.names.index("p")
    ends = np.array([max(0.0, inputs.lower[p]), inputs.upper[p]])  # it was found for p >= 0
    shown = ends * units_now().factor("pressure")
    axes.plot(
        crease[0] + crease[1] * ends,
        shown,
        color=style.BLACK,
        ls=style.DASHED,
        lw=1.2,
        label="crease on a very fine mesh",
    )


@styled
def parity_figure(checks: Sequence[OutputCheck]) -> Figure:
    """Draw predicted against solved held-out states, one column of panels for each output, errors beneath.

    Held-out states beyond the sampled range are grey and hollow and do not count in the error in the panel, unless
    there are no others.
    """
    figure = new_figure(4.4 * len(checks), 5.0)
    panels = figure.subplots(2, len(checks), squeeze=False, sharex="col", height_ratios=[3, 1.25])
    for check, parity, error in zip(checks, *panels, strict=True):
        factor = units_now().factor(check.quantity)
        solved, predicted = check.solved * factor, check.predicted * factor
        both = np.concatenate([solved, predicted])
        ends = np.array([both.min(), both.max()]) if len(both) else np.array([0.0, 1.0])
        ends = ends + 0.04 * (ends[1] - ends[0]) * np.array([-1, 1])
        parity.plot(ends, ends, color=style.GREY, lw=1.0)
        deviation = 100 * (check.predicted - check.solved) / check.span
        for axes, y in ((parity, predicted), (error, deviation)):
            beyond = check.flagged
            if beyond.any():
                axes.plot(solved[beyond], y[beyond], "o", ms=4, mfc="white", mec=style.GREY, mew=0.9)
            axes.plot(solved[~beyond], y[~beyond], "o", ms=4, mfc=style.BLUE, mec="white", mew=0.4)
        error.axhline(0, color=style.GREY, lw=1.0)
        parity.set(xlim=ends, ylim=ends, ylabel=axis_label(f"predicted {check.name}", check.quantity))
        error.set(xlabel=axis_label(f"solved {check.name}", check.quantity), ylabel="error [% of range]")
        error.xaxis.set_major_locator(MaxNLocator(5))
        parity.text(0.04, 0.96, _error_text(check), transform=parity.transAxes, va="top", fontsize=9)
    figure.align_ylabels()
    return figure


@styled
def training_figure(curve: TrainingCurve) -> Figure:
    """Draw losses against epochs, logarithmic; the best validation loss is marked where states were kept for it."""
    figure = new_figure(5.4, 3.6)
    axes = figure.add_subplot()
    axes.semilogy(curve.epoch, curve.loss, color=style.BLUE, lw=1.3, label="training")
    if curve.validated:
        axes.semilogy(
            curve.epoch,
            curve.validation_loss,
            color=style.VERMILLION,
            lw=1.3,
            ls=(0, (4, 1.5)),
            label="validation",
        )
        best = int(np.nanargmin(curve.validation_loss))
        axes.plot(
            curve.epoch[best],
            curve.validation_loss[best],
            "v",
            ms=8,
            mfc="white",
            mec=style.VERMILLION,
            mew=1.5,
            label=f"best, epoch {curve.epoch[best]:.0f}",
        )
    axes.set(
        xlabel="epoch" if curve.validated else "iteration", ylabel="loss (mean squared error, scaled) [–]"
    )
    axes.margins(x=0.02)
    legend_above(figure, axes, columns=3)
    return figure


@styled
def tuning_figure(
    points: Sequence[tuple[str, int, float]], chosen: tuple[int, float], limit: float
) -> Figure:
    """Draw (activation, parameters, error) with the chosen one ringed and the largest error that is good enough."""
    figure = new_figure(6.4, 3.8)
    axes = figure.subplots()
    colours = (style.BLUE, style.ORANGE, style.GREEN, style.PURPLE)
    for i, activation in enumerate(dict.fromkeys(name for name, _, _ in points)):
        own = [(size, 100 * error) for name, size, error in points if name == activation]
        axes.plot(*zip(*own, strict=True), "o", ms=5, color=colours[i % len(colours)], label=activation)
    axes.axhline(100 * limit, color=style.GREY, ls=style.DASHED, lw=1, label="within the margin of the best")
    axes.plot(
        chosen[0], 100 * chosen[1], "o", ms=13, mfc="none", mec="black", mew=1.4, label="smallest of these"
    )
    axes.set(xscale="log", yscale="log", xlabel="weights and biases")
    axes.set_ylabel("error on held-out states [% of the range]")
    axes.legend()
    return figure


def _error_text(check: OutputCheck) -> str:
    rms, worst, beyond = rms_percent(check), worst_percent(check), int(check.flagged.sum())
    if rms is None or worst is None:
        text = "no held-out states"
    else:
        text = f"RMS {rms:.2g} % of range\nworst {worst:.2g} %\n{int(check.counted.sum())} states"
    if check.all_outside:
        return text + ", all beyond the range (hollow)"
    return text + (f"\n({beyond} beyond the range, hollow)" if beyond else "")
