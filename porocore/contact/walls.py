"""Contact of the wall with itself and its periodic images, for the whole cell under any load.

Every quadrature point of the wall is held against the triangles of opposite facets (a quadratic facet counts as four);
g is its distance from the plane of the nearest one, and the energy is ε/8 ∫ ⟨−g⟩² dA over the undeformed wall: both
walls of a contact count and g is twice the distance from a mirror plane, so that a symmetric state has the energy that
:mod:`porocore.contact.mirrors` gives it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from porocore.cell.mesh import CellMesh
from porocore.contact.forces import Blocks, Forces
from porocore.contact.triangles import distance_derivatives, project
from porocore.contact.wall import wall_of
from porocore.states import Array, IntArray

if TYPE_CHECKING:
    from porocore.contact.model import Touching

#: The triangles of a facet (VTK order of its six nodes).
SUBTRIANGLES = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
#: Walls face each other where the product of their normals lies below this.
OPPOSED = -0.5
#: How far beside a triangle the foot of a perpendicular may lie, in barycentric coordinates.
BESIDE = 0.05
#: Facets that are neighbours and convex as seen from the pore do not touch, however thin the solid between them is.
CONVEX = 1e-3


class WallContact:
    """Of the whole cell.

    Parameters
    ----------
    mesh
        Of the solid.
    stiffness
        ε, as of :class:`~porocore.contact.mirrors.MirrorContact`.
    deepest
        Penetration of a mirror plane that is not accepted; of a wall it is twice as much.
    """

    def __init__(self, mesh: CellMesh, stiffness: float, deepest: float) -> None:
        self.mesh, self.stiffness, self.deepest = mesh, stiffness / 4, 2 * deepest
        self.wall = wall_of(mesh)
        facets = self.wall.facets
        local = SUBTRIANGLES if facets.shape[1] == 6 else np.array([[0, 1, 2]])
        #: Nodes of the triangles, (F, t, 3).
        self.triangles: IntArray = facets[:, local]
        #: Undeformed centres and normals of the facets, (F, 3).
        self.centres, self.normals, _ = _shape(mesh.points[facets[:, :3]])
        self.classes: IntArray = mesh.periodic_class[facets[:, :3]]

    def at(self, H: Array, u: Array, like: Touching | None = None) -> WallState:
        """At u (nodes, 3) under H, with the pairs of ``like`` or new ones."""
        x = self.mesh.points @ (np.eye(3) + H).T + u
        pairs = like.pairs if isinstance(like, WallState) else find_pairs(self, np.eye(3) + H, x)
        return WallState(self, np.eye(3) + H, x, pairs)


@dataclass(frozen=True, eq=False)
class Pairs:
    """m points of the wall, each with the triangle that it is held against.

    Attributes
    ----------
    N : (m, a)
        Shape functions at the point.
    weights : (m,)
        Its undeformed area.
    nodes : (m, a + 3)
        Of its facet and of the triangle.
    shifts : (m, 3)
        Of the triangle, in periods.
    """

    N: Array
    weights: Array
    nodes: IntArray
    shifts: Array


class WallState:
    """Gaps at one iterate, and what follows from them."""

    def __init__(self, contact: WallContact, F0: Array, x: Array, pairs: Pairs) -> None:
        self.contact, self.pairs = contact, pairs
        a = pairs.N.shape[1]
        points = np.einsum("ma,mai->mi", pairs.N, x[pairs.nodes[:, :a]])
        corners = x[pairs.nodes[:, a:]] + (pairs.shifts @ F0.T)[:, None]
        passed = np.flatnonzero(project(points, corners)[0] < 0)
        self._points, self._corners = points[passed], corners[passed]
        self._weights, self._N, self._nodes = pairs.weights[passed], pairs.N[passed], pairs.nodes[passed]
        self._places = contact.mesh.points[self._nodes]
        self._places[:, a:] += pairs.shifts[passed][:, None]

    @property
    def active(self) -> bool:
        """Whether anything touches."""
        return bool(len(self._points))

    @property
    def depth(self) -> float:
        """Of the deepest penetration."""
        return float(-self._distance[0].min(initial=0.0))

    @cached_property
    def _distance(self) -> tuple[Array, Array, Array]:
        return distance_derivatives(self._points, self._corners)

    @cached_property
    def _motion(self) -> Array:
        """∂z/∂x of the point and the vertices by the positions of the nodes, (m, 12, 3 (a + 3))."""
        m, a = self._N.shape
        motion = np.zeros((m, 4, 3, a + 3, 3))
        for i in range(3):
            motion[:, 0, i, :a, i] = self._N
            for vertex in range(3):
                motion[:, 1 + vertex, i, a + vertex, i] = 1.0
        return motion.reshape(m, 12, 3 * (a + 3))

    @cached_property
    def forces(self) -> Forces:
        """Energy and first derivatives."""
        g, slope, _ = self._distance
        force = self.contact.stiffness * self._weights * g
        gradient = (force[:, None, None] * slope[:, None, :] @ self._motion)[:, 0]
        return Forces(
            float(force @ g) / 2,
            self._nodes,
            self._places,
            gradient.reshape(*self._nodes.shape, 3),
            float(self._weights.sum()) / self.contact.wall.area,
        )

    def blocks(self, odd: str) -> Blocks:
        """Second derivatives; the whole cell has one class of perturbations only."""
        return self._blocks

    @cached_property
    def _blocks(self) -> Blocks:
        g, slope, bend = self._distance
        weight = (self.contact.stiffness * self._weights)[:, None, None]
        inner = weight * (slope[:, :, None] * slope[:, None, :] + g[:, None, None] * bend)
        matrices = self._motion.swapaxes(1, 2) @ inner @ self._motion
        return Blocks(self._nodes, self._places, matrices)


def find_pairs(contact: WallContact, F0: Array, x: Array) -> Pairs:
    """The points of the wall that are near an opposite triangle or have passed it, positions x (nodes, 3)."""
    wall, q = contact.wall, len(contact.wall.N)
    slave, master, shifts = _facing(contact, F0, x)
    points = np.einsum("qa,pai->pqi", wall.N, x[wall.facets[slave]])
    corners = x[contact.triangles[master]] + (shifts @ F0.T)[:, None, None]
    gaps, _, weights = project(points[:, :, None], corners[:, None])
    beside = np.maximum(-weights.min(axis=-1), 0.0)
    pair, point, triangle = np.nonzero((np.abs(gaps) < 2 * contact.deepest) & (beside < BESIDE))
    number = slave[pair] * q + point
    # The triangle that the point lies above, and of several the nearest: so g changes continuously when a point
    # slides from one triangle to the next, over an edge or a groove.
    order = np.lexsort((np.abs(gaps[pair, point, triangle]), beside[pair, point, triangle], number))
    chosen = order[np.unique(number[order], return_index=True)[1]]
    pair, point, triangle = pair[chosen], point[chosen], triangle[chosen]
    nodes = np.concatenate([wall.facets[slave[pair]], contact.triangles[master[pair], triangle]], axis=1)
    return Pairs(wall.N[point], wall.weights[slave[pair], point], nodes, shifts[pair])


def _facing(contact: WallContact, F0: Array, x: Array) -> tuple[IntArray, IntArray, Array]:
    """Pairs of facets that are near and face each other: slave, master, and the master's periodic shift (P, 3)."""
    centres, normals, radii = _shape(x[contact.wall.facets[:, :3]])
    reach = 2 * float(radii.max()) + contact.deepest
    tree = cKDTree(centres)
    low, high = centres.min(axis=0) - reach, centres.max(axis=0) + reach
    found = []
    for shift in product((-1.0, 0.0, 1.0), repeat=3):
        moved = centres + F0 @ np.array(shift)
        near = np.flatnonzero(((moved > low) & (moved < high)).all(axis=1))
        if not len(near):
            continue
        pairs = tree.sparse_distance_matrix(cKDTree(moved[near]), reach, output_type="ndarray")
        slave, master = pairs["i"].astype(np.int64), near[pairs["j"].astype(np.int64)]
        close = pairs["v"] < radii[slave] + radii[master] + contact.deepest
        opposed = (normals[slave] * normals[master]).sum(axis=1) < OPPOSED
        kept = np.flatnonzero(close & opposed)
        found.append((slave[kept], master[kept], np.tile(np.array(shift), (len(kept), 1))))
    slave, master, shifts = (np.concatenate(parts) for parts in zip(*found, strict=True))
    neighbours = (contact.classes[slave][:, :, None] == contact.classes[master][:, None, :]).any(axis=(1, 2))
    away = contact.centres[slave] - contact.centres[master] - shifts
    convex = (away * contact.normals[master]).sum(axis=1) < -CONVEX * np.linalg.norm(away, axis=1)
    kept = np.flatnonzero(~(neighbours & convex))
    return slave[kept], master[kept], shifts[kept]


def _shape(corners: Array) -> tuple[Array, Array, Array]:
    """Centres, unit normals (F, 3) and radii (F,) of triangles (F, 3, 3)."""
    centres = corners.mean(axis=1)
    m = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    return centres, m / np.linalg.norm(m, axis=1)[:, None], radii
