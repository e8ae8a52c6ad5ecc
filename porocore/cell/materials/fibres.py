"""Directions of fibres: unit vectors, turned ones, equal families, names of their invariants."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator

from porocore.cell.invariants.invariants import Fibre, Invariant, SecondFibre
from porocore.states import IntArray

Vector = tuple[float, float, float]
#: Tolerance of the product of parallel unit vectors.
SAME = 1e-12


def _unit(direction: Vector) -> Vector:
    length = float(np.linalg.norm(direction))
    if not 1e-6 < length < 1e6:
        raise ValueError(f"expected a direction [a1, a2, a3] other than 0, got {list(direction)}")
    if abs(length - 1) <= 4e-16:  # so that a normalised vector stays the same
        return direction
    a1, a2, a3 = (float(a) / length for a in direction)
    return a1, a2, a3


#: Vector of any length but 0, normalised.
Direction = Annotated[Vector, AfterValidator(_unit)]


def fibre_invariants(directions: tuple[Vector, ...]) -> dict[str, Invariant]:
    """Return I4 and I5 of the first direction, I6 and I7 of the second, and so on."""
    found: dict[str, Invariant] = {}
    for k, direction in enumerate(directions):
        found |= {f"I{4 + 2 * k}": Fibre(direction), f"I{5 + 2 * k}": SecondFibre(direction)}
    return found


def turned(directions: tuple[Vector, ...], Q: IntArray) -> tuple[Vector, ...]:
    """Return Q a of each direction a, for a signed permutation Q (3, 3)."""
    images = ((Q @ np.array(direction)).tolist() for direction in directions)
    return tuple((a1, a2, a3) for a1, a2, a3 in images)


def same_in_order(directions: tuple[Vector, ...], others: tuple[Vector, ...]) -> bool:
    """Return whether the k-th directions of both are parallel, for all k."""
    return len(directions) == len(others) and all(
        _parallel(a, b) for a, b in zip(directions, others, strict=True)
    )


def same_families(directions: tuple[Vector, ...], others: tuple[Vector, ...]) -> bool:
    """Return whether both have the same directions up to sign and order, with the same multiplicities."""

    def counts(among: tuple[Vector, ...]) -> list[int]:
        return [sum(_parallel(direction, other) for other in among) for direction in directions]

    return len(directions) == len(others) and counts(directions) == counts(others)


def _parallel(a: Vector, b: Vector) -> bool:
    return abs(abs(float(np.dot(a, b))) - 1) < SAME
