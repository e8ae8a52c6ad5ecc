"""Mesh of a block of n₁ × n₂ × n₃ whole cells, for modes of longer periods; fields repeated on it.

Its first cell is the whole cell; that of cubic cells is [−½, n₁ − ½] × [−½, n₂ − ½] × [−½, n₃ − ½].
"""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np

from porocore.cell.meshing.mesh import CellMesh
from porocore.states import Array, IntArray

Periods = tuple[int, int, int]
#: Largest difference of the copies of a field where they meet, relative to its largest value.
SAME = 1e-6


@lru_cache(maxsize=4)
def block(mesh: CellMesh, periods: Periods) -> CellMesh:
    """Return the mesh of a block: copies of the mesh of a whole cell, joined at their faces.

    Raises
    ------
    ValueError
        The mesh is not that of one whole cell, or a number of cells is not positive.
    """
    if mesh.domain != "whole" or mesh.periods != (1, 1, 1):
        raise ValueError("a block is made of the mesh of one whole cell")
    first, inverse = _joined(mesh, periods)
    shifts = _shifts(periods) * mesh.sides
    points = (mesh.points[None] + shifts[:, None]).reshape(-1, 3)[first]
    n = len(mesh.points)
    cells = np.concatenate([inverse[mesh.cells + k * n] for k in range(len(shifts))])
    regions = np.tile(mesh.regions, len(shifts))
    return CellMesh(mesh.phase, "whole", points, cells, periods, regions, mesh.region_names, mesh.sides)


def tiled(mesh: CellMesh, u: Array, periods: Periods, signs: tuple[int, int, int] = (1, 1, 1)) -> Array:
    """Return a field of the whole cell on a block of its copies, (nodes of the block, 3).

    Parameters
    ----------
    mesh
        Mesh of one whole cell.
    u : (nodes, 3)
        Field at its nodes.
    periods
        Cells of the block along each axis.
    signs
        Factor of the field from one cell to the next along each axis: 1 for period one, −1 for a field that alternates,
        with opposite values on opposite faces of the cell.

    Raises
    ------
    ValueError
        The field is not continuous from cell to cell, or alternates over an odd number of cells.
    """
    if mesh.domain != "whole" or mesh.periods != (1, 1, 1) or u.shape != mesh.points.shape:
        raise ValueError(
            f"expected a field ({len(mesh.points)}, 3) on the mesh of one whole cell, got {u.shape}"
        )
    for axis, n, sign in zip("xyz", periods, signs, strict=True):
        if sign not in (1, -1):
            raise ValueError(f"signs: expected 1 or -1 along {axis}, got {sign}")
        if sign < 0 and n % 2:
            raise ValueError(f"a field that alternates along {axis} needs an even number of cells, got {n}")
    first, inverse = _joined(mesh, periods)
    cells = np.rint(_shifts(periods)).astype(np.int64)
    factors = np.prod(np.array(signs) ** cells, axis=1)
    copies = (factors[:, None, None] * u[None]).reshape(-1, 3)
    values: Array = copies[first]
    if np.abs(values[inverse] - copies).max(initial=0.0) > SAME * np.abs(u).max(initial=0.0):
        raise ValueError("the copies of the field do not meet: it is not periodic with these signs")
    return values


def _shifts(periods: Periods) -> Array:
    if min(periods) < 1:
        raise ValueError(f"expected positive numbers of cells, got {periods}")
    return np.array(list(product(*(range(n) for n in periods))), dtype=np.float64)


@lru_cache(maxsize=4)
def _joined(mesh: CellMesh, periods: Periods) -> tuple[IntArray, IntArray]:
    """Return the first copy of each node of the block, and the node of the block of each copy.

    The coordinates of copies agree exactly where they meet, as those of opposite faces of the cell do.
    """
    points = (mesh.points[None] + (_shifts(periods) * mesh.sides)[:, None]).reshape(-1, 3)
    _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    return first.astype(np.int64), inverse.reshape(-1).astype(np.int64)
