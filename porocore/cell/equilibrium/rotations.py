"""Loads that only rotate the deformed cell (load_basis): under δH = W F₀ with a skew W, u¹ moves by W u¹.

The energies of solid and contact do not change under rotations, so this holds for each solid, whatever its fibres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from porocore.states import Array


@dataclass(frozen=True, eq=False)
class LoadBasis:
    """Loads of a parity class in which as many as possible are rotations.

    Attributes
    ----------
    loads : (k, k)
        The new loads in columns, by the loads of the class; rotations are the last ones.
    spins : (r, 3, 3)
        W of the rotations.
    """

    loads: Array
    spins: Array


def load_basis(H: Array, columns: Sequence[int]) -> LoadBasis:
    """Return the basis of loads ``columns`` of the ten θ = (H_11, …, H_33, p) at H."""
    F0, found = np.eye(3) + H, dict[str, list[Array]]()
    others = np.setdiff1d(np.arange(9), columns)
    for name, sign in (("stretches", 1.0), ("spins", -1.0)):
        motions = [
            _unit(i, j) + sign * _unit(j, i) for i in range(3) for j in range(i if sign > 0 else i + 1, 3)
        ]
        found[name] = [motion for motion in motions if not (motion @ F0).ravel()[others].any()]
    loads = np.zeros((10, sum(map(len, found.values())) + (9 in columns)))
    for place, motion in enumerate(found["stretches"]):
        loads[:9, place] = (motion @ F0).ravel()
    if 9 in columns:
        loads[9, len(found["stretches"])] = 1.0
    for place, motion in enumerate(found["spins"], start=-len(found["spins"])):
        loads[:9, place] = (motion @ F0).ravel()
    if loads.shape[1] < len(columns):
        return LoadBasis(np.eye(len(columns)), np.zeros((0, 3, 3)))
    return LoadBasis(loads[list(columns)], np.reshape(found["spins"], (-1, 3, 3)))


def _unit(i: int, j: int) -> Array:
    unit = np.zeros((3, 3))
    unit[i, j] = 1.0
    return unit
