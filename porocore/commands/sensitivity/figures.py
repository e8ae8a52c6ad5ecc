"""Figures of a sensitivity study, one for each panel of the paper's "RVE numerical tests"."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from porocore.commands.sensitivity.plan import load_quantity, quantity_of
from porocore.commands.sensitivity.results import LoadResponses, Sensitivity, line_name
from porocore.core.units import units_now
from porocore.report.figures import style
from porocore.states import Status

AXES = {
    "uniaxial": "$H_{11}$",
    "volumetric": "$H_{11} = H_{22} = H_{33}$",
    "shear": "$H_{12}$",
    "pressure": "$p$",
}
TITLES = {load: f"{load}, {symbol}" for load, symbol in AXES.items()} | {"pressure": "pore pressure $p$"}
#: Units of figures without scales.
_MULTIPLES = {"pressure": "$E$", "stress": "$E$", "energy-density": "$E$", "compliance": "$1/E$"}
COLOURS = {
    "uniaxial": style.BLUE,
    "volumetric": style.VERMILLION,
    "shear": style.GREEN,
    "pressure": style.PURPLE,
}
SEVERAL = (style.BLUE, style.VERMILLION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY, style.BLACK)
STROKES = ("-", style.DASHED, style.DOTTED, (0, (5, 1.5, 1, 1.5)))

#: Of each load the quantities to draw, with the name and the stroke of each.
Curves: TypeAlias = dict[str, tuple[tuple[str, str, Any], ...]]

#: Components of ∇u¹ with the indices of the load; under p, which has none, those of the diagonal are alike.
CORRESPONDING = {"uniaxial": ("11",), "volumetric": ("11",), "shear": ("12",), "pressure": ("11",)}
#: The others, but for those that symmetry makes equal to one of them.
OTHERS = {
    "uniaxial": ("22", "12", "21", "23"),
    "volumetric": ("12",),
    "shear": ("21", "11", "22", "33"),
    "pressure": ("12",),
}
#: Components of M. The ones with 12 at the end couple shear with the diagonal, and vanish in linear poroelasticity.
FOURTH = {
    "uniaxial": ("1111", "2222", "1122", "2211", "2233", "1212"),
    "volumetric": ("1111", "1122", "1212", "1221"),
    "shear": ("1111", "2222", "1122", "1212", "1221", "1112", "2212"),
    "pressure": ("1111", "1122", "1212", "1221"),
}
SECOND = {
    "uniaxial": ("11", "22"),
    "volumetric": ("11",),
    "shear": ("11", "22", "33", "12"),
    "pressure": ("11",),
}


def write_figures(folder: Path, study: Sensitivity, names: Sequence[str] | None = None) -> dict[str, Path]:
    """Write ``folder/<name>.png`` of the named :data:`FIGURES`, all that are known by default; name → path.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    """
    paths = {}
    for name in known_figures(study) if names is None else names:
        paths[name] = folder / f"{name}.png"
        style.write_pictures(FIGURES[name](study), paths[name])
    return paths


def known_figures(study: Sensitivity) -> list[str]:
    """Return the names of the figures of what the cell solver provides."""
    return [name for name in FIGURES if study.rest.extrema is not None or name not in OF_EXTREMA]


def _label(words: str, quantity: str) -> str:
    """Return the label of an axis in the units of the study, in multiples of E without scales."""
    unit = units_now().name(quantity) if units_now().given else _MULTIPLES.get(quantity, "–")
    return f"{words} [{unit}]"


def _label_all_loads(study: Sensitivity) -> str:
    """Return the label of an axis that all loads share; 1 is H = 1, and p as large as the scale of stress."""
    if len(study.loads) == 1:
        (load,) = study.loads
        return _label(AXES[load], load_quantity(load))
    scale = f"in multiples of {units_now().text(1.0, 'pressure')}" if units_now().given else "[$E$]"
    p = f", or $p$ {scale}" if "pressure" in study.loads else ""
    return f"load: components of $H$ [–]{p}"


@style.styled
def _together(label: str, curves: Curves, study: Sensitivity) -> Figure:
    """All loads in one panel: for each the quantities with their names and strokes."""
    figure = style.new_figure(7.0, 4.7)
    axes = figure.subplots()
    for load, along in study.loads.items():
        for quantity, name, stroke in curves[load]:
            title = f"{TITLES[load]}: {name}" if name else TITLES[load]
            look = {"color": COLOURS[load], "ls": stroke, "label": title}
            _curve(axes, study, along, quantity, look, load_quantity(load) if len(study.loads) == 1 else "")
    of = quantity_of(next(iter(curves.values()))[0][0])
    axes.set(xlabel=_label_all_loads(study), ylabel=_label(label, of))
    _finish(figure, [axes], study)
    figure.legend(loc="outside upper left", ncols=2, handlelength=2.6, columnspacing=1.4)
    return figure


@style.styled
def _panels(
    label: str, quantity: str, symbol: str, components: dict[str, tuple[str, ...]], study: Sensitivity
) -> Figure:
    """Each load in its own panel, several components in each."""
    count = len(study.loads)
    rows, columns = (count + 1) // 2, min(count, 2)
    figure = style.new_figure(8.8 if columns > 1 else 5.4, 0.5 + 3.6 * rows)
    panels = list(np.ravel(figure.subplots(rows, columns, squeeze=False)))
    for spare in panels[count:]:
        spare.set_axis_off()
    for axes, (load, along) in zip(panels, study.loads.items(), strict=False):
        for k, component in enumerate(components[load]):
            name = symbol.format(*component)
            look = {"color": SEVERAL[k], "ls": STROKES[k % len(STROKES)], "label": name}
            _curve(axes, study, along, f"{quantity}_{component}", look, load_quantity(load))
        axes.set_title(TITLES[load])
        axes.set(xlabel=_label(AXES[load], load_quantity(load)), ylabel=_label(label, quantity_of(quantity)))
        wide = min(4, len(components[load]))
        axes.legend(
            loc="upper center", bbox_to_anchor=(0.5, -0.17), ncols=wide, handlelength=2.6, columnspacing=1.2
        )
    _finish(figure, panels[:count], study)
    return figure


def _curve(
    axes: Axes,
    study: Sensitivity,
    along: LoadResponses,
    quantity: str,
    look: dict[str, Any],
    of_load: str = "",
) -> None:
    """The states with values, those in contact or unstable marked, and where a line ends before its goal."""
    y = along.quantities[quantity]
    y = np.where(np.abs(y) < 1e-9, 0.0, y)  # what is zero by symmetry, up to the tolerance of the solves
    x, y = along.values * units_now().factor(of_load), y * units_now().factor(quantity_of(quantity))
    axes.plot(x, y, **look)
    for status, marker in _MARKS.items():
        here = along.status == status
        axes.plot(x[here], y[here], ls="", color=look["color"], **marker)
    solved = np.flatnonzero(np.isfinite(along.values) & np.isin(along.status, _WITH_VALUES))
    for sign, last in ((1, solved[-1]), (-1, solved[0])):
        line = study.lines.get(line_name(along.load, sign))
        if line is not None and line.end is not None:
            axes.plot(x[last], y[last], ls="", color=look["color"], **_END)


_WITH_VALUES = [status for status in Status if status.has_values]
_MARKS: dict[Status, dict[str, Any]] = {
    Status.contact: {"marker": "o", "ms": 4.0},
    Status.unstable: {"marker": "o", "ms": 6.5, "mfc": "white", "mew": 1.4},
}
_END: dict[str, Any] = {"marker": "x", "ms": 8.0, "mew": 1.8}


def _finish(figure: Figure, panels: Sequence[Axes], study: Sensitivity) -> None:
    """Zero lines, and what the marks mean, below."""
    for axes in panels:
        axes.axvline(0.0, color=style.GREY, lw=0.8)
        axes.margins(x=0.03)
    found = np.concatenate([along.status for along in study.loads.values()])
    meanings = [
        ("in contact", Status.contact in found, _MARKS[Status.contact]),
        ("unstable", Status.unstable in found, _MARKS[Status.unstable]),
        ("not solved beyond", not np.isin(found, _WITH_VALUES).all(), _END),
    ]
    handles = [
        Line2D([], [], ls="", color=style.BLACK, label=name, **mark)
        for name, there, mark in meanings
        if there
    ]
    if handles:
        figure.legend(handles=handles, loc="outside lower right", ncols=len(handles), columnspacing=1.4)


def _each(*curves: tuple[str, str, Any]) -> Curves:
    return dict.fromkeys(TITLES, curves)


def _components(quantity: str, symbol: str, components: Mapping[str, tuple[str, ...]]) -> Curves:
    return {
        load: tuple((f"{quantity}_{ij}", symbol.format(*ij), STROKES[k]) for k, ij in enumerate(each))
        for load, each in components.items()
    }


_AVERAGE = r"$\overline{{\partial u^1_{0}/\partial Y_{1}}}$"
_LARGEST = r"$|\partial u^1_{0}/\partial Y_{1}|$"

#: Figures by the names that the paper's source gives them; an average is that of the solid.
FIGURES: dict[str, Callable[[Sensitivity], Figure]] = {
    "dyu1_Av_1": partial(
        _together,
        r"average $\overline{\nabla_Y u^1}$, component of the load",
        _components("avg_grad", _AVERAGE, CORRESPONDING),
    ),
    "dyu1_Av_2": partial(_panels, r"average $\overline{\nabla_Y u^1}$", "avg_grad", _AVERAGE, OTHERS),
    "dyu1_max_1": partial(
        _together,
        r"maximum of $|\nabla_Y u^1|$, component of the load",
        _components("max_grad", _LARGEST, CORRESPONDING),
    ),
    "dyu1_max_2": partial(_panels, r"maximum of $|\nabla_Y u^1|$", "max_grad", _LARGEST, OTHERS),
    "psi_Av": partial(_together, r"average $\overline{\Psi}$", _each(("avg_energy", "", "-"))),
    "psi_max": partial(_together, r"maximum of $\Psi$", _each(("max_energy", "", "-"))),
    "K11": partial(_together, "$(K_t)_{11} / K_{11}$", _each(("Kt_11", "", "-"))),
    "K22": partial(_together, "$(K_t)_{22} / K_{22}$", _each(("Kt_22", "", "-"))),
    "Mijkl_reference": partial(_panels, r"$\langle M \rangle_s$", "M", "$M_{{{0}{1}{2}{3}}}$", FOURTH),
    "Mijkl_deformed": partial(
        _panels, r"$\hat J\,\langle M \rangle_s$", "M_hat", r"$\hat J M_{{{0}{1}{2}{3}}}$", FOURTH
    ),
    "Q_11": partial(_together, r"$\langle Q \rangle_s$", _components("Q", "$Q_{{{0}{1}}}$", SECOND)),
    "Biot_Modulus": partial(
        _together,
        r"$M = -1/\mathrm{tr}\,Q$ and $\tilde M = M/\hat J$",
        _each(("biot", r"$M$", "-"), ("biot_hat", r"$\tilde M$", style.DASHED)),
    ),
}
#: Figures of what is optional for a cell solver.
OF_EXTREMA = ("dyu1_max_1", "dyu1_max_2", "psi_Av", "psi_max")
