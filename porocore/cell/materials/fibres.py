"""Directions of fibres: unit vectors, turned ones, equal families, names of their invariants."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag

from porocore.cell.invariants.invariants import Fibre, Invariant, SecondFibre
from porocore.core.models.strict import StrictModel
from porocore.core.units import Unit
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


class FibreAngle(StrictModel):
    """Direction of fibres by an angle in a plane of two axes."""

    plane: Literal["xy", "yz", "zx"]
    """The two axes, from the first of which the angle is measured towards the second."""
    angle: Annotated[float, Field(ge=-360, le=360), Unit("°")]
    """Angle in degrees: 0 is along the first axis, 90 along the second."""

    @property
    def vector(self) -> Vector:
        """Unit vector (3,)."""
        turn = self.angle * np.pi / 180
        along = dict.fromkeys("xyz", 0.0) | {self.plane[0]: np.cos(turn), self.plane[1]: np.sin(turn)}
        return along["x"], along["y"], along["z"]


def _form(direction: Any) -> str:
    return "in-plane" if isinstance(direction, Mapping | FibreAngle) else "vector"


#: Vector of any length but 0, normalised; or an angle in a plane.
Direction = Annotated[
    Annotated[Vector, AfterValidator(_unit), Tag("vector")] | Annotated[FibreAngle, Tag("in-plane")],
    Discriminator(_form),
]
Directions = tuple[Vector | FibreAngle, ...]


def vectors(directions: Directions) -> tuple[Vector, ...]:
    """Return the unit vectors of all directions."""
    return tuple(d.vector if isinstance(d, FibreAngle) else d for d in directions)


def fibre_invariants(directions: Directions) -> dict[str, Invariant]:
    """Return I4 and I5 of the first direction, I6 and I7 of the second, and so on."""
    found: dict[str, Invariant] = {}
    for k, direction in enumerate(vectors(directions)):
        found |= {f"I{4 + 2 * k}": Fibre(direction), f"I{5 + 2 * k}": SecondFibre(direction)}
    return found


def turned(directions: Directions, Q: IntArray) -> tuple[Vector, ...]:
    """Return Q a of each direction a, for a signed permutation Q (3, 3)."""
    images = ((Q @ np.array(direction)).tolist() for direction in vectors(directions))
    return tuple((a1, a2, a3) for a1, a2, a3 in images)


def same_in_order(directions: Directions, others: Directions) -> bool:
    """Return whether the k-th directions of both are parallel, for all k."""
    return len(directions) == len(others) and all(
        _parallel(a, b) for a, b in zip(vectors(directions), vectors(others), strict=True)
    )


def same_families(directions: Directions, others: Directions) -> bool:
    """Return whether both have the same directions up to sign and order, with the same multiplicities."""

    def counts(among: Directions) -> list[int]:
        return [sum(_parallel(a, b) for b in vectors(among)) for a in vectors(directions)]

    return len(directions) == len(others) and counts(directions) == counts(others)


def _parallel(a: Vector, b: Vector) -> bool:
    return abs(abs(float(np.dot(a, b))) - 1) < SAME
