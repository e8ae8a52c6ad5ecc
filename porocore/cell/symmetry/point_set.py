"""Point groups of periodic sets of points, and of cells of voxels.

A cell is periodic, so its origin is arbitrary: Q belongs to its point group if x → Q x + t maps the cell onto itself
for some shift t. Each candidate for t maps one point of a rare kind onto another one of that kind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product

import numpy as np
import numpy.typing as npt

from porocore.cell.geometry.sides import CUBE, Sides
from porocore.core.tensors.point_group import CUBE_OPERATIONS, TRIVIAL, PointGroup
from porocore.states import Array, IntArray

#: Shifts that are tried for one operation; with more candidates the group may be too small, never too large.
MOST_SHIFTS = 256
#: Points on which a shift is tried before it is tried on all.
FIRST = 32
MOST_VOXEL_SHIFTS = 4e6
#: Voxels at which shifts are tested, one after the other.
PROBES = 256

Mask = npt.NDArray[np.bool_]
#: Condition on an operation Q and on the point onto which each point is mapped.
Allows = Callable[[IntArray, IntArray], bool]


def group_of_points(
    points: Array, labels: IntArray, tolerance: float, allows: Allows = lambda Q, order: True
) -> PointGroup:
    """Return the point group of a set of points with the period 1.

    Parameters
    ----------
    points : (n, 3)
        Points of one period.
    labels : (n,)
        Points with different labels are not mapped onto each other.
    tolerance
        Largest distance of an image from a point.
    allows
        Further condition on an operation.
    """
    if not len(points):
        return TRIVIAL
    return PointGroup.generated(
        [
            Q
            for Q in CUBE_OPERATIONS
            if any(allows(Q, order) for order in images_of_points(points, labels, tolerance, Q))
        ]
    )


def images_of_points(
    points: Array, labels: IntArray, tolerance: float, Q: IntArray, sides: Sides = CUBE
) -> Iterator[IntArray]:
    """Yield the image (n,) of each point, for each shift with which Q (3, 3) maps the set onto itself.

    The periods of the set are ``sides``, and Q exchanges equal ones only.
    """
    from scipy.spatial import cKDTree  # slow to import

    tree = cKDTree(_wrapped(points, sides), boxsize=sides)
    count = np.bincount(labels)
    rare = np.flatnonzero(labels == np.where(count > 0, count, len(labels) + 1).argmin())
    turned = points @ Q.T

    def nearest(rows: slice, shift: Array) -> tuple[Array, IntArray]:
        distance, index = tree.query(_wrapped(turned[rows] + shift, sides))
        return distance, np.asarray(index, dtype=np.int64)

    for goal in rare[:MOST_SHIFTS]:
        shift = points[goal] - turned[rare[0]]
        for rows in (slice(FIRST), slice(None)):
            distance, order = nearest(rows, shift)
            if (distance > tolerance).any() or (labels[order] != labels[rows]).any():
                break
        else:
            if len(np.unique(order)) == len(points):
                yield order


def _wrapped(points: Array, sides: Sides) -> Array:
    """Return points (n, 3) shifted by whole periods into the box from 0 to ``sides``."""
    within = points - np.floor(points / sides) * sides
    return np.where((within < 0) | (within >= sides), 0.0, within)


def kinds(values: Array, tolerance: float) -> IntArray:
    """Return a label for each row of values (n, k), equal for rows that differ by less than a tolerance."""
    labels = np.zeros(len(values), dtype=np.int64)
    for column in values.T:
        order = np.argsort(column, kind="stable")
        steps = np.concatenate([[False], np.diff(column[order]) > tolerance])
        number = np.empty(len(column), dtype=np.int64)
        number[order] = np.cumsum(steps)
        labels = np.unique(np.column_stack([labels, number]), axis=0, return_inverse=True)[1].reshape(-1)
    return labels


def group_of_voxels(solid: Mask, *, mirror: bool, sides: Sides = CUBE) -> PointGroup:
    """Return the point group of a cell of voxels (n₁, n₂, n₃) with these sides, exactly.

    With ``mirror`` they are the eighth of the cell, mirrored at its sides; else they are the whole cell.
    """
    box = np.array([sides, solid.shape])
    operations = [Q for Q in CUBE_OPERATIONS if np.array_equal(box @ np.abs(Q), box)]
    if mirror:
        flips = list(product((1, -1), repeat=3))
        return PointGroup.generated(
            [np.diag(signs) for signs in flips]
            # Reversed along an axis, the eighth is that of the cell shifted by half a period.
            + [
                Q
                for Q in operations
                if any(np.array_equal(_turned(_flipped(solid, signs), np.abs(Q)), solid) for signs in flips)
            ]
        )
    profiles = [solid.sum(axis=tuple(a for a in range(3) if a != axis)) for axis in range(3)]
    uniform = [np.array_equal(np.roll(solid, 1, axis=axis), solid) for axis in range(3)]

    def allowed(Q: IntArray) -> bool:
        along = []
        for axis, (old, sign) in enumerate(_axes(Q)):
            profile = profiles[old][::sign]
            shifts = [
                s for s in range(solid.shape[axis]) if np.array_equal(np.roll(profile, s), profiles[axis])
            ]
            along.append(shifts[:1] if uniform[axis] and uniform[old] else shifts)
        return _shifts_onto(_turned(solid, Q), solid, along)

    return PointGroup.generated([Q for Q in operations if allowed(Q)])


def _axes(Q: IntArray) -> list[tuple[int, int]]:
    """Return the axis that x → Q x maps onto each of the three, and its sign."""
    return [(int(np.abs(row).argmax()), int(row.sum())) for row in Q]


def _turned(voxels: Mask, Q: IntArray) -> Mask:
    """Return the voxels after x → Q x about the middle."""
    axes = _axes(Q)
    return _flipped(voxels.transpose([old for old, _ in axes]), tuple(sign for _, sign in axes))


def _flipped(voxels: Mask, signs: tuple[int, ...]) -> Mask:
    return voxels[tuple(slice(None, None, sign) for sign in signs)]


def _shifts_onto(one: Mask, other: Mask, along: list[list[int]]) -> bool:
    """Return whether one of the shifts by whole voxels ``along`` each axis maps one onto the other."""
    if np.prod([float(len(shifts)) for shifts in along]) > MOST_VOXEL_SHIFTS:
        return False
    shifts = np.stack(np.meshgrid(*along, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.int64)
    n = np.array(one.shape)
    for at in np.random.default_rng(0).integers(0, n, (PROBES, 3)):
        if len(shifts) <= 1:
            break
        source = (at - shifts) % n
        shifts = shifts[one[source[:, 0], source[:, 1], source[:, 2]] == other[tuple(at)]]
    return any(
        np.array_equal(np.roll(one, tuple(int(s) for s in shift), axis=(0, 1, 2)), other)
        for shift in shifts[:MOST_SHIFTS]
    )
