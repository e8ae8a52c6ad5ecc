"""Geometries with the zero of a level set as their wall, and their meshes."""

from __future__ import annotations

from abc import abstractmethod
from math import ceil

from porocore.cell.geometry.part import PoreGeometry
from porocore.cell.level_sets.curving import phases
from porocore.cell.level_sets.cutting import LevelSet, cut
from porocore.cell.level_sets.lattice import body_centred
from porocore.cell.meshing.tetrahedra import Element, Phase, Tetrahedra
from porocore.errors import PorocoreError

#: Smallest number of cubes along the meshed part; with fewer, a periodic node may meet its own image.
FEWEST = 3


class LevelSetGeometry(PoreGeometry):
    """Geometry of a level set, on the eighth between its mirror planes or on the whole periodic cell."""

    @abstractmethod
    def level_set(self) -> LevelSet:
        """Return the level set, positive in the solid, with the mirrors or the period of the cell."""

    def tetrahedra(self, size: float, element: Element) -> dict[Phase, Tetrahedra]:
        return mesh_level_set(self, self.level_set(), size, element)


def mesh_level_set(
    geometry: PoreGeometry, level_set: LevelSet, size: float, element: Element
) -> dict[Phase, Tetrahedra]:
    """Return both phases of the eighth of a geometry with mirrors, or of its whole cell.

    Raises
    ------
    PorocoreError
        The size is too coarse for the pores.
    """
    periodic = geometry.unfolding == "whole"
    low, high = (-0.5, 0.5) if periodic else (0.0, 0.5)
    n = max(FEWEST, ceil((high - low) / size - 1e-9))
    lattice = body_centred(n, low, high, periodic=periodic)
    try:
        mesh = cut(lattice, level_set)
    except PorocoreError as error:
        raise PorocoreError(f"cannot mesh {geometry.description} at size {size:g}: {error}") from error
    return phases(mesh, lattice, level_set, element)
