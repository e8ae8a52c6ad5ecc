"""Negative pivots of the tangent for each wave vector with components in {0, π}, on the eighth of the cell.

Each wave vector is eight classes of perturbations (:func:`porocore.cell.parity.bloch_classes`), and each class a
tangent of the eighth with its own held displacements. By Sylvester's law their negative pivots add up to the number of
modes of that wave vector under which the energy falls.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from porocore.cell.mesh import CellMesh
from porocore.cell.parity import bloch_classes
from porocore.equilibrium.discrete import DiscreteSolid, Iterate
from porocore.states import IntArray

#: "110" is k = (π, π, 0), period two along x and y.
WAVES = tuple(bloch_classes())
#: Wave vectors that differ by the naming of the axes only.
FAMILIES = {"0": ("000",), "100": ("100", "010", "001"), "110": ("110", "101", "011"), "111": ("111",)}
#: Free unknowns up to which the factors of all classes are kept for the next state; they take some 10 kB an unknown.
KEPT = 10_000
#: Of a displacement, in lengths of the cell: states that differ by less are the same.
EQUAL = 1e-7


def negative_pivots(solid: DiscreteSolid, here: Iterate, waves: Iterable[str] = WAVES) -> dict[str, int]:
    """Number of unstable modes of each wave vector at an equilibrium; −1 where the linear solver cannot tell.

    Parameters
    ----------
    solid
        On the eighth.
    here
        An equilibrium under a diagonal H.
    waves
        Out of :data:`WAVES`.

    Raises
    ------
    FactorError
        A tangent cannot be factorised.
    """
    of_class: dict[str, int] = {}
    swaps = exchanged_axes(solid.mesh, here)
    found = {}
    for wave in waves:
        counts = []
        for odd in bloch_classes()[wave]:
            representative = min(images(odd, swaps))
            if representative not in of_class:
                of_class[representative] = solid.negative_pivots(here, representative)
                if "|" in representative and len(here.residual) > KEPT:
                    solid.forget(representative)
            counts.append(of_class[representative])
        found[wave] = -1 if min(counts) < 0 else sum(counts)
    return found


def exchanged_axes(mesh: CellMesh, here: Iterate) -> tuple[str, ...]:
    """Pairs of axes, "xz", whose exchange changes neither the mesh nor the state: such classes share their pivots."""
    found = []
    u = here.displacement
    for i, j in ((0, 1), (0, 2), (1, 2)):
        order = _exchange(mesh, i, j)
        if order is None or abs(here.H[i, i] - here.H[j, j]) > EQUAL:
            continue
        if np.abs(u[order][:, _swapped(i, j)] - u).max() < EQUAL:
            found.append("xyz"[i] + "xyz"[j])
    return tuple(found)


def images(odd: str, swaps: Iterable[str]) -> set[str]:
    """A class, and those that exchanges of axes make of it."""
    swaps = tuple(swaps)
    found, fresh = {odd}, [odd]
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
    cells = np.sort(mesh.cells, axis=1)
    image = np.sort(order[mesh.cells], axis=1)
    if not np.array_equal(cells[np.lexsort(cells.T)], image[np.lexsort(image.T)]):
        return None
    return order


def _swapped(i: int, j: int) -> list[int]:
    axes = [0, 1, 2]
    axes[i], axes[j] = j, i
    return axes
