"""Points of the wall that have passed a triangle: the penalty on their distance from its plane."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.cell.contact.forces import Blocks
from porocore.cell.contact.triangles import distance_derivatives
from porocore.states import Array, IntArray


@dataclass(frozen=True, eq=False)
class PenetratingPoints:
    """The points that have passed their triangle, m of them, and how it moves with the nodes.

    Attributes
    ----------
    points : (m, 3), corners : (m, 3, 3), where : (m,)
        Positions, and what part of the triangle is nearest.
    weights : (m,)
        Undeformed area times stiffness.
    motion : (m, 12, 3 k)
        Of the point and the corners, by the positions of k nodes.
    nodes : (m, k), places : (m, k, 3)
        As in :class:`~porocore.cell.contact.forces.Blocks`.
    """

    points: Array
    corners: Array
    where: IntArray
    weights: Array
    motion: Array
    nodes: IntArray
    places: Array

    @cached_property
    def distance(self) -> tuple[Array, Array, Array]:
        """g, its slopes and its second derivatives by the point and the corners."""
        return distance_derivatives(self.points, self.corners, self.where)

    @property
    def energy(self) -> float:
        """Σ weight g²/2."""
        g = self.distance[0]
        return float(self.weights @ (g * g)) / 2

    @property
    def gradient(self) -> Array:
        """By the positions of the nodes, (m, k, 3)."""
        g, slope, _ = self.distance
        gradient = ((self.weights * g)[:, None, None] * slope[:, None, :] @ self.motion)[:, 0]
        return gradient.reshape(*self.nodes.shape, 3)

    @property
    def blocks(self) -> Blocks:
        """Second derivatives."""
        g, slope, bend = self.distance
        inner = slope[:, :, None] * slope[:, None, :] + g[:, None, None] * bend
        matrices = self.motion.swapaxes(1, 2) @ (self.weights[:, None, None] * inner) @ self.motion
        return Blocks(self.nodes, self.places, matrices)


def motion_of(N: Array, corners: Array) -> Array:
    """(m, 12, 3 (a + 3)) of points with shape functions N (m, a), and of corners that move by ``corners`` (3, 3)."""
    m, a = N.shape
    motion = np.zeros((m, 4, 3, a + 3, 3))
    for i in range(3):
        motion[:, 0, i, :a, i] = N
    for vertex in range(3):
        motion[:, 1 + vertex, :, a + vertex, :] = corners
    return motion.reshape(m, 12, 3 * (a + 3))
