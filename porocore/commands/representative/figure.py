"""Figure of a study of sub-volumes: each result against the edge of the sub-volume."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from porocore.commands.representative.results import (
    QUANTITIES,
    RepresentativeVolume,
    edge_columns,
    factor,
    titled,
)
from porocore.report.figures import style

#: Shift of what lies beside another at one size, as a share of the width.
BESIDE = 0.012
#: Factor between permeabilities from which their axis is logarithmic.
WIDE = 20.0
#: Sizes that are at least so far apart, as a factor, both have a number at the axis.
APART = 1.18


def write_figure(study: RepresentativeVolume) -> None:
    """Write ``rev.png`` and ``rev.svg``.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    """
    style.write_pictures(subvolume_figure(study), *study.pictures)


@style.styled
def subvolume_figure(study: RepresentativeVolume) -> Figure:
    """Draw every quantity, or the porosity of the voxels alone where nothing was solved."""
    names = list(QUANTITIES) if study.subvolumes else ["porosity"]
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    figure = style.new_figure(3.9 * columns + 0.4, 3.2 * rows + 0.7)
    panels = list(np.ravel(figure.subplots(rows, columns, squeeze=False, sharex=True)))
    for axes, name in zip(panels, names, strict=True):
        _draw(axes, study, name)
    for i, axes in enumerate(panels):
        _sizes(axes, study, bottom=i >= len(panels) - columns, top=i < columns)
    handles: dict[str, Artist] = {}
    for axes in panels:
        shown, labels = axes.get_legend_handles_labels()
        handles |= dict(zip(labels, shown, strict=True))
    place: dict[str, Any] = {"loc": "outside lower left", "ncols": len(handles), "columnspacing": 1.4}
    figure.legend([*handles.values()], [*handles], **place)
    return figure


def _draw(axes: Axes, study: RepresentativeVolume, name: str) -> None:
    settling, quantity = study.settling, QUANTITIES[name]
    by = factor(name, study.scan.voxel)
    scatter = settling.scatter[name]
    sizes = np.array(scatter.sizes, dtype=float)
    beside = (study.sizes[-1] / study.sizes[0]) ** BESIDE
    if name == "porosity":
        voxels = study.voxels
        axes.errorbar(
            np.array(voxels.sizes) / (beside if len(sizes) else 1.0), voxels.mean, np.nan_to_num(voxels.deviation),
            color=style.GREEN, ls="", marker="s", ms=4.5, capsize=2.5, lw=1.2, label="voxels of many sub-volumes",
        )  # fmt: skip
    if len(sizes):
        if quantity.judged and len(sizes) > 1:
            low, high = sorted(by * scatter.mean[-1] * (1 + sign * settling.tolerance) for sign in (-1, 1))
            share = f"within {100 * settling.tolerance:g} % of the largest size"
            axes.axhspan(low, high, color=style.lighter(style.BLUE, 0.85), lw=0, label=share)
            if (settled := settling.settled[name]) is not None:
                label = "from here the means stay within"
                axes.axvline(settled, color=style.VERMILLION, ls=style.DASHED, lw=1.3, label=label)
        single = [(each.size, by * each.scalars()[name]) for each in study.subvolumes]
        dots: dict[str, Any] = {"ls": "", "marker": "o", "ms": 3.5, "mew": 0, "alpha": 0.7}
        axes.plot(*np.array(single).T, color=style.GREY, label="sub-volume", **dots)
        axes.errorbar(
            sizes * beside, by * scatter.mean, by * np.nan_to_num(scatter.deviation), color=style.BLUE, marker="o",
            ms=5, capsize=2.5, lw=1.2, label="mean and standard deviation",
        )  # fmt: skip
        positive = [value for _, value in single if value > 0]
        if name == "permeability" and positive and max(positive) > WIDE * min(positive):
            axes.set_yscale("log")
    axes.set_ylabel(titled(name, study.scan.voxel, f"{quantity.title} ${quantity.symbol}$"))


def _sizes(axes: Axes, study: RepresentativeVolume, *, bottom: bool, top: bool) -> None:
    """Put the edges below in voxels, and above in a unit of length where voxels have one."""
    sizes = study.sizes
    axes.set_xscale("log")
    axes.set_xlim(sizes[0] / 1.15, sizes[-1] * 1.15)
    shown = sizes[-1:]
    for size in reversed(sizes[:-1]):
        if shown[0] / size >= APART:
            shown.insert(0, size)
    axes.set_xticks(shown, [str(size) for size in shown])
    axes.set_xticks([], minor=True)
    if bottom:
        axes.set_xlabel("edge of the sub-volume [voxels]")
    unit, edges = edge_columns(study.scan, sizes)
    if top and unit:
        cube = len(edges) == 1
        by_voxel = float(np.prod(list(edges.values()))) ** (1 / len(edges))
        above = axes.secondary_xaxis("top")
        above.set_xticks(shown, [f"{size * by_voxel:.3g}" for size in shown])
        above.set_xticks([], minor=True)
        above.tick_params(colors=style.BLACK)
        above.set_xlabel(f"edge [{unit}]" if cube else f"cube root of its volume [{unit}]")
