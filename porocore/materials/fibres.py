"""Directions of fibres in the undeformed solid."""

from __future__ import annotations

from itertools import product
from typing import Annotated

import numpy as np
from pydantic import AfterValidator

from porocore.materials.invariants import Fibre, Invariant, SecondFibre

Vector = tuple[float, float, float]
#: Unit vectors are the same, or opposite, if their product differs from ±1 by less.
SAME = 1e-12


def _unit(direction: Vector) -> Vector:
    length = float(np.linalg.norm(direction))
    if not 1e-6 < length < 1e6:
        raise ValueError(f"expected a direction [a1, a2, a3] other than 0, got {list(direction)}")
    if abs(length - 1) <= 4e-16:  # as written, so that what was normalised stays as it is
        return direction
    a1, a2, a3 = (float(a) / length for a in direction)
    return a1, a2, a3


#: Any length but 0; what is kept is the unit vector.
Direction = Annotated[Vector, AfterValidator(_unit)]


def fibre_invariants(directions: tuple[Vector, ...]) -> dict[str, Invariant]:
    """I4 and I5 of the first direction, I6 and I7 of the second, and so on."""
    found: dict[str, Invariant] = {}
    for k, direction in enumerate(directions):
        found |= {f"I{4 + 2 * k}": Fibre(direction), f"I{5 + 2 * k}": SecondFibre(direction)}
    return found


def alike(directions: tuple[Vector, ...]) -> bool:
    """Whether mirrors of the three axes take every direction to itself or its opposite: it lies along an axis."""
    return all(sum(abs(a) > SAME for a in direction) == 1 for direction in directions)


def closed(directions: tuple[Vector, ...]) -> bool:
    """Whether mirrors of the three axes take the directions to one another, each as often as it occurs."""

    def count(direction: tuple[float, ...]) -> int:
        return sum(abs(abs(float(np.dot(direction, other))) - 1) < SAME for other in directions)

    return all(
        count(tuple(s * a for s, a in zip(signs, direction, strict=True))) == count(direction)
        for direction in directions
        for signs in product((1.0, -1.0), repeat=3)
    )
