"""A cell to look at: its phases as files for ParaView, and as a picture."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill

import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import imread

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import CellMesh
from porocore.core.files.atomic import atomic_path
from porocore.errors import RunFolderError
from porocore.report.figures.style import new_figure, png_bytes, styled
from porocore.states import Array
from porocore.verification.local_fields.pictures import View, box_of, draw_views

#: Colours of a phase with one region, and of several.
COLOURS: dict[str, tuple[str, tuple[float, float]]] = {
    "solid": ("YlOrBr", (-0.35, 1.6)),
    "fluid": ("Blues", (-1.2, 1.0)),
}
REGIONS = "Set2", 8


def write_phases(cell: Cell, folder: Path, name: str) -> list[Path]:
    """Write ``<name>_solid.vtu`` and ``<name>_fluid.vtu``, those phases of the whole cell that there are.

    With the index of the region of each tetrahedron as ``region``.

    Raises
    ------
    PorocoreError
        The cell cannot be meshed.
    RunFolderError
        A file cannot be written.
    """
    import meshio  # heavy, and needed here only

    paths = []
    for mesh in _meshes(cell):
        path = folder / f"{name}_{mesh.phase}.vtu"
        kind = "tetra" if mesh.order == 1 else "tetra10"
        content = meshio.Mesh(mesh.points, [(kind, mesh.cells)], cell_data={"region": [mesh.regions]})
        with atomic_path(path) as part:
            try:
                meshio.write(part, content, file_format="vtu")
            except meshio.WriteError as error:
                raise RunFolderError(f"cannot write {path}: {error}") from error
        paths.append(path)
    return paths


def render_phases(cell: Cell, files: list[Path], picture: Path, *, titled: bool = True) -> Path:
    """Draw the phases side by side from the files of :func:`write_phases`, the solid first.

    Raises
    ------
    PorocoreError
        pyvista is not installed, or VTK finds nothing to draw with; the message says what to install.
    RunFolderError
        The picture cannot be written.
    """
    with TemporaryDirectory() as scratch:
        images: dict[str, Array] = {}
        for mesh, path in zip(_meshes(cell), files, strict=True):
            several = len(mesh.region_names) > 1
            colours, span = (REGIONS[0], (-0.5, REGIONS[1] - 0.5)) if several else COLOURS[mesh.phase]
            box, bounds = box_of(mesh.points)
            png = Path(scratch) / f"{mesh.phase}.png"
            draw_views(
                path, [View(str(png), "region", span, False, False, box, bounds, cmap=colours)], Path(scratch)
            )
            images[mesh.phase] = imread(png)[..., :3]
    figure = _beside(images, cell.geometry.description if titled else "")
    with atomic_path(picture) as part:
        part.write_bytes(png_bytes(figure, dpi=130))
    return picture


def _meshes(cell: Cell) -> list[CellMesh]:
    single = cell.model_copy(update={"supercell": (1, 1, 1)})
    meshes = (single.make_mesh("solid", "whole"), single.make_mesh("fluid", "whole"))
    return [mesh for mesh in meshes if len(mesh.cells)]


@styled
def _beside(images: dict[str, Array], title: str) -> Figure:
    """Join images side by side without their common margin."""
    ink = np.any([(image < 0.995).any(axis=2) for image in images.values()], axis=0)
    rows, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
    kept = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    figure = new_figure(4.2 * len(images), 4.4)
    panels = np.atleast_1d(figure.subplots(1, len(images)))
    for axes, (phase, image) in zip(panels, images.items(), strict=True):
        axes.imshow(image[kept])
        axes.set_axis_off()
        axes.set_title({"solid": "solid", "fluid": "pores"}[phase])
    if title:
        figure.suptitle(fill(title, 44 * len(images)), fontsize=11)
    return figure
