"""Contact of the wall with its own mirror images: against the planes of the eighth of the cell.

The energy is ε/2 ∫ ⟨−g⟩² dA over the undeformed wall with the gap g to each of the six planes; the planes x_a = 0
stay, those at X_a = ½ move to (1 + H_aa)/2. Under loads that keep the planes mirrors g is linear in u and H.

A perturbation that is odd under the mirror of a plane carries the wall and its image along the normal together, so
that g does not change to first order; but the two slide over each other by 2 δ_t while their common surface tilts.
To second order the gap between them changes by −2 δ_t·∇δ_n, against the pressure t = ε⟨−g⟩: a share of the tangent
that is geometric, t δ_t·∇δ_n for each of the two.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from porocore.cell.mesh import CellMesh
from porocore.cell.parity import odd_axes
from porocore.contact.forces import Blocks, Forces
from porocore.contact.wall import Wall, wall_of
from porocore.states import Array, IntArray

if TYPE_CHECKING:
    from porocore.contact.model import Touching


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

    def __init__(self, mesh: CellMesh, stiffness: float, deepest: float) -> None:
        self.mesh, self.stiffness, self.deepest = mesh, stiffness, deepest
        self.wall: Wall = wall_of(mesh)

    def at(self, H: Array, u: Array, like: Touching | None = None) -> MirrorState:
        """At u (nodes, 3) under a diagonal H; planes and points are always the same pairs."""
        return MirrorState(self, H, u)


class MirrorState:
    """Gaps at one iterate, and what follows from them."""

    def __init__(self, contact: MirrorContact, H: Array, u: Array) -> None:
        self.contact = contact
        mesh, wall = contact.mesh, contact.wall
        F0 = np.eye(3) + H
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

    def blocks(self, odd: str) -> Blocks:
        """Second derivatives for the perturbations of a class."""
        points = self.contact.mesh.points
        nodes, places, matrices = [], [], []
        for axis, sign, facets, g in self._sides:
            even = "xyz"[axis] not in odd_axes(odd, 0 if sign > 0 else 1)
            matrices.append(self._even(axis, facets, g) if even else self._odd(axis, sign, facets, g))
            nodes.append(self._nodes(facets))
            places.append(self._places(facets, axis, sign, points))
        return Blocks(np.concatenate(nodes), np.concatenate(places), np.concatenate(matrices))

    def _even(self, axis: int, facets: IntArray, g: Array) -> Array:
        wall = self.contact.wall
        w = self.contact.stiffness * wall.weights[facets] * (g < 0)
        N = np.column_stack([wall.N, -np.ones(len(wall.N))])
        normal = np.einsum("fq,qa,qb->fab", w, N, N)
        k = N.shape[1]
        out = np.zeros((len(facets), k, 3, k, 3))
        out[:, :, axis, :, axis] = normal
        return out.reshape(len(facets), 3 * k, 3 * k)

    def _odd(self, axis: int, sign: float, facets: IntArray, g: Array) -> Array:
        """Second derivatives of Σ t w δ_t·∇δ_n, with n along the axis and the gradient along the deformed facet."""
        wall = self.contact.wall
        t = -self.contact.stiffness * wall.weights[facets] * g
        tangents = np.einsum("qas,fai->fqsi", wall.dN, self._x[wall.facets[facets]])
        tangents[..., axis] = 0.0  # along the plane
        metric = np.einsum("fqsi,fqti->fqst", tangents, tangents)
        dual = np.einsum("fqst,fqti->fqsi", np.linalg.pinv(metric), tangents)
        gradient = np.einsum("fqsi,qas->fqai", dual, wall.dN)  # of N, tangential
        a = wall.N.shape[1]
        out = np.zeros((len(facets), a + 1, 3, a + 1, 3))
        # The wall lies on the positive side of its plane or on the negative one.
        half = sign * np.einsum("fq,qa,fqbi->faib", t, wall.N, gradient)  # δ_i of node a, δ_n of node b
        out[:, :a, :, :a, axis] += half
        out[:, :a, axis, :a, :] += half.transpose(0, 3, 1, 2)
        return out.reshape(len(facets), 3 * (a + 1), 3 * (a + 1))

    def _nodes(self, facets: IntArray) -> IntArray:
        nodes = self.contact.wall.facets[facets]
        return np.column_stack([nodes, np.full(len(nodes), -1)])

    def _places(self, facets: IntArray, axis: int, sign: float, points: Array) -> Array:
        plane = np.zeros((len(facets), 1, 3))
        plane[:, 0, axis] = 0.0 if sign > 0 else 0.5
        return np.concatenate([points[self.contact.wall.facets[facets]], plane], axis=1)
