"""Pictures of a cell's phases and of its local fields; its phases as files for ParaView."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.image import imread

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import CellMesh
from porocore.commands.fields.points import NodalFields
from porocore.core.units import units_now
from porocore.errors import PorocoreError
from porocore.report.figures.style import new_figure, styled, write_pictures
from porocore.report.vtk import write_vtu
from porocore.states import Array

#: Means of drawing that VTK tries, one after the other: EGL and OSMesa need no display.
WINDOWS = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")
#: What they need on Debian and Ubuntu.
SYSTEM_PACKAGES = "libegl1 libgl1-mesa-dri"
COLOURS = "turbo"  # from blue to red
SIZE = (1000, 1000)
SECONDS = 300.0
#: Share of the nodes whose Ψ the colours resolve; the peak at a ridge would leave no colour for the rest.
RESOLVED = 0.995
#: What is less is round-off, and gets no colour.
NOTHING = 1e-9
#: Kind of a picture: its field at the nodes, title, label without scales, and quantity.
PICTURES = {
    "disp": (
        "u1_magnitude",
        "Micro displacement on the deformed cell",
        "$|u^1|$ [–], length of the cell 1",
        "",
    ),
    "energy": ("energy", "Strain energy density on the undeformed cell", r"$\Psi$ [$E$]", "energy-density"),
}


@dataclass(frozen=True)
class View:
    """One image that VTK draws.

    Attributes
    ----------
    scalars
        Name of the field at the nodes.
    range
        Its values at the ends of the colours.
    deformed
        Whether the nodes are moved by H X + u¹.
    cut
        Whether the half in front is left out.
    box
        Ends of the edges of the cell, (24, 3).
    bounds
        What the image shows: x, y, z from and to.
    """

    png: str
    scalars: str
    range: tuple[float, float]
    deformed: bool
    cut: bool
    box: list[list[float]]
    bounds: tuple[float, ...]
    cmap: str = COLOURS
    size: tuple[int, int] = SIZE


def render(vtu: Path, nodal: NodalFields, folder: Path, name: str, title: str) -> dict[str, Path]:
    """Draw ``disp_<name>.png``, |u¹| on the deformed cell, and ``energy_<name>.png``, Ψ on the undeformed one.

    Each shows the whole solid and half of it. The colours of Ψ end at its 99.5 % quantile over the nodes.

    Parameters
    ----------
    vtu
        The file that :func:`porocore.commands.fields.solve.write_fields` wrote of the same fields.
    folder
        Where the pictures go.
    title
        The state in words.

    Returns
    -------
    dict
        Paths by ``"disp"`` and ``"energy"``.

    Raises
    ------
    PorocoreError
        pyvista is not installed, or VTK finds nothing to draw with; the message says what to install.
    RunFolderError
        A picture cannot be written.
    """
    units, magnitude = units_now(), np.linalg.norm(nodal.points.u, axis=1)
    tops = {"disp": float(magnitude.max()), "energy": float(np.quantile(nodal.energy, RESOLVED))}
    tops = {kind: max(top, NOTHING) * units.factor(PICTURES[kind][3]) for kind, top in tops.items()}
    found, views = {}, []
    with TemporaryDirectory() as scratch:
        for kind, (scalars, _, _, quantity) in PICTURES.items():
            mesh, deformed = nodal.points.mesh, kind == "disp"
            moved = (np.eye(3) + nodal.points.grad_u, nodal.displacement) if deformed else ()
            box, bounds = box_of(mesh.points, *moved)
            for cut in (False, True):
                png = str(Path(scratch) / f"{kind}-{int(cut)}.png")
                shown = units.titled(scalars, quantity)
                views.append(View(png, shown, (0.0, tops[kind]), deformed, cut, box, bounds))
        draw_views(vtu, views, Path(scratch))
        for kind, (scalars, head, plain, quantity) in PICTURES.items():
            shown = units.titled(scalars, quantity)
            images = [imread(view.png)[..., :3] for view in views if view.scalars == shown]
            largest = float(nodal.points.energy.max()) * units.factor(quantity)
            beyond = largest if kind == "energy" else None
            label = plain.replace("$E$", units.name(quantity)) if units.given else plain
            figure = _labelled(images, f"{head}, {title}", label, tops[kind], beyond)
            found[kind] = folder / f"{kind}_{name}.png"
            write_pictures(figure, found[kind], dpi=130)
    return found


def require_pyvista() -> None:
    """Refuse at once what could not be drawn at the end.

    Raises
    ------
    PorocoreError
        pyvista is not installed.
    """
    if find_spec("pyvista") is None:
        raise PorocoreError(
            "pictures of local fields need pyvista, which is not installed: pip install pyvista, or leave "
            "them out with --no-pictures"
        )


def box_of(
    points: Array, shape: Array | None = None, displacement: Array | float = 0.0
) -> tuple[list[list[float]], tuple[float, ...]]:
    """Return the edges of the box around points (n, 3), deformed by a matrix, and bounds of it and the moved points.

    The box has 12 edges, each with two ends.
    """
    ends = np.stack([points.min(axis=0), points.max(axis=0)], axis=1)
    corners = np.array(list(product(*ends))) @ (np.eye(3) if shape is None else shape).T
    # The three axes are the bits of a corner's number.
    edges = [(i, i | bit) for i in range(8) for bit in (1, 2, 4) if not i & bit]
    shown = np.concatenate([points + displacement, corners])
    bounds = np.stack([shown.min(axis=0), shown.max(axis=0)], axis=1)
    return corners[np.ravel(edges)].tolist(), tuple(bounds.ravel().tolist())


def draw_views(vtu: Path, views: list[View], scratch: Path) -> None:
    """Every view of a file by a child process; with the next kind of window where one fails.

    Raises
    ------
    PorocoreError
        pyvista is not installed, or VTK finds nothing to draw with; the message says what to install.
    """
    if find_spec("pyvista") is None:
        raise PorocoreError(
            f"pictures need pyvista, which is not installed: pip install pyvista; {vtu} is written and "
            "opens in ParaView"
        )
    jobs = scratch / "jobs.json"
    jobs.write_text(json.dumps([asdict(view) for view in views]), encoding="utf-8")
    reason = ""
    for window in WINDOWS:
        try:
            done = subprocess.run(
                [sys.executable, "-m", "porocore.commands.fields.scene", str(vtu), str(jobs)],
                env={**os.environ, "VTK_DEFAULT_OPENGL_WINDOW": window},
                capture_output=True,
                text=True,
                errors="replace",
                timeout=SECONDS,
            )
        except subprocess.TimeoutExpired:
            reason = f"no picture within {SECONDS:g} s"
            continue
        if done.returncode == 0 and all(Path(view.png).exists() for view in views):
            return
        reason = reason or _reason(done)
    raise PorocoreError(
        f"VTK cannot draw without a display here ({reason}); it must be 9.4 or later and find EGL: on Debian or Ubuntu "
        f"run apt-get install {SYSTEM_PACKAGES}; {vtu} is written and opens in ParaView"
    )


def _reason(done: subprocess.CompletedProcess[str]) -> str:
    """The last thing that the child said, or how it ended."""
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    if done.returncode < 0:
        return f"it ended by signal {-done.returncode}"
    return lines[-1][:200] if lines else f"exit status {done.returncode}"


@styled
def _labelled(images: list[Array], title: str, label: str, top: float, beyond: float | None) -> Figure:
    """Images of the whole and of half with a title and a colour bar."""
    names = ("whole cell", "its rear half along $X_2$")
    figure, panels = image_panels(dict(zip(names, images, strict=True)), 9.2, 4.6)
    figure.suptitle(title, fontsize=11)
    colours: Any = ScalarMappable(Normalize(0.0, top), COLOURS)
    more = beyond is not None and beyond > top
    bar = figure.colorbar(colours, ax=panels, shrink=0.8, pad=0.02, extend="max" if more else "neither")
    bar.set_label(f"{label}; largest {beyond:.3g}" if more else label)
    return figure


def image_panels(images: dict[str, Array], width: float, height: float) -> tuple[Figure, list[Axes]]:
    """Return a figure with images by their titles, side by side without their common margin."""
    ink = np.any([(image < 0.995).any(axis=2) for image in images.values()], axis=0)
    rows, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
    kept = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    figure = new_figure(width, height)
    panels = list(np.atleast_1d(figure.subplots(1, len(images))))
    for axes, (title, image) in zip(panels, images.items(), strict=True):
        axes.imshow(image[kept])
        axes.set_axis_off()
        axes.set_title(title)
    return figure, panels


#: Colours of a phase with one region, and of several.
PHASE_COLOURS: dict[str, tuple[str, tuple[float, float]]] = {
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
            colours, span = (REGIONS[0], (-0.5, REGIONS[1] - 0.5)) if several else PHASE_COLOURS[mesh.phase]
            box, bounds = box_of(mesh.points)
            png = Path(scratch) / f"{mesh.phase}.png"
            draw_views(
                path, [View(str(png), "region", span, False, False, box, bounds, cmap=colours)], Path(scratch)
            )
            images[mesh.phase] = imread(png)[..., :3]
    figure = _beside(images, cell.geometry.description if titled else "")
    write_pictures(figure, picture, dpi=130)
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
