"""Contact of the wall with itself and its images (WallContact), its model, and slopes of its energy.

Every quadrature point of the wall is paired with the nearest triangle of the facing facets (a quadratic facet counts as
four); g is its distance from it, and the energy is ε/8 ∫ ⟨−g⟩² dA over the undeformed wall. Both walls of a contact
count and g is twice the distance from a mirror plane, so a symmetric state has the same energy as in
:mod:`porocore.cell.contact.pairs`.

The energy depends on the undeformed wall by the positions x = F₀ X + u, by the areas of its points, and by the penalty
ε/h, since the mean edge h of the wall's facets is proportional to the root of its area. The contact pairs are kept, as
they are for the derivatives by u and H: the slopes are exact as long as no point changes its triangle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Protocol

import numpy as np

from porocore.cell.contact.pairs import (
    DEGREE,
    REACH,
    Blocks,
    ContactPairs,
    Forces,
    MirrorContact,
    Pairs,
    PenetratingPoints,
    PoreSurface,
    Wall,
    find_pairs,
    joined,
    motion_of,
    nearest_only,
    pore_surface,
    scatter,
)
from porocore.cell.contact.settings import ContactSettings
from porocore.cell.materials.material import StrainEnergy
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.tetrahedra import triangle_rule
from porocore.states import Array, IntArray


class WallContact:
    """Self-contact of the whole cell, by the parameters of :class:`~porocore.cell.contact.pairs.MirrorContact`.

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


#: Largest accepted penetration, in mean edges of the wall's facets.
DEEPEST = 0.25


class ContactState(Protocol):
    """Contact at one iterate.

    Attributes
    ----------
    pairs
        Contact pairs; None where they do not depend on the iterate.
    """

    pairs: ContactPairs | None

    @property
    def active(self) -> bool:
        """True where any point of the wall is in contact."""

    @property
    def depth(self) -> float:
        """Largest penetration of the wall."""

    @property
    def forces(self) -> Forces:
        """Energy and first derivatives."""

    def weighted(self, weights: Array) -> Forces:
        """Return energy and first derivatives with other areas (F, q) of the points of the wall; they are linear."""

    def blocks(self, parity: str) -> Blocks:
        """Return the second derivatives for the perturbations of a parity class."""


class ContactModel(Protocol):
    """Contact of the pore wall of one mesh.

    Attributes
    ----------
    deepest
        Largest accepted penetration.
    pairs_move
        True where the contact pairs depend on the iterate.
    surface
        Wall of the undeformed solid with its quadrature points.
    """

    deepest: float
    pairs_move: bool
    surface: PoreSurface

    def at(self, H: Array, u: Array, pairs: ContactPairs | None = None) -> ContactState:
        """Return the contact state of u (nodes, 3) under H, with the given contact pairs or with new ones.

        The energy is continuously differentiable as long as the pairs are the same.
        """


def make_contact_model(
    mesh: CellMesh, settings: ContactSettings, material: StrainEnergy | None = None
) -> ContactModel | None:
    """Return the contact model of a mesh of the solid; None without pores or where the settings switch contact off.

    The penalty stiffness is in units of Young's modulus at small strains, averaged over directions and over the
    elements at the wall, or 1 without a material.
    """
    if settings.kind == "none" or not len(mesh.wall):
        return None
    h = facet_edge(mesh)
    young = material.mean_moduli(elements_at_wall(mesh))[0] if material is not None else 1.0
    model = MirrorContact if mesh.domain == "eighth" else WallContact
    return model(mesh, settings.stiffness * young / h, DEEPEST * h)


def elements_at_wall(mesh: CellMesh) -> IntArray:
    """Return the elements with a facet on the wall."""
    on_wall = np.zeros(len(mesh.points), dtype=bool)
    on_wall[mesh.wall] = True
    return np.flatnonzero(on_wall[mesh.cells[:, :4]].sum(axis=1) >= 3)


def facet_edge(mesh: CellMesh) -> float:
    """Return the mean edge h of the wall's facets, taken as equilateral triangles."""
    surface = pore_surface(mesh)
    return float(np.sqrt(4 / np.sqrt(3) * surface.area / len(surface.facets)))


@dataclass(frozen=True, eq=False)
class ContactSlopes:
    """Slopes of the contact energy E and of its derivatives by one parameter, at fixed u and H.

    Attributes
    ----------
    energy : float
        Slope of E.
    by_load : (3, 3)
        Slope of ∂E/∂H.
    by_displacement : (nodes, 3)
        Slope of ∂E/∂u.
    """

    energy: float
    by_load: Array
    by_displacement: Array


def contact_slopes(
    contact: ContactModel,
    touching: ContactState,
    F0: Array,
    points: Array,
    velocity: Array,
    log_penalty: float,
) -> ContactSlopes:
    """Return the slopes of the contact energy of one state.

    Parameters
    ----------
    contact
        Contact of the pore wall.
    touching
        Its state.
    F0 : (3, 3)
        I + H.
    points : (nodes, 3)
        Undeformed nodes of the solid.
    velocity : (nodes, 3)
        Slope of their positions, which keeps periodicity and mirrors.
    log_penalty : float
        Slope of the logarithm of ε at fixed h.
    """
    surface, forces, blocks = contact.surface, touching.forces, touching.blocks("")
    areas = area_slopes(surface, points, velocity)
    log_penalty = log_penalty - float(areas.sum()) / surface.area / 2
    reweighted = touching.weighted(areas + log_penalty * surface.weights)

    def moved(nodes: IntArray) -> Array:
        """Return V at nodes (m, k), 0 at the places without a node, which lie on mirror planes."""
        return np.where(nodes[:, :, None] >= 0, velocity[nodes], 0.0)

    shifted = moved(blocks.nodes) @ F0.T
    m, k = blocks.nodes.shape
    change = (blocks.matrices @ shifted.reshape(m, 3 * k, 1)).reshape(m, k, 3)
    by_load = np.einsum("mki,mkj->ij", change, blocks.places)
    by_load += np.einsum("mki,mkj->ij", forces.gradient, moved(forces.nodes))
    n = len(points)
    return ContactSlopes(
        energy=float((forces.gradient * (moved(forces.nodes) @ F0.T)).sum()) + reweighted.energy,
        by_load=by_load + reweighted.by_load,
        by_displacement=scatter(n, blocks.nodes, change) + reweighted.by_displacement(n),
    )


def area_slopes(surface: PoreSurface, points: Array, velocity: Array) -> Array:
    """Return the slopes (F, q) of the undeformed areas of the wall's points, for nodes that move with ``velocity``."""
    _, weights = triangle_rule(DEGREE)
    first, second = np.moveaxis(np.einsum("qas,fai->fqsi", surface.dN, points[surface.facets]), 2, 0)
    first_slope, second_slope = np.moveaxis(
        np.einsum("qas,fai->fqsi", surface.dN, velocity[surface.facets]), 2, 0
    )
    normal = np.cross(first, second)
    slope = np.cross(first_slope, second) + np.cross(first, second_slope)
    return np.asarray((normal * slope).sum(axis=2) / np.linalg.norm(normal, axis=2) * weights)
