"""Contact of the pore wall with itself and with mirror planes (ContactModel): energy, derivatives, settings.

The position of a node is x = F₀ X̃ + u, where X̃ is its place in the undeformed cell, periodic shift included. So one
gradient and one Hessian by positions give the derivatives by the unknowns u and by the load H.

On the eighth the energy is ε/2 ∫ ⟨−g⟩² dA over the undeformed wall with the gap g to each of the six planes. The planes
x_a = 0 stay, those at X_a = s_a/2, with the cell's sides s, move to (1 + H_aa) s_a/2. Under loads that preserve the
mirrors, g is linear in u and H. A perturbation that is odd under the mirror of a plane moves the wall and its image
differently: they slide over each other while their common surface tilts. For it the wall is paired with its reflection,
triangle by triangle, as in the whole cell; only the second derivatives of this contact are needed.

On the whole cell every quadrature point of the wall is paired with the nearest triangle of the facing facets (a
quadratic facet counts as four); g is its distance from it, and the energy is ε/8 ∫ ⟨−g⟩² dA. Both walls of a contact
count and g is twice the distance from a mirror plane, so a symmetric state has the same energy as on the eighth.

The energy depends on the undeformed wall by the positions x, by the areas of its points, and by the penalty ε/h, since
the mean edge h of the wall's facets is proportional to the root of its area. The contact pairs are kept, as they are
for the derivatives by u and H: the slopes are exact as long as no point changes its triangle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import Field

from porocore.cell.contact.pairs import (
    DEGREE,
    REACH,
    ContactPairs,
    Pairs,
    PoreSurface,
    Wall,
    distance_derivatives,
    find_pairs,
    nearest_only,
    pore_surface,
)
from porocore.cell.materials.material import StrainEnergy
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.tetrahedra import triangle_rule
from porocore.cell.symmetry import odd_axes
from porocore.core.models.strict import StrictModel
from porocore.core.units import Unit
from porocore.states import Array, IntArray


class ContactSettings(StrictModel):
    """Frictionless self-contact of the pore wall by a penalty."""

    kind: Literal["frictionless", "none"] = "frictionless"
    """``frictionless``: the pore wall is held against itself; ``none``: a state whose wall has passed through itself
    has the status ``overlap``, and no values."""
    stiffness: Annotated[float, Field(gt=0, allow_inf_nan=False), Unit("E/h")] = 15.0
    """ε of the contact's energy ε/2 ⟨−gap⟩² per area, with the mean edge h of the wall's facets; E is Young's modulus
    at the wall for small strains."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Second derivatives by nodal positions, in m blocks of k nodes each.

    Attributes
    ----------
    nodes : (m, k)
        Nodes of the mesh; −1 for one without a displacement of its own.
    places : (m, k, 3)
        Undeformed places X̃.
    matrices : (m, 3k, 3k)
        ∂²E/∂x∂x, symmetric.
    """

    nodes: IntArray
    places: Array
    matrices: Array

    def load_change(self, n: int, dH: Array) -> Array:
        """Return ∂²E/∂u∂H : δH, (n nodes, 3)."""
        force = np.einsum("mab,mb->ma", self.matrices, self._moved(dH))
        return scatter(n, self.nodes, force.reshape(*self.nodes.shape, 3))

    def second(self, one: Array, other: Array) -> float:
        """Return δH : ∂²E/∂H∂H : δH' at fixed u."""
        return float(np.einsum("ma,mab,mb->", self._moved(one), self.matrices, self._moved(other)))

    def _moved(self, dH: Array) -> Array:
        return (self.places @ dH.T).reshape(len(self.nodes), 3 * self.nodes.shape[1])

    @cached_property
    def entries(self) -> tuple[IntArray, IntArray, Array]:
        """Rows, columns (unknown 3·node + i) and values of ∂²E/∂u∂u; entries at equal places add up."""
        m, k = self.nodes.shape
        dofs = (3 * self.nodes[:, :, None] + np.arange(3)).reshape(m, 3 * k)
        rows = np.repeat(dofs, 3 * k, axis=1).ravel()
        columns = np.tile(dofs, (1, 3 * k)).ravel()
        kept = (rows >= 0) & (columns >= 0)
        return rows[kept], columns[kept], self.matrices.ravel()[kept]


@dataclass(frozen=True, eq=False)
class Forces:
    """Energy and first derivatives of contact at one iterate.

    Attributes
    ----------
    energy : float
        Energy E.
    nodes : (m, k), places : (m, k, 3)
        See :class:`Blocks`.
    gradient : (m, k, 3)
        ∂E/∂x.
    share : float
        Share of the undeformed wall that is in contact.
    """

    energy: float
    nodes: IntArray
    places: Array
    gradient: Array
    share: float

    def by_displacement(self, n: int) -> Array:
        """Return ∂E/∂u, (n nodes, 3)."""
        return scatter(n, self.nodes, self.gradient)

    @property
    def by_load(self) -> Array:
        """∂E/∂H (3, 3) at fixed u, Σ f_i X̃_j."""
        return np.asarray(np.einsum("mki,mkj->ij", self.gradient, self.places))


