"""Nodes of oblique surfaces: their displacement in a frame whose first axes are what is prescribed there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy import sparse

from porocore.body.mesh import BodyMesh
from porocore.states import Array, IntArray

#: A direction (3,) along which the displacement is prescribed, the number of the course and the factor on it.
Constraint = tuple[Array, int, float]


def in_frames(
    mesh: BodyMesh,
    oblique: Mapping[int, list[Constraint]],
    others: Callable[[int], list[Constraint]],
    courses: int,
) -> tuple[Any, tuple[IntArray, Array]]:
    """Rotation into the frames, and what is prescribed there.

    Parameters
    ----------
    oblique
        Constraints of each node on an oblique surface.
    others
        The constraints on Cartesian components of a node.
    courses
        How many there are.

    Returns
    -------
    rotation, (unknowns, values)
        Orthogonal matrix (unknowns, unknowns), None without oblique surfaces; prescribed unknowns (k,) of these nodes
        and their values (k, courses) for a unit of each course. Of constraints that depend on each other the first
        counts.
    """
    if not oblique:
        return None, (np.empty(0, dtype=np.int64), np.empty((0, courses)))
    rotation = sparse.identity(mesh.size, format="lil")
    unknowns, values = [], []
    for node, constraints in oblique.items():
        frame, prescribed = _frame([*constraints, *others(node)], courses)
        for row in range(3):
            for column in range(3):
                rotation[3 * node + row, 3 * node + column] = frame[row, column]
        unknowns += [3 * node + row for row in range(len(prescribed))]
        values += prescribed
    order = np.argsort(unknowns)
    return rotation.tocsr(), (np.array(unknowns, dtype=np.int64)[order], np.array(values)[order])


def _frame(constraints: list[Constraint], courses: int) -> tuple[Array, list[Array]]:
    """Orthonormal rows (3, 3), the first of them prescribed, and the values (courses,) of these."""
    rows: list[Array] = []
    values: list[Array] = []
    for normal, course, factor in constraints:
        value = np.zeros(courses)
        value[course] = factor
        # What earlier rows leave of it (Gram–Schmidt).
        rest = normal.copy()
        for row, known in zip(rows, values, strict=True):
            share = row @ normal
            rest, value = rest - share * row, value - share * known
        length = np.linalg.norm(rest)
        if length > 1e-6:
            rows.append(rest / length)
            values.append(value / length)
    for axis in np.eye(3):
        rest = axis - sum((row @ axis) * row for row in rows)
        length = np.linalg.norm(rest)
        if len(rows) < 3 and length > 0.5:
            rows.append(rest / length)
    return np.array(rows), values
