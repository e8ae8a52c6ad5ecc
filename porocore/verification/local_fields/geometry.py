"""Phases of a cell as files for ParaView, and as a picture."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill

from matplotlib.figure import Figure
from matplotlib.image import imread

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import CellMesh
from porocore.core.files.atomic import atomic_path
from porocore.report.figures.style import png_bytes, styled
from porocore.report.vtk import write_vtu
from porocore.states import Array
from porocore.verification.local_fields.pictures import View, box_of, draw_views, image_panels

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
    return [
        write_vtu(folder / f"{name}_{mesh.phase}.vtu", mesh.points, mesh.cells, {}, {"region": mesh.regions})
        for mesh in _meshes(cell)
    ]


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
    names = {"solid": "solid", "fluid": "pores"}
    figure, _ = image_panels({names[phase]: image for phase, image in images.items()}, 4.2 * len(images), 4.4)
    if title:
        figure.suptitle(fill(title, 44 * len(images)), fontsize=11)
    return figure
