"""Contact of the wall with itself and its periodic images (WallContact): whole cell, any load.

Every quadrature point of the wall is paired with the nearest triangle of the facing facets (a quadratic facet counts as
four); g is its distance from it, and the energy is ε/8 ∫ ⟨−g⟩² dA over the undeformed wall. Both walls of a contact
count and g is twice the distance from a mirror plane, so a symmetric state has the same energy as in
:mod:`porocore.cell.contact.mirrors`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from itertools import product

import numpy as np

from porocore.cell.contact.forces import Blocks, Forces, joined
from porocore.cell.contact.pairs import REACH, ContactPairs, Pairs, Wall, find_pairs, nearest_only
from porocore.cell.contact.penetration import PenetratingPoints, motion_of
from porocore.cell.contact.pore_surface import pore_surface
from porocore.cell.meshing.mesh import CellMesh
from porocore.states import Array


class WallContact:
    """Self-contact of the whole cell, by the parameters of :class:`~porocore.cell.contact.mirrors.MirrorContact`.

    A wall may penetrate another one twice as deep as a mirror plane.
    """

    pairs_move = True

    def __init__(self, mesh: CellMesh, stiffness: float, deepest: float) -> None:
        self.mesh, self.stiffness, self.deepest = mesh, stiffness / 4, 2 * deepest
        self.surface = pore_surface(mesh)

    def at(self, H: Array, u: Array, pairs: ContactPairs | None = None) -> WallState:
        F0 = np.eye(3) + H
        x = self.mesh.points @ F0.T + u
        return WallState(self, F0, x, self._search(F0, x) if pairs is None else pairs)

    def _search(self, F0: Array, x: Array) -> ContactPairs:
        """Return the contact pairs by the periodic shifts (3,) of the facing wall."""
        wall, reach = Wall(self.surface, x, self.mesh.points), REACH * self.deepest
        shifts: list[Array] = []
        found: list[Pairs] = []
        for shift in product((-1.0, 0.0, 1.0), repeat=3):
            s: Array = np.multiply(shift, self.mesh.spans)
            pairs = find_pairs(wall, wall.shifted(F0 @ s, s), reach)
            if len(pairs.weights):
                shifts.append(s)
                found.append(pairs)
        return list(zip(shifts, nearest_only(found), strict=True)) if found else []


class WallState:
    """Gaps between walls at one iterate, and the derivatives of the energy."""

    pairs: ContactPairs | None

    def __init__(self, contact: WallContact, F0: Array, x: Array, pairs: ContactPairs) -> None:
        self.contact, self.pairs = contact, pairs
        self._penetrating = [self._penetrations(F0, x, shift, some) for shift, some in pairs]

    def _penetrations(self, F0: Array, x: Array, shift: Array, pairs: Pairs) -> PenetratingPoints:
        inside, points, corners = pairs.penetrating(x, x + F0 @ shift)
        X, own, other = self.contact.mesh.points, inside.own, inside.other
        return PenetratingPoints(
            points,
            corners,
            inside.where,
            self.contact.stiffness * inside.weights,
            motion_of(inside.N, np.eye(3)),
            np.concatenate([own, other], axis=1),
            np.concatenate([X[own], X[other] + shift], axis=1),
            inside.number,
        )

    @property
    def active(self) -> bool:
        return any(len(part.weights) for part in self._penetrating)

    @property
    def depth(self) -> float:
        return max((float(-part.distance[0].min(initial=0.0)) for part in self._penetrating), default=0.0)

    @cached_property
    def forces(self) -> Forces:
        return self._forces(self._penetrating)

    def weighted(self, weights: Array) -> Forces:
        weights = self.contact.stiffness * weights.ravel()
        return self._forces([replace(part, weights=weights[part.number]) for part in self._penetrating])

    def _forces(self, parts: list[PenetratingPoints]) -> Forces:
        contact = self.contact
        return Forces(
            sum(part.energy for part in parts),
            np.concatenate([part.nodes for part in parts]),
            np.concatenate([part.places for part in parts]),
            np.concatenate([part.gradient for part in parts]),
            sum(float(part.weights.sum()) for part in parts) / contact.stiffness / contact.surface.area,
        )

    def blocks(self, parity: str) -> Blocks:
        return self._blocks

    @cached_property
    def _blocks(self) -> Blocks:
        return joined([part.blocks for part in self._penetrating])
