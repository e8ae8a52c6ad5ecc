"""Exchanges of axes that change neither mesh nor state: classes with equal results are solved once."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from porocore.cell.meshing.mesh import CellMesh
from porocore.core.echo import joined
from porocore.states import Array, IntArray

#: Tolerance of displacements, in lengths of the cell.
EQUAL = 1e-7


def exchanged_axes(mesh: CellMesh, H: Array, u: Array) -> tuple[str, ...]:
    """Return the pairs of axes, "xz", whose exchange changes neither the mesh of the eighth nor u¹ (nodes, 3)."""
    found = []
    for i, j in ((0, 1), (0, 2), (1, 2)):
        order = _exchange(mesh, i, j)
        if order is None or abs(H[i, i] - H[j, j]) > EQUAL:
            continue
        if np.abs(u[order][:, _swapped(i, j)] - u).max() < EQUAL:
            found.append("xyz"[i] + "xyz"[j])
    return tuple(found)


def images(parity: str, swaps: Iterable[str]) -> set[str]:
    """Return the orbit of a parity class under exchanges of axes."""
    tables = [str.maketrans(pair, pair[::-1]) for pair in swaps]
    found, fresh = {parity}, [parity]
    while fresh:
        name = fresh.pop()
        for table in tables:
            image = "|".join("".join(sorted(part)) for part in name.translate(table).split("|"))
            if image not in found:
                found.add(image)
                fresh.append(image)
    return found


def axis_order(parity: str, image: str, swaps: Iterable[str]) -> tuple[int, int, int]:
    """Return the order of axes, product of exchanges, by which a parity class without a bar is mapped onto an image.

    What belongs to the axis a in ``image`` belongs to the axis order[a] in ``parity``.

    Raises
    ------
    ValueError
        It is no image.
    """
    found: list[tuple[int, int, int]] = [(0, 1, 2)]
    for order in found:
        if image == "".join(sorted("xyz"[order.index("xyz".index(axis))] for axis in parity)):
            return order
        for pair in swaps:
            i, j = ("xyz".index(axis) for axis in pair)
            further = list(order)
            further[i], further[j] = order[j], order[i]
            if (moved := (further[0], further[1], further[2])) not in found:
                found.append(moved)
    raise ValueError(f"'{image}' is no image of '{parity}' under exchanges of {joined(swaps)}")


@lru_cache(maxsize=24)
def _exchange(mesh: CellMesh, i: int, j: int) -> IntArray | None:
    """Return the node that the exchange of two axes maps onto each node; None without that symmetry."""
    points = mesh.points.round(9) + 0.0
    moved = points[:, _swapped(i, j)]
    sorted_points, sorted_images = np.lexsort(points.T), np.lexsort(moved.T)
    if not np.array_equal(points[sorted_points], moved[sorted_images]):
        return None
    order = np.empty(len(points), dtype=np.int64)
    order[sorted_points] = sorted_images
    cells = np.column_stack([np.sort(mesh.cells, axis=1), mesh.regions])
    image = np.column_stack([np.sort(order[mesh.cells], axis=1), mesh.regions])
    same = np.array_equal(cells[np.lexsort(cells.T)], image[np.lexsort(image.T)])
    return order if same else None


def _swapped(i: int, j: int) -> list[int]:
    axes = [0, 1, 2]
    axes[i], axes[j] = j, i
    return axes
