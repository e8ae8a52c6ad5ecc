"""The picture of the README: the cell beside the settlement of the benchmark against time.

.venv/bin/python docs/make_images.py runs/dehghani2022
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from porocore.errors import PorocoreError
from porocore.interfaces.solution import History, MacroSolution
from porocore.report.figures import cell_picture, png_bytes
from porocore.report.figures.style import DASHED, LINEAR, NONLINEAR, new_figure, styled
from porocore.study.run.folder import RunFolder

IMAGES = Path(__file__).parent / "images"


@styled
def benchmark_picture(folder: RunFolder) -> Figure:
    """The solid of the cell, and the settlement under the first load, with the cell's law and linearly."""
    figure = new_figure(8.4, 3.4)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.35))
    mesh = folder.config.cell.make_mesh("solid", "whole")
    left.imshow(_pixels(cell_picture(mesh.points, mesh.cells)))
    left.set_axis_off()
    left.set_title("The periodic cell: solid, and pore wall in blue")
    load = folder.config.macro.loads[0]
    nonlinear = MacroSolution.load_file(folder.solution(folder.config.closure, load)).history
    linear = MacroSolution.load_file(folder.solution("linear", load)).history
    right.plot(
        linear.time, linear.settlement, color=LINEAR, ls=DASHED, label="linear poroelasticity, same cell"
    )
    right.plot(nonlinear.time, nonlinear.settlement, color=NONLINEAR, label="finite strain, learned cell")
    _shade(right, nonlinear)
    right.set(xlabel="time $t$ [–]", ylabel="settlement [–]", xlim=(0, linear.time[-1]), ylim=(0, None))
    right.set_title(f"Consolidation of a column of height 7.5 under P = {load:g}".replace("-", "−"))
    right.legend(loc="lower right")
    return figure


def _shade(axes: Axes, history: History) -> None:
    """Grey from the time on at which every point asks the surrogate outside the states it was trained on."""
    outside = np.flatnonzero(history.flagged > 0.999)
    if len(outside):
        start = float(history.time[outside[0]])
        axes.axvspan(start, float(history.time[-1]), color="0.93", lw=0, zorder=0)
        text = "grey: the whole column lies beyond\nthe states that the surrogate was trained on"
        axes.text(start + 4, 1.55, text, fontsize=9, color="0.25", va="center")


def _pixels(picture: Figure) -> np.ndarray:
    """A figure as an image (rows, columns, 3) without its white margin."""
    picture.set_dpi(150)
    canvas = picture.canvas
    canvas.draw()
    image = np.asarray(canvas.buffer_rgba())[..., :3]
    ink = (image < 255).any(axis=2)
    rows, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
    return image[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].copy()


def main() -> None:
    """Write docs/images/benchmark.png from the run folder that the command line names."""
    if len(sys.argv) != 2:
        sys.exit("usage: python docs/make_images.py RUN, a finished run folder such as runs/dehghani2022")
    try:
        picture = benchmark_picture(RunFolder.open(sys.argv[1]))
    except PorocoreError as error:
        sys.exit(f"error: {error}")
    path = IMAGES / "benchmark.png"
    path.write_bytes(png_bytes(picture, dpi=120))
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
