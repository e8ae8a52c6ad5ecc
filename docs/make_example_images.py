"""The pictures of bodies.md: each example's body and what it is there to show.

.venv/bin/python docs/make_example_images.py runs/cartilage-confined runs/soil-strip ...
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from make_images import IMAGES, _pixels
from matplotlib.figure import Figure

from porocore.core.units import units_now, using_units
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.kinds import sections
from porocore.report.figures import PROFILE_FIELDS, body_figure, plane_figure, png_bytes, series_figure
from porocore.report.figures.body import axes_in_section
from porocore.report.figures.curves import ColumnAxis, panels
from porocore.report.figures.style import DASHED, TIME_COLOURS, axis_label, new_figure, styled
from porocore.states import Array
from porocore.study.run.folder import RunFolder

#: Of each example: the number of the profile, and what is shown against time.
SHOWN = {
    "cartilage-confined": (1, ("pressure at the probes", "forces of held or moved surfaces")),
    "cartilage-unconfined": (1, ("pressure at the probes", "displacement of the probes")),
    "gel-indentation": (0, ("forces of indenters", "contact radius of indenters")),
    "gel-creep": (0, ("displacement of indenters", "contact radius of indenters")),
    "cartilage-indentation": (0, ("forces of indenters", "pressure at the probes")),
    "brain-indentation": (0, ("forces of indenters", "pressure at the probes")),
    "soil-strip": (0, ("pressure at the probes", "displacement of the probes")),
    "layered-soil": (1, ("pressure at the probes", "displacement of the probes")),
    "swelling-gel": (1, ("pressure at the probes", "displacement of the probes")),
    "cartilage-zones": (0, ("displacement of the probes",)),
    "graded-gyroid": (0, ("pressure at the probes",)),
    "charged-cartilage": (0, ("forces of held or moved surfaces", "displacement of the probes")),
    "clogging-filter": (0, ("inflow through surfaces of given pressure", "displacement of the probes")),
    "degrading-scaffold": (0, ("displacement of the probes", "forces of held or moved surfaces")),
}
#: Of bodies whose cell varies with the height: the parameter that is shown over it, and its name.
OVER_HEIGHT = {
    "cartilage-zones": ("radius", "radius of the pores [cell]"),
    "graded-gyroid": ("void_fraction", "void fraction [–]"),
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
    with using_units(config.result_units):
        parts = field_parts(nonlinear, linear, name)
        profile = nonlinear.after_rest[which]
        if nonlinear.contact and nonlinear.revolved:
            parts.append(plane_figure(nonlinear, profile, config.macro.contact))
        parts.append(body_figure(nonlinear, profile, config.macro.contact))
        parts += [series_figure(nonlinear, linear, kind) for kind in kinds if kind in known]
    pictures = [_pixels(part) for part in parts]
    rows = 2 if len(parts) > 3 else 1
    columns = -(-len(parts) // rows)
    figure = new_figure(4.2 * columns, 3.9 * rows)
    for axes, picture in zip(figure.subplots(rows, columns).ravel(), pictures, strict=True):
        axes.imshow(picture)
        axes.set_axis_off()
    return figure


def field_parts(nonlinear: MacroSolution, linear: MacroSolution, name: str) -> list[Figure]:
    """A parameter and the strain over the height, and the material axes where they differ; none of other examples."""
    cells = nonlinear.element_cells
    if name not in OVER_HEIGHT or cells is None:
        return []
    found = [height_figure(nonlinear, linear, *OVER_HEIGHT[name])]
    axes = cells.axes_at(0)
    if axes is not None:
        found.append(axes_in_section(sections(nonlinear.points, nonlinear.cells), axes, cells))
    return found


@styled
def height_figure(nonlinear: MacroSolution, linear: MacroSolution, parameter: str, label: str) -> Figure:
    """A parameter of the cell and the last strain along the height, means over the layers of elements."""
    figure = new_figure(5.4, 4.4)
    left, right = figure.subplots(1, 2, sharey=True)
    cells = nonlinear.element_cells
    assert cells is not None
    low, high = (
        getattr(nonlinear.points[nonlinear.cells, 1], end)(axis=1) * units_now().factor("displacement")
        for end in ("min", "max")
    )
    edges = np.append(np.unique(low.round(9)), high.max())
    layer = np.searchsorted(edges, (low + high) / 2) - 1

    def over_height(values: Array) -> Array:
        return np.bincount(layer, values) / np.bincount(layer)

    left.stairs(
        over_height(cells.field(parameter, 0)), edges, orientation="horizontal", baseline=None, lw=1.8
    )
    for solution, how in (
        (nonlinear, {"lw": 1.8}),
        (linear, {"lw": 1.3, "ls": DASHED, "color": "0.35", "label": "linear"}),
    ):
        strain = over_height(solution.profiles[-1].grad_u[:, 1, 1].reshape(len(layer), -1).mean(axis=1))
        right.stairs(100 * strain, edges, orientation="horizontal", baseline=None, **how)
    left.set(xlabel=label, ylabel=axis_label("height $X_2$", "displacement"), ylim=(edges[0], edges[-1]))
    right.set(xlabel="final $H_{22}$ [%]")
    right.legend()
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
