"""Contact of the eighth of the cell with its mirror planes (MirrorContact), under diagonal loads.

The energy is ε/2 ∫ ⟨−g⟩² dA over the undeformed wall with the gap g to each of the six planes. The planes x_a = 0
stay, those at X_a = s_a/2, with the cell's sides s, move to (1 + H_aa) s_a/2. Under loads that preserve the mirrors, g
is linear in u and H.

A perturbation that is odd under the mirror of a plane moves the wall and its image differently: they slide over each
other while their common surface tilts. For it the wall is paired with its reflection, triangle by triangle, as in the
whole cell (:mod:`porocore.cell.contact.wall_contact`); only the second derivatives of this contact are needed.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from porocore.cell.contact.forces import Blocks, Forces, joined
from porocore.cell.contact.pairs import REACH, ContactPairs, Wall, find_pairs
from porocore.cell.contact.penetration import PenetratingPoints, motion_of
from porocore.cell.contact.pore_surface import pore_surface
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.symmetry.parity import odd_axes
from porocore.states import Array, IntArray


class MirrorContact:
    """Contact of the eighth of the cell with its mirror planes under diagonal H.

    Parameters
    ----------
    mesh
        Mesh of the solid.
    stiffness
        ε, energy per area and squared gap.
    deepest
        Largest accepted penetration.
    """

    pairs_move = False

    def __init__(self, mesh: CellMesh, stiffness: float, deepest: float) -> None:
        self.mesh, self.stiffness, self.deepest = mesh, stiffness, deepest
        self.surface = pore_surface(mesh)

    def at(self, H: Array, u: Array, pairs: ContactPairs | None = None) -> MirrorState:
        """Return the contact state of u (nodes, 3) under a diagonal H; each point is paired with every plane."""
        return MirrorState(self, H, u)


class MirrorState:
    """Gaps to the mirror planes at one iterate, and the derivatives of the energy."""

    pairs: ContactPairs | None = None

    def __init__(self, contact: MirrorContact, H: Array, u: Array) -> None:
        self.contact = contact
        mesh, surface = contact.mesh, contact.surface
        F0 = self._F0 = np.eye(3) + H
        self._x = mesh.points @ F0.T + u
        # The nodes of a facet are tested before its quadrature points: most iterates have no contact.
        corners = self._x[surface.facets]
        edge = np.diag(F0) * mesh.high
        sides = []
        for axis in range(3):
            for sign, plane in ((1.0, 0.0), (-1.0, edge[axis])):
                gap = sign * (corners[:, :, axis] - plane)
                near = np.flatnonzero(gap.min(axis=1) < 0.1 * np.ptp(gap, axis=1))
                g = gap[near] @ surface.N.T
                touching = (g < 0).any(axis=1)
                if touching.any():
                    sides.append((axis, sign, near[touching], np.minimum(g[touching], 0.0)))
        self._sides: list[tuple[int, float, IntArray, Array]] = sides
        self._reflected: dict[tuple[int, float], Blocks] = {}
        self._blocks: dict[tuple[bool, ...], Blocks] = {}

    @property
    def active(self) -> bool:
        return bool(self._sides)

    @property
    def depth(self) -> float:
        """Largest penetration of a plane."""
        return max((float(-g.min()) for *_, g in self._sides), default=0.0)

    @cached_property
    def forces(self) -> Forces:
        return self.weighted(self.contact.surface.weights)

    def weighted(self, weights: Array) -> Forces:
        eps, surface = self.contact.stiffness, self.contact.surface
        a = surface.facets.shape[1]
        energy, touching = 0.0, np.zeros(surface.weights.shape, dtype=bool)
        nodes, places, gradient = [], [], []
        for axis, sign, facets, g in self._sides:
            w = weights[facets]
            energy += eps / 2 * float((w * g * g).sum())
            touching[facets] |= g < 0
            pull = eps * (w * g) @ surface.N * sign
            one = np.zeros((len(facets), a + 1, 3))
            one[:, :a, axis] = pull
            one[:, a, axis] = -pull.sum(axis=1)
            gradient.append(one)
            nodes.append(self._nodes(facets))
            places.append(self._places(facets, axis, sign))
        share = float(surface.weights[touching].sum()) / surface.area
        return Forces(energy, np.concatenate(nodes), np.concatenate(places), np.concatenate(gradient), share)

    def blocks(self, parity: str) -> Blocks:
        odd = tuple("xyz"[axis] in odd_axes(parity, 0 if sign > 0 else 1) for axis, sign, *_ in self._sides)
        if odd not in self._blocks:
            self._blocks[odd] = joined(
                [
                    self._odd(axis, sign)
                    if moved_apart
                    else Blocks(
                        self._nodes(facets), self._places(facets, axis, sign), self._even(axis, facets, g)
                    )
                    for moved_apart, (axis, sign, facets, g) in zip(odd, self._sides, strict=True)
                ]
            )
        return self._blocks[odd]

    def _even(self, axis: int, facets: IntArray, g: Array) -> Array:
        surface = self.contact.surface
        w = self.contact.stiffness * surface.weights[facets] * (g < 0)
        N = np.column_stack([surface.N, -np.ones(len(surface.N))])
        k = N.shape[1]
        out = np.zeros((len(facets), k, 3, k, 3))
        out[:, :, axis, :, axis] = np.einsum("fq,qa,qb->fab", w, N, N)
        return out.reshape(len(facets), 3 * k, 3 * k)

    def _odd(self, axis: int, sign: float) -> Blocks:
        if (axis, sign) not in self._reflected:
            self._reflected[axis, sign] = self._slid(axis, sign)
        return self._reflected[axis, sign]

    def _slid(self, axis: int, sign: float) -> Blocks:
        """Return the second derivatives for the distance from the reflected wall.

        Its nodes move by −R u, with the reflection R, where those of the wall move by u. Under the odd loads the image
        in the far plane also moves by δH s_a e_a; a node at the place s_a e_a without a displacement represents this.
        """
        contact, x, X = self.contact, self._x, self.contact.mesh.points
        R = np.eye(3)
        R[axis, axis] = -1.0
        period = np.eye(3)[axis] * (0.0 if sign > 0 else contact.mesh.sides[axis])
        image = Wall(contact.surface, x @ R + self._F0 @ period, X @ R + period, reflected=True)
        pairs = find_pairs(Wall(contact.surface, x, X), image, 2 * REACH * contact.deepest)
        inside, points, corners = pairs.penetrating(x, image.x)
        own, other = inside.own, inside.other
        m, a = own.shape
        motion = np.zeros((m, 12, 3 * (a + 4)))
        motion[:, :, : 3 * (a + 3)] = motion_of(inside.N, -R)
        motion[:, 3:, 3 * (a + 3) :] = np.tile(np.eye(3), (3, 1))
        nodes = np.concatenate([own, other, np.full((m, 1), -1)], axis=1)
        places = np.concatenate([X[own], X[other], np.broadcast_to(period, (m, 1, 3))], axis=1)
        weights = contact.stiffness / 4 * inside.weights
        return PenetratingPoints(
            points, corners, inside.where, weights, motion, nodes, places, inside.number
        ).blocks

    def _nodes(self, facets: IntArray) -> IntArray:
        nodes = self.contact.surface.facets[facets]
        return np.column_stack([nodes, np.full(len(nodes), -1)])

    def _places(self, facets: IntArray, axis: int, sign: float) -> Array:
        plane = np.zeros((len(facets), 1, 3))
        plane[:, 0, axis] = 0.0 if sign > 0 else self.contact.mesh.high[axis]
        return np.concatenate([self.contact.mesh.points[self.contact.surface.facets[facets]], plane], axis=1)
