"""The pictures of bodies.md: each example's body and what it is there to show.

.venv/bin/python docs/make_example_images.py runs/cartilage-confined runs/soil-strip ...
"""

from __future__ import annotations

import sys
from pathlib import Path

from make_images import IMAGES, _pixels
from matplotlib.figure import Figure

from porocore.interfaces.solution import MacroSolution
from porocore.report.figures import PROFILE_FIELDS, body_figure, png_bytes, series_figure
from porocore.report.figures.profiles import ColumnAxis
from porocore.report.figures.series import panels
from porocore.report.figures.style import DASHED, TIME_COLOURS, new_figure, styled
from porocore.study.run_folder.folder import RunFolder

#: Of each example: the number of the profile, and what is shown against time.
SHOWN = {
    "cartilage-confined": (1, ("pressure at the probes", "forces of held or moved surfaces")),
    "cartilage-unconfined": (1, ("pressure at the probes", "displacement of the probes")),
    "brain-indentation": (0, ("pressure at the probes", "forces of held or moved surfaces")),
    "soil-strip": (0, ("pressure at the probes", "displacement of the probes")),
    "layered-soil": (1, ("pressure at the probes", "displacement of the probes")),
    "swelling-gel": (1, ("pressure at the probes", "displacement of the probes")),
}


@styled
def example_picture(folder: RunFolder, name: str) -> Figure:
    """The deformed body beside two figures of the report."""
    config = folder.config
    load = config.macro.loads[0]
    nonlinear = MacroSolution.load_file(folder.solution(config.closure, load))
    linear = MacroSolution.load_file(folder.solution("linear", load))
    which, kinds = SHOWN[name]
    known = {panel.plain for panel in panels(nonlinear)}
    units = config.result_units
    parts = [body_figure(nonlinear, nonlinear.after_rest[which], units)]
    parts += [series_figure(nonlinear, linear, kind, units) for kind in kinds if kind in known]
    figure = new_figure(12.6, 3.9)
    for axes, part in zip(figure.subplots(1, len(parts)), parts, strict=True):
        axes.imshow(_pixels(part))
        axes.set_axis_off()
    return figure


@styled
def filter_picture(folder: RunFolder) -> Figure:
    """Pore pressure and conductivity of the deformed pore through the filter, when the flow is steady."""
    config = folder.config
    figure = new_figure(8.4, 3.6)
    left, right = figure.subplots(1, 2, sharey=True)
    for load, colour in zip(config.macro.loads, TIME_COLOURS, strict=False):
        solution = MacroSolution.load_file(folder.solution(config.closure, load))
        last, line = solution.profiles[-1], ColumnAxis.from_solution(solution)
        height, pressure, _ = line.series(last, PROFILE_FIELDS["p"])
        left.plot(pressure / load, height, color=colour, label=f"{load:g}")
        conductivity = last.spatial_conductivity[line.elements, 1, 1]
        right.plot(conductivity, line.element_y, color=colour, label=f"{load:g}")
    linear = MacroSolution.load_file(folder.solution("linear", config.macro.loads[0]))
    height, conductivity, _ = ColumnAxis.from_solution(linear).series(
        linear.profiles[-1], PROFILE_FIELDS["K22"]
    )
    left.plot([0, 1], [0, float(linear.points[:, 1].max())], color="0.35", ls=DASHED, lw=1.3, label="linear")
    right.plot(conductivity, height, color="0.35", ls=DASHED, lw=1.3, label="undeformed pore")
    left.set(xlabel="pore pressure, as a share of that above [–]", ylabel="height in the filter $X_2$ [–]")
    right.set(xlabel="conductivity $k_{22}$ [–]")
    left.legend(title="pressure above$\\,/E$")
    right.legend()
    return figure


def main() -> None:
    for path in map(Path, sys.argv[1:]):
        folder = RunFolder.open(path)
        picture = filter_picture(folder) if path.name == "filter" else example_picture(folder, path.name)
        target = IMAGES / f"example-{path.name}.png"
        target.write_bytes(png_bytes(picture))
        print(target)


if __name__ == "__main__":
    main()
