"""Contact of the wall with itself and its periodic images, for the whole cell under any load.

Every quadrature point of the wall is held against the triangles of opposite facets (a quadratic facet counts as four);
g is its distance from the plane of the nearest one, and the energy is ε/8 ∫ ⟨−g⟩² dA over the undeformed wall: both
walls of a contact count and g is twice the distance from a mirror plane, so that a symmetric state has the energy that
:mod:`porocore.contact.mirrors` gives it.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product

import numpy as np
from scipy.spatial import cKDTree

from porocore.cell.mesh import CellMesh
from porocore.contact.forces import Blocks, Forces
from porocore.contact.triangles import distance_derivatives, project
from porocore.contact.wall import wall_of
from porocore.states import Array, IntArray

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

    def at(self, H: Array, u: Array) -> WallState:
        """At u (nodes, 3) under H."""
        return WallState(self, H, u)


class WallState:
    """Gaps at one iterate, and what follows from them."""

    def __init__(self, contact: WallContact, H: Array, u: Array) -> None:
        self.contact = contact
        mesh = contact.mesh
        self._F0 = np.eye(3) + H
        self._x = mesh.points @ self._F0.T + u
        self._find(*self._facing())

    def _facing(self) -> tuple[IntArray, IntArray, Array]:
        """Pairs of facets that are near and face each other: slave, master, and the master's periodic shift (P, 3)."""
        contact = self.contact
        centres, normals, radii = _shape(self._x[contact.wall.facets[:, :3]])
        reach = 2 * float(radii.max()) + contact.deepest
        tree = cKDTree(centres)
        low, high = centres.min(axis=0) - reach, centres.max(axis=0) + reach
        found = []
        for shift in product((-1.0, 0.0, 1.0), repeat=3):
            moved = centres + self._F0 @ np.array(shift)
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
        neighbours = (contact.classes[slave][:, :, None] == contact.classes[master][:, None, :]).any(
            axis=(1, 2)
        )
        away = contact.centres[slave] - contact.centres[master] - shifts
        convex = (away * contact.normals[master]).sum(axis=1) < -CONVEX * np.linalg.norm(away, axis=1)
        kept = np.flatnonzero(~(neighbours & convex))
        return slave[kept], master[kept], shifts[kept]

    def _find(self, slave: IntArray, master: IntArray, shifts: Array) -> None:
        """The points that have passed a plane, at most one triangle for each."""
        contact, wall = self.contact, self.contact.wall
        q = len(wall.N)
        points = np.einsum("qa,pai->pqi", wall.N, self._x[wall.facets[slave]])
        corners = self._x[contact.triangles[master]] + (shifts @ self._F0.T)[:, None, None]
        gaps, _, weights = project(points[:, :, None], corners[:, None])
        beside = np.maximum(-weights.min(axis=-1), 0.0)
        touching = (gaps < 0) & (gaps > -2 * contact.deepest) & (beside < BESIDE)
        pair, point, triangle = np.nonzero(touching)
        number = slave[pair] * q + point
        # Of several triangles under one point the one that it has passed least.
        order = np.lexsort((-gaps[pair, point, triangle], number))
        chosen = order[np.unique(number[order], return_index=True)[1]]
        pair, point, triangle = pair[chosen], point[chosen], triangle[chosen]
        self._points = points[pair, point]
        self._corners = corners[pair, triangle]
        self._weights = wall.weights[slave[pair], point]
        self._N = wall.N[point]
        own = wall.facets[slave[pair]]
        other = contact.triangles[master[pair], triangle]
        #: Nodes of the slave's facet and of the master's triangle, (m, a + 3).
        self._nodes = np.concatenate([own, other], axis=1)
        X = contact.mesh.points
        self._places = np.concatenate([X[own], X[other] + shifts[pair][:, None]], axis=1)

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


def _shape(corners: Array) -> tuple[Array, Array, Array]:
    """Centres, unit normals (F, 3) and radii (F,) of triangles (F, 3, 3)."""
    centres = corners.mean(axis=1)
    m = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    radii = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    return centres, m / np.linalg.norm(m, axis=1)[:, None], radii
