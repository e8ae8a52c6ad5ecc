"""Contact of rigid indenters with the surface of a body: forces, tangent, drainage, measurements.

The surface is pushed away by the traction κ⟨−g⟩ per reference area along the gradient of the signed distance g, at the
quadrature points of its facets. This is the derivative of an energy, so forces and tangent are symmetric. A multiplier
at every quadrature point would ask for more than the nodes of a quadratic facet can do; the penetration that a penalty
leaves is a result of the run.

An indenter under a force f is where its contact forces have the resultant f along its direction, for any displacement
of the body: its displacement s is a function of the unknowns, and the tangent is that at fixed s plus one of rank one.
Within Newton's method s is an unknown beside the others, which converges where that function is steep.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from porocore.macro.body.mesh import BodyMesh, Facets
from porocore.macro.boundary.rigid import RigidIndenter, SignedDistance
from porocore.states import Array, BoolArray, IntArray

#: Places of force, displacement, area, pressure and outflow among the columns of a contact.
FORCE, MOVED, AREA, PRESSURE, FLOW = 0, 1, 2, 4, 6
#: Gap at which all of a surface drains that is drained outside the contact, as a share of the facet's width.
OPEN = 0.001
#: A drained point lets fluid pass so many times better than a layer of the body one element thick.
DRAINED = 1000.0
#: Levels of (gap over the largest gap near the contact)^(2/3) with the factors of a parabola's value at zero, and the
#: rows of facets around the contact that are near it. In a plane the edge of the contact is drawn to a node, so that
#: the gap next to it is of no use; around a contact on faces this cancels out.
LEVELS_OF_EDGES = ((0.5, 7.0), (0.7, -25 / 3), (1.0, 7 / 3))
LEVELS_OF_FACES = ((0.15, 20 / 7), (0.3, -2.5), (0.5, 9 / 14))
ROWS_OF_EDGES, ROWS_OF_FACES = 2, 1
#: Share of that gap within which the power 2/3 is rounded.
ROUNDED = 0.001
#: Parts along each edge of a facet on which the edge of the contact is a straight line.
PARTS = 8
#: Share of a force up to which an error that does not fall any more is round-off.
CLOSE = 1e-11
#: Steps at most of the search for the place of an indenter under a force.
SEARCH = 200


class NoContact(Exception):
    """Failure of a force that no contact can bear."""


@dataclass(frozen=True, eq=False)
class ContactScales:
    """Stiffness and conductivity of the body at rest, powers of two.

    They are rounded so that a small change of the cell does not change the penalty, which no derivative has to follow.
    """

    stiffness: float = 1.0
    conductivity: float = 1.0

    @classmethod
    def rounded(cls, stiffness: float, conductivity: float) -> ContactScales:
        """Return the scales from the largest entries of ∂P_E/∂H and of the conductivity."""
        return cls(
            *(2.0 ** np.round(np.log2(each)) if each > 0 else 1.0 for each in (stiffness, conductivity))
        )


@dataclass(frozen=True, eq=False)
class Contact:
    """An indenter and the facets that it may touch.

    Attributes
    ----------
    name
        Of the indenter.
    indenter
        Its settings.
    facets
        Of the body.
    function, factor
        Time function of its motion or force, and the factor on it.
    """

    name: str
    indenter: RigidIndenter
    facets: Facets
    function: int
    factor: float

    @property
    def by_force(self) -> bool:
        """True if a force is prescribed."""
        return self.indenter.force is not None

    @cached_property
    def along(self) -> Array:
        """Direction (3,) of the motion."""
        return self.indenter.along

    @cached_property
    def areas(self) -> Array:
        """(f, q) reference area of each quadrature point."""
        return self.facets.areas

    @cached_property
    def sizes(self) -> Array:
        """(f, 1) thickness of the element behind each facet, its volume over the area."""
        volumes = self.facets.mesh.weights[self.facets.elements].sum(axis=1)
        return np.asarray(volumes / self.areas.sum(axis=1))[:, None]

    @cached_property
    def widths(self) -> Array:
        """(f, 1) length of each facet, of a face the root of its area."""
        facets = self.facets
        if not facets.mesh.flat:
            return np.asarray(np.sqrt(self.areas.sum(axis=1, keepdims=True)))
        along = np.linalg.norm(facets.tangents_of(facets.mesh.points)[..., 0], axis=-1)
        return np.asarray(along @ facets.mesh.element.facet.weights)[:, None]

    @cached_property
    def dofs(self) -> IntArray:
        """(f, 3 m + c) unknowns of each facet: displacements node by node, then pressures."""
        mesh, nodes = self.facets.mesh, self.facets.nodes
        u = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(nodes), -1)
        corners = nodes[:, : mesh.element.facet.corner_values.shape[1]]
        return np.concatenate([u, mesh.n_u + np.searchsorted(mesh.p_nodes, corners)], axis=1)

    def distance(self, arms: Array, motion: float) -> SignedDistance:
        """Return the distance of places from the indenter that has moved by ``motion``.

        Parameters
        ----------
        arms : (n, 3)
            From the place of the indenter. The difference of two close places has less round-off than the places.
        """
        return self.indenter.shape.distance(arms - motion * self.along, -self.along)

    @cached_property
    def _reference(self) -> Array:
        """(f, m, 3) from the place of the indenter to the nodes of the facets."""
        return np.asarray(self.facets.mesh.points[self.facets.nodes] - np.array(self.indenter.place))

    def arms(self, whole: Array, values: Array | None = None) -> Array:
        """Return the ways (f, k, 3) from the place of the indenter to points of the facets.

        Parameters
        ----------
        whole : (unknowns,)
            Of the mesh.
        values : (k, m)
            Shape functions at the points; None: at the quadrature points.
        """
        mesh = self.facets.mesh
        u = whole[: mesh.n_u].reshape(-1, 3)[self.facets.nodes]
        return np.asarray((mesh.element.facet.values if values is None else values) @ (self._reference + u))

    @cached_property
    def touching(self) -> Array:
        """(k, m) shape functions at the nodes and at the quadrature points."""
        return np.concatenate([np.eye(self.facets.nodes.shape[1]), self.facets.mesh.element.facet.values])

    def state(self, whole: Array, prescribed: float, scales: ContactScales) -> IndenterContact:
        """Return the contact under the unknowns ``whole`` and a prescribed motion or force.

        Raises
        ------
        NoContact
            The indenter under a force does not find the body.
        """
        motion = self._resting(whole, prescribed, scales) if self.by_force else prescribed
        return IndenterContact(self, whole, motion, scales)

    def _resting(self, whole: Array, force: float, scales: ContactScales) -> float:
        """Return the displacement at which the contact forces have the resultant ``force`` along the direction.

        The force rises with the displacement, more and more steeply while more of the surface is touched.
        """
        if force < 0:
            raise NoContact(
                f"macro.contact.{self.name}.force: the indenter cannot pull, but its force is {force:.3g}"
            )
        # Forces act at the quadrature points; without a force the nodes count too, so that a tip stands on one.
        values = None if force > 0 else self.touching
        arms = self.arms(whole, values).reshape(-1, 3)
        reach = 1.0 + np.linalg.norm(arms, axis=1).max()
        motion = self.indenter.way_to(arms)
        if motion > reach:
            raise NoContact(
                f"macro.contact.{self.name}: the indenter goes past the body, which bears no force"
            )
        if force == 0:
            return float(motion)
        stiffness = float((self.areas * self.penalty(scales)).sum())
        low, high, last = motion, np.inf, np.inf
        motion += force / stiffness
        for _ in range(SEARCH):
            now = IndenterContact(self, whole, motion, scales)
            excess = now.force - force
            low, high = (max(low, motion), high) if excess < 0 else (low, min(high, motion))
            slope = now.stiffness
            step = -excess / slope if slope > 0 else np.inf
            after = motion + step
            wide = abs(step) > reach or (high < np.inf and high - low < 1e-3 * abs(step))
            if wide or not low <= after <= high:
                after = (
                    (low + high) / 2 if high < np.inf else motion + 2 * max(motion - low, force / stiffness)
                )
            # The way itself sets the scale: a body may reach far beyond the contact.
            if abs(after - motion) <= 2e-16 * abs(motion) or abs(excess) <= 4e-16 * force:
                return float(motion)
            if last / 2 <= abs(excess) <= CLOSE * force:
                return float(motion)  # round-off is left
            last = abs(excess)
            motion = after
            if motion > 10 * reach:
                break
        else:
            return float(motion)
        raise NoContact(
            f"macro.contact.{self.name}: no place of the indenter gives a contact with the force {force:.3g}"
        )

    def penalty(self, scales: ContactScales) -> Array:
        """Return the stiffness κ (f, 1) per area."""
        return self.indenter.penalty * scales.stiffness / self.sizes

    def drainage(self, scales: ContactScales) -> Array:
        """Return the flux (f, 1) per area and pressure where the surface is drained."""
        return DRAINED * scales.conductivity / self.sizes


@dataclass(frozen=True, eq=False)
class IndenterContact:
    """Contact of one indenter at given unknowns.

    Attributes
    ----------
    contact
        RigidIndenter and facets.
    whole : (unknowns,)
        Of the mesh, Cartesian.
    motion
        Displacement s of the indenter.
    scales
        Of the body.
    """

    contact: Contact
    whole: Array
    motion: float
    scales: ContactScales

    @cached_property
    def distance(self) -> SignedDistance:
        """Distance of all points (f · q)."""
        return self.contact.distance(self.contact.arms(self.whole).reshape(-1, 3), self.motion)

    @cached_property
    def gap(self) -> Array:
        """(f, q) distance of the points."""
        return self.distance.gap.reshape(self.contact.areas.shape)

    @cached_property
    def normal(self) -> Array:
        """(f, q, 3) outward normal of the indenter."""
        return self.distance.normal.reshape(*self.gap.shape, 3)

    @cached_property
    def touched(self) -> BoolArray:
        """(f, q) points that the indenter touches."""
        return self.gap < 0

    @cached_property
    def _penalty(self) -> Array:
        return self.contact.penalty(self.scales)

    @cached_property
    def pressure(self) -> Array:
        """(f, q) contact pressure κ⟨−g⟩ per reference area."""
        return np.where(self.touched, -self._penalty * self.gap, 0.0)

    @cached_property
    def _slope(self) -> Array:
        """(f, q, 3, 3) w κ (n nᵀ + g ∇²g) where the points are touched, the derivative of forces by places."""
        n, g = self.normal, self.gap[:, :, None, None]
        found = n[..., :, None] * n[..., None, :] + g * self.distance.hessian.reshape(*g.shape[:2], 3, 3)
        weight = np.where(self.touched, self.contact.areas * self._penalty, 0.0)
        return np.asarray(weight[:, :, None, None] * found)

    @cached_property
    def force(self) -> float:
        """Resultant of the contact forces along the direction, of this part of the body."""
        return float((self.contact.areas * self.pressure * (self.normal @ self.contact.along)).sum())

    @cached_property
    def stiffness(self) -> float:
        """Derivative of the resultant by the displacement of the indenter."""
        along = self.contact.along
        return float(along @ self._slope.sum(axis=(0, 1)) @ along)

    @cached_property
    def _drained(self) -> tuple[Array, Array]:
        """Share (f, q) of the conductance of points that are drained, and its derivative by the gap."""
        indenter = self.contact.indenter
        under, outside = (float(each == "drained") for each in (indenter.under, indenter.outside))
        width = OPEN * self.contact.widths
        t = np.clip(self.gap / width, 0.0, 1.0)
        opened, slope = t**2 * (3 - 2 * t), 6 * t * (1 - t) / width
        return under + (outside - under) * opened, (outside - under) * slope

    @cached_property
    def _seepage(self) -> tuple[Array, Array]:
        """Fluid (f, q) that leaves at the points, and its derivative by the gap."""
        contact, values = self.contact, self.contact.facets.mesh.element.facet.corner_values
        share, slope = self._drained
        rate = contact.areas * contact.drainage(self.scales) * (self._p @ values.T)
        return rate * share, rate * slope

    @cached_property
    def _p(self) -> Array:
        """(f, c) pressures at the corners."""
        columns = self.contact.facets.mesh.element.facet.corner_values.shape[1]
        return np.asarray(self.whole[self.contact.dofs[:, -columns:]])

    def _sum(self, forces: Array, volumes: Array | None) -> Array:
        """Return forces (f, q, 3) and volumes (f, q) at the points summed into the unknowns of the mesh."""
        facet = self.contact.facets.mesh.element.facet
        local = np.einsum("fqi,qa->fai", forces, facet.values).reshape(len(forces), -1)
        fluid = np.zeros((len(forces), facet.corner_values.shape[1]))
        if volumes is not None:
            fluid = volumes @ facet.corner_values
        local = np.concatenate([local, fluid], axis=1)
        size = len(self.whole)
        return np.bincount(self.contact.dofs.ravel(), local.ravel(), size).astype(float)

    def residual(self, dt: float) -> Array:
        """Return the part of the residual (unknowns,): −∫ t n N, and Δt ∫ q̄ N."""
        push = -(self.contact.areas * self.pressure)[:, :, None] * self.normal
        return self._sum(push, dt * self._seepage[0] if self.contact.indenter.drains else None)

    def tangent(self, dt: float) -> sparse.csr_matrix:
        """Return its derivative (unknowns, unknowns) by the unknowns at a fixed displacement of the indenter."""
        contact, mesh = self.contact, self.contact.facets.mesh
        facet, drains = mesh.element.facet, contact.indenter.drains
        share, _ = self._drained
        active = self.touched.any(axis=1) | (drains & (share > 0).any(axis=1))
        N, corner = facet.values, facet.corner_values
        k, m = self._slope[active], 3 * N.shape[1]
        local = np.zeros((len(k), contact.dofs.shape[1], contact.dofs.shape[1]))
        uu = np.einsum("fqij,qa,qb->faibj", k, N, N, optimize=True)
        local[:, :m, :m] = uu.reshape(len(k), m, m)
        if drains:
            _, by_gap = self._seepage
            pu = dt * np.einsum(
                "fq,qc,fqi,qa->fcai", by_gap[active], corner, self.normal[active], N, optimize=True
            )
            local[:, m:, :m] = pu.reshape(len(k), corner.shape[1], m)
            rate = dt * (contact.areas * contact.drainage(self.scales) * share)[active]
            local[:, m:, m:] = np.einsum("fq,qc,qd->fcd", rate, corner, corner, optimize=True)
        dofs = contact.dofs[active]
        width, size = dofs.shape[1], len(self.whole)
        rows, columns = np.repeat(dofs, width, axis=1).ravel(), np.tile(dofs, (1, width)).ravel()
        return sparse.csr_matrix((local.ravel(), (rows, columns)), shape=(size, size))

    def by_motion(self, dt: float) -> Array:
        """Return the derivative (unknowns,) of the residual by the displacement of the indenter."""
        along = self.contact.along
        volumes = None
        if self.contact.indenter.drains:
            volumes = -dt * self._seepage[1] * (self.normal @ along)
        return self._sum(-self._slope @ along, volumes)

    @cached_property
    def motion_by_unknowns(self) -> Array:
        """Derivative (unknowns,) of the displacement of an indenter under a force by the unknowns."""
        if not self.stiffness > 0:
            return self._followed
        return self._sum(self._slope @ self.contact.along, None) / self.stiffness

    @property
    def _followed(self) -> Array:
        """The same without a force, where the indenter stands on the point of the surface that is nearest to it."""
        contact, shape = self.contact, self.contact.touching
        distance = contact.distance(contact.arms(self.whole, shape).reshape(-1, 3), self.motion)
        nearest = int(distance.gap.argmin())
        facet, point = divmod(nearest, len(shape))
        n, found = distance.normal[nearest], np.zeros(len(self.whole))
        away = float(n @ contact.along)
        if not away:
            return found
        dofs = 3 * contact.facets.nodes[facet][:, None] + np.arange(3)
        found[dofs] = shape[point][:, None] * n / away
        return found

    @cached_property
    def _by_radius(self) -> tuple[Array, Array]:
        """Derivatives by the radius of w t n (f, q, 3) at the points, and of the gap (f, q)."""
        contact, shape = self.contact, self.gap.shape
        slope = self.distance.by_radius.reshape(shape)
        turned = self.distance.normal_by_radius.reshape(*shape, 3)
        rise = np.where(self.touched, -self._penalty * slope, 0.0)
        push = rise[:, :, None] * self.normal + self.pressure[:, :, None] * turned
        return contact.areas[:, :, None] * push, slope

    def change(self, own: IndenterChanges, dt: float) -> tuple[Array, float]:
        """Return the change of the residual (unknowns,) and of the displacement of the shape at fixed unknowns."""
        motion = self._moved(own)
        found = motion * self.by_motion(dt)
        if own.radius:
            push, slope = self._by_radius
            volumes = dt * self._seepage[1] * slope if self.contact.indenter.drains else None
            found = found + own.radius * self._sum(-push, volumes)
        if own.stiffness:
            push = (self.contact.areas * self.pressure)[:, :, None] * self.normal
            found = found - own.stiffness * self._sum(push, None)
        if own.conductance and self.contact.indenter.drains:
            found = found + own.conductance * self._sum(np.zeros(self.normal.shape), dt * self._seepage[0])
        return found, motion

    def _moved(self, own: IndenterChanges) -> float:
        """Return how far the shape moves, its offset included, under changes of what is given."""
        if not self.contact.by_force:
            return own.prescribed + own.offset
        if not self.stiffness > 0:
            return 0.0
        pushed = float((self._by_radius[0] @ self.contact.along).sum())
        return (own.prescribed - own.radius * pushed - own.stiffness * self.force) / self.stiffness

    @cached_property
    def slopes(self) -> MeasuredSlopes:
        """Derivatives of what is measured."""
        contact, along = self.contact, self.contact.along
        facet = contact.facets.mesh.element.facet
        n, shape, size = self.normal, self.gap.shape, len(self.whole)
        push, by_radius = self._by_radius
        unknowns, motion, radius = np.zeros((7, size)), np.zeros(7), np.zeros(7)
        unknowns[FORCE] = self._sum(-self._slope @ along, None)
        motion[FORCE], radius[FORCE] = self.stiffness, (push @ along).sum()
        motion[MOVED] = 1.0
        if self.touched.any():
            area = touched_area(contact, self.whole, self.motion)
            for row, factor in (
                (AREA, 1.0),
                (AREA + 1, 0.5 / np.sqrt(np.pi * area.value) if area.value and self._is_round else 0.0),
            ):
                unknowns[row] = factor * area.unknowns
                motion[row], radius[row] = factor * area.motion, factor * area.radius
            for row, scale in ((PRESSURE, self._penalty * np.ones(shape)), (PRESSURE + 1, np.ones(shape))):
                at = np.unravel_index((scale * self.gap).argmin(), shape)
                rate = np.zeros(shape)
                rate[at] = -scale[at]
                unknowns[row] = self._sum(rate[:, :, None] * n, None)
                motion[row], radius[row] = -(rate * (n @ along)).sum(), (rate * by_radius).sum()
        if contact.indenter.drains:
            by_gap = self._seepage[1]
            share = contact.areas * contact.drainage(self.scales) * self._drained[0]
            own = by_gap[:, :, None] * n
            local = np.concatenate(
                [
                    np.einsum("fqi,qa->fai", own, facet.values).reshape(len(own), -1),
                    np.einsum("fq,qc->fc", share, facet.corner_values),
                ],
                axis=1,
            )
            unknowns[FLOW] = np.bincount(contact.dofs.ravel(), local.ravel(), size)
            motion[FLOW], radius[FLOW] = -(by_gap * (n @ along)).sum(), (by_gap * by_radius).sum()
        return MeasuredSlopes(unknowns, motion, radius)

    @property
    def total_slopes(self) -> Array:
        """Derivatives (7, unknowns) of what is measured by the unknowns, where an indenter under a force follows."""
        found = self.slopes.unknowns
        if self.contact.by_force:
            found = found + np.outer(self.slopes.motion, self.motion_by_unknowns)
        return found

    def measured_change(self, own: IndenterChanges) -> Array:
        """Return the change (7,) of what is measured at fixed unknowns."""
        found = self._moved(own) * self.slopes.motion + own.radius * self.slopes.radius
        found[MOVED] -= own.offset  # the displacement is that from the place
        found[FORCE] += own.stiffness * self.force
        found[PRESSURE] += own.stiffness * self.pressure.max(initial=0.0)
        if own.conductance and self.contact.indenter.drains:
            found[FLOW] += own.conductance * self._seepage[0].sum()
        return found

    @property
    def _is_round(self) -> bool:
        return self.contact.indenter.touches_circle(section=self.contact.facets.mesh.is_section)

    @property
    def penetration(self) -> float:
        """Largest depth of the indenter in the body, at least 0."""
        return max(-float(self.gap.min(initial=0.0)), 0.0)

    def measured(self) -> Array:
        """Return the values of :data:`porocore.interfaces.solution.CONTACT`, of this part of the body."""
        area = touched_area(self.contact, self.whole, self.motion).value if self.touched.any() else 0.0
        return np.array(
            [
                self.force,
                self.motion,
                area,
                np.sqrt(area / np.pi) if self._is_round else 0.0,
                self.pressure.max(initial=0.0),
                self.penetration,
                self._seepage[0].sum() if self.contact.indenter.drains else 0.0,
            ]
        )

    def nodal_pressure(self) -> Array:
        """Return the contact pressure (nodes,) at the nodes of the facets, zero elsewhere.

        It is a mean of that at the quadrature points around, where alone it is the pressure that acts.
        """
        contact, mesh = self.contact, self.contact.facets.mesh
        nodes, share = contact.facets.nodes.ravel(), np.abs(mesh.element.facet.values)
        pushed, area = (
            np.bincount(nodes, (each @ share).ravel(), len(mesh.points))
            for each in (contact.areas * self.pressure, contact.areas)
        )
        return np.divide(pushed, area, out=np.zeros(len(area)), where=area > 0)

    @cached_property
    def size(self) -> float:
        """Largest sum of κ times the lengths that a gap is the difference of, of which a force has the round-off.

        Lengths across the normal are none of them: a gap below a flat face does not know how far its middle is.
        """
        along = self.contact.along
        lengths = np.abs(self.contact.arms(self.whole)) + np.abs(self.motion * along)
        size = np.einsum("fqi,fqi->fq", np.abs(self.normal), lengths)
        weight = np.where(self.touched, self.contact.areas * self._penalty, 0.0)
        return float(self._sum((weight * size)[:, :, None] * np.ones(3), None).max(initial=0.0))


@dataclass(frozen=True)
class IndenterChanges:
    """Changes of what is given of an indenter.

    Attributes
    ----------
    prescribed
        Of its displacement or force.
    offset
        Of its place along the direction.
    radius
        Of its shape.
    stiffness
        Of the penalty, relative: it follows the modulus of the solid.
    conductance
        Of the drained surface, relative: it follows the conductivity.
    """

    prescribed: float = 0.0
    offset: float = 0.0
    radius: float = 0.0
    stiffness: float = 0.0
    conductance: float = 0.0

    @property
    def any(self) -> bool:
        """True if anything changes."""
        return any((self.prescribed, self.offset, self.radius, self.stiffness, self.conductance))


@dataclass(frozen=True, eq=False)
class MeasuredSlopes:
    """Derivatives of the seven columns by the unknowns (7, unknowns), the motion of the shape and its radius (7,)."""

    unknowns: Array
    motion: Array
    radius: Array


@dataclass(frozen=True, eq=False)
class TouchedArea:
    """Reference area of a contact, with its derivatives by unknowns (unknowns,), motion and radius."""

    value: float
    unknowns: Array
    motion: float
    radius: float


def touched_area(contact: Contact, whole: Array, motion: float) -> TouchedArea:
    """Return the reference area of the contact.

    Where a smooth indenter lets go of the surface, the gap opens with the power 3/2 of the distance, so its power 2/3
    is what shape functions can follow: they interpolate it from the nodes, where the displacement is most accurate. In
    the contact the gap is of no use, as small as what the shape functions miss of the shape. So the area is the limit
    at zero of the areas below three levels, a parabola as that of a disc whose radius grows with the level. The levels
    are shares of the largest gap of the facets that are touched and of those around, whatever the depth and the size of
    the elements.
    """
    parts, nodes = FacetParts.of(contact.facets.mesh), contact.facets.nodes
    at = contact.arms(whole, np.eye(nodes.shape[1]))
    distance = contact.distance(at.reshape(-1, 3), motion)
    gap, weights = distance.gap.reshape(nodes.shape), parts.areas(contact.facets)
    acting = contact.distance(contact.arms(whole).reshape(-1, 3), motion).gap.reshape(contact.areas.shape)
    touched = (acting < 0).any(axis=1)
    near, levels = touched, LEVELS_OF_EDGES if contact.facets.mesh.flat else LEVELS_OF_FACES
    for _ in range(ROWS_OF_EDGES if contact.facets.mesh.flat else ROWS_OF_FACES):
        near = np.isin(nodes, nodes[near]).any(axis=1)
    widest = np.unravel_index(np.where(near[:, None], gap, -np.inf).argmax(), gap.shape)
    largest = gap[widest]
    if not touched.any() or largest <= -acting.min():
        return TouchedArea(float(weights[touched].sum()), np.zeros(len(whole)), 0.0, 0.0)
    # Rounded where the gap closes, so that it has a derivative there.
    opened = np.maximum(gap, 0.0) / largest
    rounded = opened**2 + ROUNDED**2
    path = rounded ** (1 / 3) - ROUNDED ** (2 / 3)
    path_slope = 2 / 3 * opened * rounded ** (-2 / 3) / largest
    total, by_path = 0.0, np.zeros((len(nodes), len(parts.values)))
    for level, factor in levels:
        below = path @ parts.values.T - level
        rows = np.flatnonzero((below < 0).any(axis=1))
        k = parts.simplices.shape[1]
        shares, slopes = covered(below[rows][:, parts.simplices].reshape(-1, k))
        own = factor * weights[rows].ravel()
        total += float(own @ shares)
        at_rows, columns = np.repeat(rows, parts.simplices.size), np.tile(parts.simplices.ravel(), len(rows))
        np.add.at(by_path, (at_rows, columns), (own[:, None] * slopes).ravel())
    by_gap = (by_path @ parts.values) * path_slope
    by_gap[widest] -= float((by_gap * gap).sum()) / largest
    n = distance.normal.reshape(at.shape)
    dofs = (3 * nodes[:, :, None] + np.arange(3)).ravel()
    return TouchedArea(
        max(total, 0.0),
        np.bincount(dofs, (by_gap[:, :, None] * n).ravel(), len(whole)).astype(float),
        -float((by_gap * (n @ contact.along)).sum()),
        float((by_gap.ravel() * distance.by_radius).sum()),
    )


def covered(gaps: Array) -> tuple[Array, Array]:
    """Return the shares of segments or triangles where a linear function is below zero, with their slopes.

    Parameters
    ----------
    gaps : (n, 2 or 3)
        Its values at the corners.

    Returns
    -------
    shares, slopes : (n,), (n, 2 or 3)
        The latter are the derivatives by the values.
    """
    inside = gaps < 0
    count, k = inside.sum(axis=1), gaps.shape[1]
    found, slopes = (count == k).astype(float), np.zeros(gaps.shape)
    for one, sign in ((1, 1.0), (k - 1, -1.0)):
        if k == 2 and sign < 0:
            continue
        # The one corner that stands alone, and the share of its edges that are cut off.
        rows = np.flatnonzero(count == one)
        alone = (inside if sign > 0 else ~inside)[rows].argmax(axis=1)
        is_alone = np.arange(k) == alone[:, None]
        own = gaps[rows, alone][:, None]
        apart = own - gaps[rows][~is_alone].reshape(len(rows), k - 1)
        share = np.divide(own, apart, out=np.zeros_like(apart), where=apart != 0).prod(axis=1)
        found[rows] = share if sign > 0 else 1.0 - share
        rates = np.divide(share[:, None], apart, out=np.zeros_like(apart), where=apart != 0)
        at_own = np.divide((k - 1) * share, own[:, 0], out=np.zeros_like(share), where=own[:, 0] != 0)
        local = np.zeros((len(rows), k))
        local[~is_alone] = rates.ravel()
        local[is_alone] = at_own - rates.sum(axis=1)
        slopes[rows] = sign * local
    return found, slopes


@dataclass(frozen=True, eq=False)
class FacetParts:
    """Simplices into which the reference facet is cut.

    Attributes
    ----------
    values : (v, m)
        Shape functions of the displacement at their corners.
    simplices : (s, 2 or 3)
        Their corners.
    """

    values: Array
    simplices: IntArray

    @classmethod
    def of(cls, mesh: BodyMesh) -> FacetParts:
        """Return the parts of the facets of a mesh, by the shape functions of its elements on one of their facets."""
        element = mesh.element
        nodes, corners = element.facets[0], element.facet.corner_values.shape[1]
        start, *ends = element.nodes[nodes[:corners]]
        n = PARTS if corners > 2 else 4 * PARTS
        t = np.arange(n + 1) / n
        if corners == 2:
            places = start + t[:, None] * (ends[0] - start)
            return cls(element.values(places)[:, nodes], np.stack([np.arange(n), np.arange(n) + 1], axis=1))
        s, r = (each.ravel() for each in np.meshgrid(t, t))
        places = start + s[:, None] * (ends[0] - start) + r[:, None] * (ends[-1] - start)
        first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
        lower = np.stack([first, first + 1, first + n + 1], axis=1)
        upper = np.stack([first + 1, first + n + 2, first + n + 1], axis=1)
        simplices = np.concatenate([lower, upper])
        if corners == 3:
            middles = np.stack([s, r], axis=1)[simplices].mean(axis=1)
            simplices = simplices[middles.sum(axis=1) < 1]
        return cls(element.values(places)[:, nodes], simplices)

    def areas(self, facets: Facets) -> Array:
        """Return the reference areas (f, s) of the simplices; those of a facet add up to that of the facet."""
        places = (self.values @ facets.mesh.points[facets.nodes])[:, self.simplices]
        edges = places[:, :, 1:] - places[:, :, :1]
        if edges.shape[2] == 1:
            found = np.linalg.norm(edges[:, :, 0], axis=-1)
            found = found * facets.mesh.measure(places.mean(axis=2))
        else:
            found = np.linalg.norm(np.cross(edges[:, :, 0], edges[:, :, 1]), axis=-1)
        return np.asarray(found * (facets.areas.sum(axis=1) / found.sum(axis=1))[:, None])


def states(
    contacts: Sequence[Contact],
    whole: Array,
    prescribed: Sequence[float],
    scales: ContactScales,
    motions: Sequence[float] = (),
) -> Iterator[IndenterContact]:
    """Yield the states of several contacts, at given displacements of the indenters or where they rest."""
    for number, (contact, value) in enumerate(zip(contacts, prescribed, strict=True)):
        if motions:
            yield IndenterContact(contact, whole, motions[number], scales)
        else:
            yield contact.state(whole, value, scales)


def united(mesh: BodyMesh, facets: Sequence[IntArray]) -> Facets:
    """Return the facets of several surfaces, each once."""
    rows = np.concatenate(facets)
    _, first = np.unique(np.array(mesh.corners_of(rows)), axis=0, return_index=True)
    return Facets(mesh, rows[np.sort(first)])


def inside(contact: Contact, gradient: Any, motion: float) -> tuple[float, Array]:
    """Return how deep the indenter reaches into the body, and where, under a uniform displacement gradient."""
    mesh = contact.facets.mesh
    whole = np.zeros(mesh.size)
    whole[: mesh.n_u] = (mesh.points @ np.array(gradient).T).ravel()
    arms = contact.arms(whole, contact.touching).reshape(-1, 3)
    gap = contact.distance(arms, motion).gap
    worst = int(gap.argmin())
    return -float(gap[worst]), arms[worst] + np.array(contact.indenter.place)
