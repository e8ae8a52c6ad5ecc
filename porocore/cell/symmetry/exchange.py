"""Which axes of a state may change places, so that what was found for one class of perturbations holds for another."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from porocore.cell.meshing.mesh import CellMesh
from porocore.states import Array, IntArray

#: Of a displacement, in lengths of the cell: states that differ by less are the same.
EQUAL = 1e-7


def exchanged_axes(mesh: CellMesh, H: Array, u: Array) -> tuple[str, ...]:
    """Pairs of axes, "xz", whose exchange changes neither the mesh of the eighth nor u¹ (nodes, 3) under H."""
    found = []
    for i, j in ((0, 1), (0, 2), (1, 2)):
        order = _exchange(mesh, i, j)
        if order is None or abs(H[i, i] - H[j, j]) > EQUAL:
            continue
        if np.abs(u[order][:, _swapped(i, j)] - u).max() < EQUAL:
            found.append("xyz"[i] + "xyz"[j])
    return tuple(found)


def images(parity: str, swaps: Iterable[str]) -> set[str]:
    """A class, and those that exchanges of axes make of it."""
    swaps = tuple(swaps)
    found, fresh = {parity}, [parity]
    while fresh:
        name = fresh.pop()
        for pair in swaps:
            one, other = pair[0], pair[1]
            table = str.maketrans(one + other, other + one)
            image = "|".join("".join(sorted(part)) for part in name.translate(table).split("|"))
            if image not in found:
                found.add(image)
                fresh.append(image)
    return found


@lru_cache(maxsize=24)
def _exchange(mesh: CellMesh, i: int, j: int) -> IntArray | None:
    """The node that the exchange of two axes takes to each node; None where the mesh has no such symmetry."""
    points = mesh.points.round(9) + 0.0
    moved = points[:, _swapped(i, j)]
    here, there = np.lexsort(points.T), np.lexsort(moved.T)
    if not np.array_equal(points[here], moved[there]):
        return None
    order = np.empty(len(points), dtype=np.int64)
    order[here] = there
    cells = np.column_stack([np.sort(mesh.cells, axis=1), mesh.regions])
    image = np.column_stack([np.sort(order[mesh.cells], axis=1), mesh.regions])
    if not np.array_equal(cells[np.lexsort(cells.T)], image[np.lexsort(image.T)]):
        return None
    return order


def _swapped(i: int, j: int) -> list[int]:
    axes = [0, 1, 2]
    axes[i], axes[j] = j, i
    return axes
