"""Table and picture of a sweep: sweep.csv, sweep.png and sweep.svg."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from porocore.core.files.plain_data import write_csv
from porocore.interfaces.solution import MacroSolution
from porocore.report.figures import style
from porocore.states import Array
from porocore.study.run.folder import LINEAR as LINEAR_LAW
from porocore.study.sweep.results import OF_FORCES, ParameterSweep

#: Histories of the displacement, one of which is drawn.
MOVED = {
    "settlement": "settlement max$(-u_2)$",
    "heave": "heave max$(u_2)$",
    "displacement": "largest displacement max$|u|$",
}
#: Labels of the results.
LABELS = {
    "final_settlement": "final settlement",
    "largest_heave": "largest heave",
    "largest_displacement": "largest displacement",
    "largest_radius": "largest contact radius",
    "time_to_50_percent": "time to 50 %",
    "time_to_95_percent": "time to 95 %",
    "max_pressure": "largest pore pressure",
    "drained": "drained volume",
    "peak": "peak force",
    "final": "force at the end",
    "relaxed_50_percent": "time to relax 50 %",
    "relaxed_95_percent": "time to relax 95 %",
    "porosity": r"porosity $\varphi_f$",
    "K_11": "$K_{11}$",
    "K_22": "$K_{22}$",
    "K_33": "$K_{33}$",
}
#: Ratio of largest and least value from which a colour scale is logarithmic.
WIDE = 20.0
#: An axis begins at zero where the least value is below this share of the largest.
FROM_ZERO = 0.7
#: Components that differ by less than this share are one curve.
SAME = 1e-6
LEVELS = 12


@style.styled
def sweep_figure(sweep: ParameterSweep) -> Figure:
    """Draw a sweep, of several loads that which is largest in size."""
    return _over_both(sweep) if len(sweep.names) > 1 else _along(sweep)


def parameter_label(sweep: ParameterSweep, k: int) -> str:
    """Return the label of the axis of a parameter."""
    swept = sweep.plan.swept[k]
    return sweep.units.titled(style.named(swept.name.replace("_", " ")), swept.quantity)


def _places(sweep: ParameterSweep, k: int) -> Array:
    """Return the values (n,) of a parameter in the units of the study."""
    quantity = sweep.plan.swept[k].quantity
    return np.array([sweep.units.value(x, quantity) for x in sweep.values[:, k]])


def _rows(sweep: ParameterSweep) -> list[tuple[str, ...]]:
    """Return the results of the body that are drawn, those that share a panel together."""
    mode = sweep.loading_mode
    if pressed := [name for name, each in sweep.plan.family.macro.contact.items() if each.force is None]:
        return _forces(pressed[0])
    if sweep.heaves_alone:
        return [("largest_heave",), ("drained",), ("max_pressure",)]
    if mode.settles and not sweep.moves_along_y:
        return [("largest_displacement",), ("drained",), ("max_pressure",)]
    if mode.settles:
        return [("final_settlement",), ("time_to_50_percent", "time_to_95_percent"), ("max_pressure",)]
    return _forces(mode.displaced[0])


def _forces(of: str) -> list[tuple[str, ...]]:
    """Return the results of which the force on a surface, or of an indenter, is one."""
    peak, final, half, most = (f"{of}: {name}" for name in OF_FORCES)
    return [(peak, final), (half, most), ("max_pressure",)]


def _label(sweep: ParameterSweep, figure: str) -> str:
    return style.axis_label(_words(sweep, figure), sweep.quantity(figure), sweep.units)


def _words(sweep: ParameterSweep, figure: str) -> str:
    label = LABELS[figure.rpartition(": ")[2]]
    return label.replace("pore pressure", sweep.plan.family.macro.pressure)


def _along(sweep: ParameterSweep) -> Figure:
    figure = style.new_figure(12.0, 6.6)
    panels = figure.subplots(2, 3)
    places = _places(sweep, 0)
    scale = ScalarMappable(Normalize(places.min(), places.max()), _colours())
    _histories(sweep, panels[0, :2], places, scale)
    bar = figure.colorbar(scale, ax=list(panels[0, :2]), pad=0.01, aspect=28)
    bar.set_label(parameter_label(sweep, 0))
    _cells(sweep, panels[0, 2], places)
    for axes, names in zip(panels[1], _rows(sweep), strict=True):
        _against(sweep, axes, places, names)
    for axes in (panels[0, 2], *panels[1]):
        axes.set_xlabel(parameter_label(sweep, 0))
        axes.margins(x=0.03)
    _legend_of_laws(sweep, figure)
    if len(sweep.plan.family.macro.loads) > 1:
        figure.suptitle(f"load {sweep.largest_load:g}", fontsize=10)
    return figure


def _colours() -> matplotlib.colors.Colormap:
    """Return viridis without its brightest end, which is hard to see on white."""
    return matplotlib.colors.ListedColormap(matplotlib.colormaps["viridis"](np.linspace(0, 0.92, 256)))


def _histories(sweep: ParameterSweep, panels: Sequence[Axes], places: Array, scale: ScalarMappable) -> None:
    """Draw settlement, heave, or the force on the moved surface, and largest pressure against time."""
    units, settles = sweep.units, sweep.loading_mode.settles
    kind = "heave" if sweep.heaves_alone else "settlement" if sweep.moves_along_y else "displacement"
    at = dict(zip((point.name for point in sweep.plan.points), places, strict=True))
    for point in sweep.solved:
        solution = sweep.solution(point, sweep.laws[0], sweep.largest_load)
        time = solution.history.time * units.factor("time")
        colour = scale.to_rgba(at[point.name])
        moved = getattr(solution.history, kind)
        first = moved * units.factor("displacement") if settles else _force(sweep, solution)
        panels[0].plot(time, first, color=colour, lw=1.4)
        panels[1].plot(time, solution.history.pressure_max * units.factor("pressure"), color=colour, lw=1.4)
    words = MOVED[kind] if settles else f"force on {sweep.loading_mode.displaced[0]}"
    panels[0].set_ylabel(style.axis_label(words, "displacement" if settles else "force", units))
    panels[1].set_ylabel(style.axis_label(_words(sweep, "max_pressure"), "pressure", units))
    for axes in panels:
        axes.set_xlabel(style.axis_label("time $t$", "time", units))
        axes.set_xlim(left=0)
        _from_zero(axes)


def _force(sweep: ParameterSweep, solution: MacroSolution) -> Array:
    """Return the force on the first surface that is moved: compressive on a plane one, else its largest component."""
    surface, factor = sweep.loading_mode.displaced[0], sweep.units.factor("force")
    if surface in solution.compression:
        return solution.compression[surface] * factor
    force = solution.reactions[surface]
    return np.asarray(force[:, int(np.abs(force).max(axis=0).argmax())] * factor)


def _cells(sweep: ParameterSweep, axes: Axes, places: Array) -> None:
    """Draw the conductivity and the porosity of the undeformed cell; the drained volume where the body has several."""
    if "porosity" not in sweep.figures:
        _against(sweep, axes, places, ("drained",))
        return
    curves = {name: sweep.figures[name] for name in ("K_11", "K_22", "K_33")}
    first = curves["K_11"]
    if all(np.allclose(values, first, rtol=SAME) for values in curves.values()):
        curves = {"K_11": first}
    label = "$K$" if len(curves) == 1 else ""
    for (name, values), colour in zip(curves.items(), (style.BLUE, style.GREEN, style.ORANGE), strict=False):
        axes.plot(places, values, color=colour, marker=".", label=label or LABELS[name])
    axes.set_ylabel(style.axis_label("conductivity $K$", "conductivity", sweep.units))
    axes.set_ylim(bottom=0)
    other = axes.twinx()
    other.plot(places, sweep.figures["porosity"], color=style.GREY, ls=style.DASHED, label=LABELS["porosity"])
    other.set_ylabel(LABELS["porosity"])
    other.set_ylim(bottom=0)
    other.grid(visible=False)
    other.spines["right"].set_visible(True)
    handles, labels = axes.get_legend_handles_labels()
    more, names = other.get_legend_handles_labels()
    _legend_above(axes, [*handles, *more], [*labels, *names])


def _look(law: str) -> dict[str, Any]:
    colour, stroke = (style.LINEAR, style.DASHED) if law == LINEAR_LAW else (style.NONLINEAR, "-")
    return {"color": colour, "ls": stroke}


def _against(sweep: ParameterSweep, axes: Axes, places: Array, names: Sequence[str]) -> None:
    """Draw results of all laws against the parameter."""
    markers, flagged = ("o", "s"), sweep.flagged
    for law in sweep.laws:
        for name, marker in zip(names, markers, strict=False):
            column = sweep.figures.get(sweep.named(name, law))
            if column is not None:
                axes.plot(places, column, marker=marker, ms=4.5, **_look(law))
                if law != LINEAR_LAW:
                    axes.plot(places[flagged], column[flagged], ls="", marker=marker, ms=3, color="white")
    if len(names) == 1:
        axes.set_ylabel(_label(sweep, names[0]))
    else:
        quantity = sweep.quantity(names[0])
        title = "time $t$" if quantity == "time" else "force"
        axes.set_ylabel(style.axis_label(title, quantity, sweep.units))
        words = [_words(sweep, name) for name in names]
        shown = [Line2D([], [], color=style.GREY, ls="", marker=marker, ms=4.5) for marker in markers]
        _legend_above(axes, shown, words)
    _from_zero(axes)


def _legend_of_laws(sweep: ParameterSweep, figure: Figure) -> None:
    """Put a legend of what all panels below share under them."""
    shown = {
        "linear" if law == LINEAR_LAW else "nonlinear": Line2D([], [], marker="o", ms=4.5, **_look(law))
        for law in sweep.laws
    }
    if sweep.flagged.any():
        hollow: dict[str, Any] = {"ls": "", "marker": "o", "ms": 4.5, "mfc": "white"}
        shown["flagged somewhere"] = Line2D([], [], color=style.NONLINEAR, **hollow)
    figure.legend([*shown.values()], [*shown], loc="outside lower center", ncols=len(shown))


def _legend_above(axes: Axes, handles: Sequence[Any], labels: Sequence[str]) -> None:
    """Put a legend above the panel, where it covers no curve."""
    marks = all(handle.get_linestyle() == "None" for handle in handles)
    axes.legend(
        handles,
        labels,
        loc="lower right",  # a power of ten of the axis stands on the left
        bbox_to_anchor=(1, 1),
        borderaxespad=0.1,
        ncols=2,
        columnspacing=1.0,
        handletextpad=0.4,
        handlelength=0.8 if marks else 1.8,
    )


def _from_zero(axes: Axes) -> None:
    """Let the axis begin at zero where its values come near it."""
    if 0 <= axes.dataLim.ymin < FROM_ZERO * axes.dataLim.ymax:
        axes.set_ylim(bottom=0)


def _over_both(sweep: ParameterSweep) -> Figure:
    names = [sweep.named(name) for row in _rows(sweep) for name in row]
    names += [name for name in ("porosity", "K_22") if name in sweep.figures] or [sweep.named("drained")]
    names = [name for name in names if _varies(sweep.figures.get(name, np.zeros(1)))] or names[:1]
    figure = style.new_figure(12.0, 3.5 * -(-len(names) // 3))
    panels = figure.subplots(-(-len(names) // 3), min(3, len(names)), squeeze=False).ravel()
    for axes, name in zip(panels, names, strict=False):
        plane(sweep, figure, axes, name)
    for axes in panels[len(names) :]:
        axes.remove()
    said = [f"load {sweep.largest_load:g}"] if len(sweep.plan.family.macro.loads) > 1 else []
    if sweep.flagged.any():
        said.append("white: flagged somewhere")
    if said:
        figure.suptitle("; ".join(said), fontsize=10)
    return figure


def _varies(values: Array) -> bool:
    """Return True for results of which some differ by more than round-off."""
    known = values[np.isfinite(values)]
    return len(known) > 1 and bool(np.ptp(known) > SAME * np.abs(known).max())


def plane(sweep: ParameterSweep, figure: Figure, axes: Axes, name: str) -> None:
    """Draw one result over the plane of two parameters."""
    shape = tuple(len(each.values) for each in sweep.plan.swept)
    x, y = (_places(sweep, k).reshape(shape) for k in range(2))
    values = sweep.figures[name].reshape(shape)
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    low, high = (low, high) if _varies(values) else (low - 1.0, high + 1.0)
    wide = low > 0 and high > WIDE * low
    levels = np.geomspace(low, high, LEVELS + 1) if wide else MaxNLocator(LEVELS).tick_values(low, high)
    norm = LogNorm(low, high) if wide else None
    filled = axes.contourf(x, y, values, levels=levels, cmap="viridis", norm=norm, extend="neither")
    axes.contour(x, y, values, levels=levels, colors="white", linewidths=0.5)
    edge: dict[str, Any] = {"ms": 3.0, "mew": 0.6, "mec": style.BLACK, "clip_on": False, "zorder": 4}
    for rows, face in ((~sweep.flagged, style.BLACK), (sweep.flagged, "white")):
        if rows.any():  # what is empty and not clipped leaves the layout no room
            axes.plot(x.ravel()[rows], y.ravel()[rows], ls="", marker="o", mfc=face, **edge)
    bar = figure.colorbar(filled, ax=axes, pad=0.02)
    if wide:
        bar.set_ticks(list(levels[::3]), labels=[f"{level:.2g}" for level in levels[::3]])
    bar.set_label(_label(sweep, name))
    axes.set_xlabel(parameter_label(sweep, 0))
    axes.set_ylabel(parameter_label(sweep, 1))
    axes.grid(visible=False)


def write_sweep(sweep: ParameterSweep) -> None:
    """Write the table, with one row a point, and the picture.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    """
    units, swept = sweep.units, sweep.plan.swept
    header = [units.titled(each.name, each.quantity) for each in swept]
    header += [units.titled(name, sweep.quantity(name)) for name in sweep.figures]
    values = zip(sweep.values.T, swept, strict=True)
    columns = [[units.value(float(x), each.quantity) for x in column] for column, each in values]
    columns += [column.tolist() for column in sweep.figures.values()]
    rows = zip(*columns, strict=True)
    write_csv(sweep.table, header, ([x if np.isfinite(x) else "" for x in row] for row in rows))
    style.write_pictures(sweep_figure(sweep), *sweep.pictures)
