"""Base of geometries by a level set: their meshes, edge of the lattice, removal of crumbs and specks."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace

import numpy as np

from porocore.cell.geometry.pore_geometry import PoreGeometry
from porocore.cell.level_sets.curving import phases
from porocore.cell.level_sets.cutting import LevelSet, TwoPhases, cut
from porocore.cell.level_sets.lattice import body_centred
from porocore.cell.meshing.connectivity import crumbs
from porocore.cell.meshing.estimate import PER_CUBE, require_few
from porocore.cell.meshing.tetrahedra import Element, Phase, Tetrahedra, volumes
from porocore.errors import PorocoreError
from porocore.states import Array, IntArray

#: Smallest piece of a phase that the mesh keeps, in cubes: four tetrahedra. At a neck as narrow as an element single
#: ones come off.
CRUMB = 1 / 3
#: Share of the solid up to which pieces that came loose are taken for specks. Of 22 images of smoothed noise with such
#: pieces, at three voxels a tetrahedron, they were at most 2 % of the solid in 19, and 4 to 7 % in three.
SPECKS = 0.02
#: Smallest number of cubes along any side of the meshed part; with fewer, a periodic node may meet its own image.
FEWEST = 3


class LevelSetGeometry(PoreGeometry):
    """Geometry of a level set, on the eighth between its mirror planes or on the whole periodic cell."""

    @abstractmethod
    def level_set(self) -> LevelSet:
        """Return the level set, positive in the solid, with the mirrors or the period of the cell."""

    def tetrahedra(self, size: float, element: Element) -> dict[Phase, Tetrahedra]:
        return mesh_level_set(self, self.level_set(), size, element)


def mesh_level_set(
    geometry: PoreGeometry, level_set: LevelSet, size: float, element: Element, *, drop_specks: bool = False
) -> dict[Phase, Tetrahedra]:
    """Return both phases of the eighth of a geometry with mirrors, or of its whole cell.

    With ``drop_specks`` small pieces of the solid that touch nothing belong to the fluid.

    Raises
    ------
    PorocoreError
        The size is too coarse for the pores.
    """
    periodic = geometry.unfolding == "whole"
    high = np.array(geometry.sides) / 2
    low = -high if periodic else np.zeros(3)
    n = _counts(high - low, size)
    if size > (high - low).min() / FEWEST:  # more elements than were expected of the size
        require_few(PER_CUBE * float(n.prod()), "cell.geometry: its box is too flat")
    lattice = body_centred(n, low, high, periodic=periodic)
    try:
        mesh = cut(lattice, level_set)
    except PorocoreError as error:
        raise PorocoreError(f"cannot mesh {geometry.description} at size {size:g}: {error}") from error
    mesh = _without_crumbs(mesh, CRUMB * lattice.spacing.prod())
    return phases(_without_specks(mesh) if drop_specks else mesh, lattice, level_set, element)


def lattice_edges(geometry: PoreGeometry, size: float) -> tuple[float, float]:
    """Return the edge of the lattice's cubes, the longest one, and the size below which all sizes give this lattice.

    A whole number of cubes fills each side of the meshed part, so their edge is at most the size; it is itself the
    smallest size of this lattice. The second number is infinite where the lattice is the coarsest one.
    """
    span = np.array(geometry.sides) / (1 if geometry.unfolding == "whole" else 2)
    n = _counts(span, size)
    coarser = float((span / np.maximum(n - 1, 1)).min())
    return float((span / n).max()), coarser if coarser <= span.min() / FEWEST * (1 + 1e-9) else np.inf


def _counts(span: Array, size: float) -> IntArray:
    """Return the number of cubes (3,) along each side of the meshed part."""
    edge = min(size, float(span.min()) / FEWEST)
    return np.asarray(np.ceil(span / edge - 1e-9), dtype=np.int64)


def _without_crumbs(mesh: TwoPhases, least: float) -> TwoPhases:
    """Return a mesh whose pieces below a volume belong to the other phase."""
    flipped = crumbs(mesh.cells, mesh.first, mesh.solid, volumes(mesh.points, mesh.cells), least)
    return replace(mesh, solid=mesh.solid ^ flipped)


def _without_specks(mesh: TwoPhases) -> TwoPhases:
    """Return a mesh with all pieces of the solid but its largest in the fluid, unless they are more than specks."""
    sizes = volumes(mesh.points, mesh.cells)
    loose = mesh.solid & crumbs(mesh.cells, mesh.first, mesh.solid, sizes, np.inf)
    if sizes[loose].sum() > SPECKS * sizes[mesh.solid].sum():
        return mesh
    return replace(mesh, solid=mesh.solid & ~loose)
