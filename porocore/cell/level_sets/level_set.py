"""Geometries with the zero of a level set as their wall, and their meshes."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from porocore.cell.geometry.part import PoreGeometry
from porocore.cell.level_sets.curving import phases
from porocore.cell.level_sets.cutting import LevelSet, cut
from porocore.cell.level_sets.lattice import body_centred
from porocore.cell.meshing.estimate import PER_CUBE, require_few
from porocore.cell.meshing.tetrahedra import Element, Phase, Tetrahedra
from porocore.errors import PorocoreError

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
    geometry: PoreGeometry, level_set: LevelSet, size: float, element: Element
) -> dict[Phase, Tetrahedra]:
    """Return both phases of the eighth of a geometry with mirrors, or of its whole cell.

    Raises
    ------
    PorocoreError
        The size is too coarse for the pores.
    """
    periodic = geometry.unfolding == "whole"
    high = np.array(geometry.sides) / 2
    low = -high if periodic else np.zeros(3)
    edge = min(size, (high - low).min() / FEWEST)
    n = np.ceil((high - low) / edge - 1e-9).astype(np.int64)
    if edge < size:  # more elements than were expected of the size
        require_few(PER_CUBE * float(n.prod()), "cell.geometry: its box is too flat")
    lattice = body_centred(n, low, high, periodic=periodic)
    try:
        mesh = cut(lattice, level_set)
    except PorocoreError as error:
        raise PorocoreError(f"cannot mesh {geometry.description} at size {size:g}: {error}") from error
    return phases(mesh, lattice, level_set, element)
