"""Contact of the wall with its own mirror images: against the planes of the eighth of the cell.

The energy is ε/2 ∫ ⟨−g⟩² dA over the undeformed wall with the gap g to each of the six planes; the planes x_a = 0
stay, those at X_a = ½ move to (1 + H_aa)/2. Under loads that keep the planes mirrors g is linear in u and H.

A perturbation that is odd under the mirror of a plane does not move the wall and its image alike: they slide over each
other while their common surface tilts. There the wall is held against its reflection, triangle by triangle, as the
whole cell's wall is (:mod:`porocore.cell.contact.wall_contact`), of which nothing but the second derivatives is needed.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from porocore.cell.contact.contact_state import ContactState
from porocore.cell.contact.forces import Blocks, Forces, joined
from porocore.cell.contact.pairs import REACH, Image, find_pairs
from porocore.cell.contact.penetration import PenetratingPoints, motion_of
from porocore.cell.contact.pore_surface import PoreSurface, pore_surface
from porocore.cell.contact.triangles import height
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.symmetry.parity import odd_axes
from porocore.states import Array, IntArray


class MirrorContact:
    """Of the eighth of the cell under diagonal H.

    Parameters
    ----------
    mesh
        Of the solid.
    stiffness
        ε, energy per area and squared gap.
    deepest
        Penetration that is not accepted.
    """

    pairs_move = False

    def __init__(self, mesh: CellMesh, stiffness: float, deepest: float) -> None:
        self.mesh, self.stiffness, self.deepest = mesh, stiffness, deepest
        self.wall: PoreSurface = pore_surface(mesh)

    def at(self, H: Array, u: Array, like: ContactState | None = None) -> MirrorState:
        """At u (nodes, 3) under a diagonal H; planes and points are always the same pairs."""
        return MirrorState(self, H, u)


class MirrorState:
    """Gaps at one iterate, and what follows from them."""

    def __init__(self, contact: MirrorContact, H: Array, u: Array) -> None:
        self.contact = contact
        mesh, wall = contact.mesh, contact.wall
        F0 = self._F0 = np.eye(3) + H
        self._x = mesh.points @ F0.T + u
        # Which facets touch a plane at all is asked of their nodes first: most iterates have no contact.
        corners = self._x[wall.facets]
        edge = np.diag(F0) / 2
        sides = []
        for axis in range(3):
            for sign, plane in ((1.0, 0.0), (-1.0, edge[axis])):
                gap = sign * (corners[:, :, axis] - plane)
                near = np.flatnonzero(gap.min(axis=1) < 0.1 * np.ptp(gap, axis=1))
                g = gap[near] @ wall.N.T
                touching = (g < 0).any(axis=1)
                sides.append((axis, sign, near[touching], np.minimum(g[touching], 0.0)))
        self._sides: list[tuple[int, float, IntArray, Array]] = sides
        self._reflected: dict[tuple[int, float], Blocks] = {}

    @property
    def active(self) -> bool:
        """Whether anything touches."""
        return any(len(facets) for _, _, facets, _ in self._sides)

    @property
    def depth(self) -> float:
        """Of the deepest penetration of a plane."""
        return max((float(-g.min()) for *_, g in self._sides if g.size), default=0.0)

    @cached_property
    def forces(self) -> Forces:
        """Energy and first derivatives."""
        eps, wall, points = self.contact.stiffness, self.contact.wall, self.contact.mesh.points
        a = wall.facets.shape[1]
        energy, touching = 0.0, np.zeros(wall.weights.shape, dtype=bool)
        nodes, places, gradient = [], [], []
        for axis, sign, facets, g in self._sides:
            w = wall.weights[facets]
            energy += eps / 2 * float((w * g * g).sum())
            touching[facets] |= g < 0
            pull = eps * (w * g) @ wall.N * sign
            one = np.zeros((len(facets), a + 1, 3))
            one[:, :a, axis] = pull
            one[:, a, axis] = -pull.sum(axis=1)
            gradient.append(one)
            nodes.append(self._nodes(facets))
            places.append(self._places(facets, axis, sign, points))
        share = float(wall.weights[touching].sum()) / wall.area
        return Forces(energy, np.concatenate(nodes), np.concatenate(places), np.concatenate(gradient), share)

    def blocks(self, parity: str) -> Blocks:
        """Second derivatives for the perturbations of a class."""
        points = self.contact.mesh.points
        parts = []
        for axis, sign, facets, g in self._sides:
            if "xyz"[axis] in odd_axes(parity, 0 if sign > 0 else 1):
                if len(facets):
                    if (axis, sign) not in self._reflected:
                        self._reflected[axis, sign] = self._odd(axis, sign)
                    parts.append(self._reflected[axis, sign])
            else:
                places = self._places(facets, axis, sign, points)
                parts.append(Blocks(self._nodes(facets), places, self._even(axis, facets, g)))
        return joined(parts)

    def _even(self, axis: int, facets: IntArray, g: Array) -> Array:
        wall = self.contact.wall
        w = self.contact.stiffness * wall.weights[facets] * (g < 0)
        N = np.column_stack([wall.N, -np.ones(len(wall.N))])
        normal = np.einsum("fq,qa,qb->fab", w, N, N)
        k = N.shape[1]
        out = np.zeros((len(facets), k, 3, k, 3))
        out[:, :, axis, :, axis] = normal
        return out.reshape(len(facets), 3 * k, 3 * k)

    def _odd(self, axis: int, sign: float) -> Blocks:
        """Of the distance from the reflected wall, whose nodes move by −R where those of the wall move by 1.

        R is the reflection. Under the odd loads the image in the plane X_a = ½ moves by δH e_a besides, which a node
        with the place e_a and no displacement stands for.
        """
        contact, x, X = self.contact, self._x, self.contact.mesh.points
        R = np.eye(3)
        R[axis, axis] = -1.0
        unit = np.eye(3)[axis]
        period = 0.0 * unit if sign > 0 else unit
        image = Image(x @ R + self._F0 @ period, X @ R + period, reflected=True)
        pairs = find_pairs(contact.wall, x, X, image, 2 * REACH * contact.deepest)
        points = np.einsum("ma,mai->mi", pairs.N, x[pairs.own])
        corners = image.x[pairs.other]
        rows = np.flatnonzero(height(points, corners) < 0)
        own, other = pairs.own[rows], pairs.other[rows]
        m, a = own.shape
        motion = np.zeros((m, 12, 3 * (a + 4)))
        motion[:, :, : 3 * (a + 3)] = motion_of(pairs.N[rows], -R)
        motion[:, 3:, 3 * (a + 3) :] = np.tile(np.eye(3), (3, 1))
        nodes = np.concatenate([own, other, np.full((m, 1), -1)], axis=1)
        places = np.concatenate([X[own], X[other], np.broadcast_to(period, (m, 1, 3))], axis=1)
        weights = contact.stiffness / 4 * pairs.weights[rows]
        return PenetratingPoints(
            points[rows], corners[rows], pairs.where[rows], weights, motion, nodes, places
        ).blocks

    def _nodes(self, facets: IntArray) -> IntArray:
        nodes = self.contact.wall.facets[facets]
        return np.column_stack([nodes, np.full(len(nodes), -1)])

    def _places(self, facets: IntArray, axis: int, sign: float, points: Array) -> Array:
        plane = np.zeros((len(facets), 1, 3))
        plane[:, 0, axis] = 0.0 if sign > 0 else 0.5
        return np.concatenate([points[self.contact.wall.facets[facets]], plane], axis=1)
