"""Penalty energy, gradient and blocks of the points of the wall that have penetrated a triangle."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.cell.contact.forces import Blocks
from porocore.cell.contact.triangles import distance_derivatives
from porocore.states import Array, IntArray


@dataclass(frozen=True, eq=False)
class PenetratingPoints:
    """m points that have penetrated their triangle, and the motion of both with the nodes.

    Attributes
    ----------
    points : (m, 3), corners : (m, 3, 3), where : (m,)
        Positions, and the part of the triangle that is nearest.
    weights : (m,)
        Undeformed area times stiffness.
    motion : (m, 12, 3 k)
        Derivative of point and corners by the positions of k nodes.
    nodes : (m, k), places : (m, k, 3)
        See :class:`~porocore.cell.contact.forces.Blocks`.
    number : (m,)
        Number of each point among all points of the wall.
    """

    points: Array
    corners: Array
    where: IntArray
    weights: Array
    motion: Array
    nodes: IntArray
    places: Array
    number: IntArray

    @cached_property
    def distance(self) -> tuple[Array, Array, Array]:
        """Distance g, its gradient and its Hessian by the positions of point and corners."""
        return distance_derivatives(self.points, self.corners, self.where)

    @property
    def energy(self) -> float:
        """Penalty energy Σ weight g²/2."""
        g = self.distance[0]
        return float(self.weights @ (g * g)) / 2

    @property
    def gradient(self) -> Array:
        """Gradient of the energy by the positions of the nodes, (m, k, 3)."""
        g, gradient, _ = self.distance
        force = ((self.weights * g)[:, None, None] * gradient[:, None, :] @ self.motion)[:, 0]
        return force.reshape(*self.nodes.shape, 3)

    @property
    def blocks(self) -> Blocks:
        """Second derivatives of the energy."""
        g, gradient, hessian = self.distance
        inner = gradient[:, :, None] * gradient[:, None, :] + g[:, None, None] * hessian
        matrices = self.motion.swapaxes(1, 2) @ (self.weights[:, None, None] * inner) @ self.motion
        return Blocks(self.nodes, self.places, matrices)


def motion_of(N: Array, corners: Array) -> Array:
    """Return the motion (m, 12, 3 (a + 3)) of points, by N (m, a), and of triangles, by ``corners`` (3, 3) a corner."""
    m, a = N.shape
    motion = np.zeros((m, 4, 3, a + 3, 3))
    for i in range(3):
        motion[:, 0, i, :a, i] = N
    for vertex in range(3):
        motion[:, 1 + vertex, :, a + vertex, :] = corners
    return motion.reshape(m, 12, 3 * (a + 3))