def joined(parts: list[Blocks]) -> Blocks:
    """Return all blocks as one batch; smaller blocks are padded with zeros."""
    if len(parts) == 1:
        return parts[0]
    k = max(part.nodes.shape[1] for part in parts)
    nodes, places, matrices = [], [], []
    for part in parts:
        more = k - part.nodes.shape[1]
        nodes.append(np.pad(part.nodes, ((0, 0), (0, more)), constant_values=-1))
        places.append(np.pad(part.places, ((0, 0), (0, more), (0, 0))))
        matrices.append(np.pad(part.matrices, ((0, 0), (0, 3 * more), (0, 3 * more))))
    return Blocks(np.concatenate(nodes), np.concatenate(places), np.concatenate(matrices))


def scatter(n: int, nodes: IntArray, values: Array) -> Array:
    """Return values (m, k, 3) summed at their nodes (m, k), (n, 3); node −1 is left out."""
    own = nodes >= 0
    out = np.zeros((n, 3))
    np.add.at(out, nodes[own], values[own])
    return out


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
        See :class:`Blocks`.
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


class MirrorState:
    """Gaps to the mirror planes at one iterate, and the derivatives of the energy."""

    pairs: ContactPairs | None = None

    def __init__(self, contact: ContactModel, H: Array, u: Array) -> None:
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


class WallState:
    """Gaps between walls at one iterate, and the derivatives of the energy."""

    pairs: ContactPairs | None

    def __init__(self, contact: ContactModel, F0: Array, x: Array, pairs: ContactPairs) -> None:
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


class ContactModel:
    """Contact of the pore wall of one mesh: of the eighth with its mirror planes, or of the whole cell with itself.

    A wall may penetrate another one twice as deep as a mirror plane.

    Parameters
    ----------
    mesh
        Mesh of the solid.
    stiffness
        ε, energy per area and squared gap to a mirror plane.
    deepest
        Largest accepted penetration of a mirror plane.

    Attributes
    ----------
    deepest
        Largest accepted penetration.
    pairs_move
        True where the contact pairs depend on the iterate.
    surface
        Wall of the undeformed solid with its quadrature points.
    """

    def __init__(self, mesh: CellMesh, stiffness: float, deepest: float) -> None:
        self.mesh, self.surface = mesh, pore_surface(mesh)
        self.pairs_move = mesh.domain == "whole"
        both = (stiffness / 4, 2 * deepest) if self.pairs_move else (stiffness, deepest)
        self.stiffness, self.deepest = both

    def at(self, H: Array, u: Array, pairs: ContactPairs | None = None) -> ContactState:
        """Return the contact state of u (nodes, 3) under H, with the given contact pairs or with new ones.

        The energy is continuously differentiable as long as the pairs are the same. On the eighth H is diagonal, and
        each point is paired with every mirror plane.
        """
        if not self.pairs_move:
            return MirrorState(self, H, u)
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


#: Largest accepted penetration, in mean edges of the wall's facets.
DEEPEST = 0.25


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
    return ContactModel(mesh, settings.stiffness * young / h, DEEPEST * h)


def elements_at_wall(mesh: CellMesh) -> IntArray:
    """Return the elements with a facet on the wall."""
    on_wall = np.zeros(len(mesh.points), dtype=bool)
    on_wall[mesh.wall] = True
    return np.flatnonzero(on_wall[mesh.cells[:, :4]].sum(axis=1) >= 3)


def facet_edge(mesh: CellMesh) -> float:
    """Return the mean edge h of the wall's facets, taken as equilateral triangles."""
    surface = pore_surface(mesh)
    return float(np.sqrt(4 / np.sqrt(3) * surface.area / len(surface.facets)))


def contact_slopes(
    contact: ContactModel,
    touching: ContactState,
    F0: Array,
    points: Array,
    velocity: Array,
    log_penalty: float,
) -> tuple[float, Array, Array]:
    """Return the slopes of the contact energy E of one state by one parameter, at fixed u and H.

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

    Returns
    -------
    energy : float
        Slope of E.
    by_load : (3, 3)
        Slope of ∂E/∂H.
    by_displacement : (nodes, 3)
        Slope of ∂E/∂u.
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
    return (
        float((forces.gradient * (moved(forces.nodes) @ F0.T)).sum()) + reweighted.energy,
        by_load + reweighted.by_load,
        scatter(n, blocks.nodes, change) + reweighted.by_displacement(n),
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
