"""Drawing of views of one .vtu file by VTK; main program of the child process.

VTK ends the process where it finds no way to draw, so it must not be that of the user. JOBS.json is a list of views,
see :class:`porocore.commands.fields.pictures.View`; each becomes a PNG image without any text.
"""

from __future__ import annotations

import json
import sys
from typing import Any

#: From where the cell is looked at, and its upward direction.
CAMERA = (1.0, -1.55, 0.95)
UP = (0.0, 0.0, 1.0)
#: Of the flat pieces of a curved facet.
SUBDIVISION = 2
#: So that the triad of axes in the corner stays clear of the cell.
ZOOM = 1.0


def surface_of(grid: Any) -> Any:
    """The boundary of a grid, curved facets in flat pieces."""
    import pyvista
    from vtkmodules.vtkFiltersGeometry import vtkDataSetSurfaceFilter

    # Not by pyvista's own method, whose choice of a filter is announced to change.
    boundary = vtkDataSetSurfaceFilter()
    boundary.SetInputData(grid)
    boundary.SetNonlinearSubdivisionLevel(SUBDIVISION)
    boundary.Update()
    return pyvista.wrap(boundary.GetOutput())


def draw(path: str, views: list[dict[str, Any]]) -> None:
    """Draw every view of one file."""
    import numpy as np
    import pyvista

    grid = pyvista.read(path)
    middles = np.asarray(grid.cell_centers().points)
    # The mesh keeps the planes of symmetry, so that half of its elements are half of the cell.
    halves = {False: grid, True: grid.extract_cells(np.flatnonzero(middles[:, 1] > middles[:, 1].mean()))}
    for view in views:
        shape = halves[view["cut"]]
        surface = surface_of(shape)
        if view["deformed"]:
            surface = surface.warp_by_vector("displacement")
        plotter = pyvista.Plotter(off_screen=True, window_size=view["size"])
        plotter.set_background("white")
        plotter.add_mesh(
            surface,
            scalars=view["scalars"],
            cmap=view["cmap"],
            clim=view["range"],
            show_scalar_bar=False,
            smooth_shading=True,
            split_sharp_edges=True,
            feature_angle=40,
            ambient=0.55,
            diffuse=0.5,
            specular=0.0,
        )
        plotter.add_lines(np.array(view["box"]), color="#555555", width=2)
        if not view["cut"]:
            plotter.add_axes(
                xlabel="X1", ylabel="X2", zlabel="X3", viewport=(0.0, 0.0, 0.22, 0.22), line_width=3
            )
        plotter.enable_parallel_projection()
        plotter.camera_position = [CAMERA, (0.0, 0.0, 0.0), UP]
        plotter.reset_camera(bounds=view["bounds"])
        plotter.camera.Zoom(ZOOM)
        plotter.enable_anti_aliasing("ssaa")
        plotter.screenshot(view["png"])
        plotter.close()


if __name__ == "__main__":
    with open(sys.argv[2], encoding="utf-8") as file:
        draw(sys.argv[1], json.load(file))
