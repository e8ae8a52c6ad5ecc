"""Contact of the wall with itself and its periodic images, for the whole cell under any load.

Every quadrature point of the wall is held against the triangles of opposite facets (a quadratic facet counts as four);
g is its distance from the nearest one, and the energy is ε/8 ∫ ⟨−g⟩² dA over the undeformed wall: both
walls of a contact count and g is twice the distance from a mirror plane, so that a symmetric state has the energy that
:mod:`porocore.cell.contact.mirrors` gives it.
"""

from __future__ import annotations

from functools import cached_property
from itertools import product

import numpy as np

from porocore.cell.contact.contact_state import ContactState
from porocore.cell.contact.forces import Blocks, Forces, joined
from porocore.cell.contact.pairs import REACH, Image, Pairs, find_pairs, nearest_only
from porocore.cell.contact.penetration import PenetratingPoints, motion_of
from porocore.cell.contact.pore_surface import pore_surface
from porocore.cell.contact.triangles import height
from porocore.cell.meshing.mesh import CellMesh
from porocore.states import Array


class WallContact:
    """Of the whole cell.

    Parameters
    ----------
    mesh
        Of the solid.
    stiffness
        ε, as of :class:`~porocore.cell.contact.mirrors.MirrorContact`.
    deepest
        Penetration of a mirror plane that is not accepted; of a wall it is twice as much.
    """

    pairs_move = True

    def __init__(self, mesh: CellMesh, stiffness: float, deepest: float) -> None:
        self.mesh, self.stiffness, self.deepest = mesh, stiffness / 4, 2 * deepest
        self.wall = pore_surface(mesh)

    def at(self, H: Array, u: Array, like: ContactState | None = None) -> WallState:
        """At u (nodes, 3) under H, with the pairs of ``like`` or new ones."""
        F0 = np.eye(3) + H
        x = self.mesh.points @ F0.T + u
        pairs = like.pairs if isinstance(like, WallState) else self._pairs(F0, x)
        return WallState(self, F0, x, pairs)

    def _pairs(self, F0: Array, x: Array) -> list[tuple[Array, Pairs]]:
        """By periodic shifts (3,) of the opposite wall."""
        X, reach = self.mesh.points, REACH * self.deepest
        shifts: list[Array] = []
        found: list[Pairs] = []
        for shift in product((-1.0, 0.0, 1.0), repeat=3):
            s: Array = np.multiply(shift, self.mesh.periods, dtype=np.float64)
            pairs = find_pairs(self.wall, x, X, Image(x + F0 @ s, X + s), reach)
            if len(pairs.weights):
                shifts.append(s)
                found.append(pairs)
        return list(zip(shifts, nearest_only(found), strict=True)) if found else []


class WallState:
    """Gaps at one iterate, and what follows from them."""

    def __init__(self, contact: WallContact, F0: Array, x: Array, pairs: list[tuple[Array, Pairs]]) -> None:
        self.contact, self.pairs = contact, pairs
        self._passed = [self._of(F0, x, shift, some) for shift, some in pairs]

    def _of(self, F0: Array, x: Array, shift: Array, pairs: Pairs) -> PenetratingPoints:
        points = np.einsum("ma,mai->mi", pairs.N, x[pairs.own])
        corners = x[pairs.other] + F0 @ shift
        rows = np.flatnonzero(height(points, corners) < 0)
        X, own, other = self.contact.mesh.points, pairs.own[rows], pairs.other[rows]
        return PenetratingPoints(
            points[rows],
            corners[rows],
            pairs.where[rows],
            self.contact.stiffness * pairs.weights[rows],
            motion_of(pairs.N[rows], np.eye(3)),
            np.concatenate([own, other], axis=1),
            np.concatenate([X[own], X[other] + shift], axis=1),
        )

    @property
    def active(self) -> bool:
        """Whether anything touches."""
        return any(len(part.weights) for part in self._passed)

    @property
    def depth(self) -> float:
        """Of the deepest penetration."""
        return max((float(-part.distance[0].min(initial=0.0)) for part in self._passed), default=0.0)

    @cached_property
    def forces(self) -> Forces:
        """Energy and first derivatives."""
        parts, contact = self._passed, self.contact
        return Forces(
            sum(part.energy for part in parts),
            np.concatenate([part.nodes for part in parts]),
            np.concatenate([part.places for part in parts]),
            np.concatenate([part.gradient for part in parts]),
            sum(float(part.weights.sum()) for part in parts) / contact.stiffness / contact.wall.area,
        )

    def blocks(self, parity: str) -> Blocks:
        """Second derivatives; the whole cell has one class of perturbations only."""
        return self._blocks

    @cached_property
    def _blocks(self) -> Blocks:
        return joined([part.blocks for part in self._passed])
