"""Interface of a backend to the time loop: states, residual, tangent, solve; exception of a failed step.

A process holds *local* unknowns: first those that it owns, then copies of others that its elements touch. A
backend that does not distribute owns all. Vectors here are numpy arrays over the local unknowns; at nodes of oblique
surfaces these are components in a frame of the node, see :mod:`porocore.macro.boundary.conditions`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Generic

import numpy as np
from scipy import sparse
from typing_extensions import TypeVar

from porocore.core.parallel import Communicator
from porocore.interfaces.law import Integrand, MacroTangent
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.boundary.conditions import BoundaryData, Loads, follower_forces, follower_tangent
from porocore.macro.boundary.contact import ContactScales, IndenterContact, NoContact, states
from porocore.macro.linear_systems import TIGHTEST, LinearWork
from porocore.macro.problem import MacroProblem
from porocore.states import Array, IntArray, MacroState


class StepFailed(Exception):
    """Failure of Newton's iteration; the time stepping shortens the step."""


@dataclass(frozen=True, eq=False)
class Residual:
    """Out-of-balance forces and volumes, and their scales.

    Attributes
    ----------
    values : (local unknowns,)
        ∫ P_E:∇N − ∫ t̄ N, and ∫ Δstorage N − Δt ∫ q·∇N + Δt ∫ q̄ N, where owned; on a prescribed unknown the
        reaction.
    force_scale, volume_scale
        Largest sum of the magnitudes of what meets in one unknown of the body.
    """

    values: Array
    force_scale: float
    volume_scale: float


@dataclass(frozen=True, eq=False)
class SurfaceTangent:
    """Derivative of the forces and fluxes on the surface by all unknowns.

    Attributes
    ----------
    matrix
        Cartesian, sparse (unknowns, unknowns), on every process; it couples unknowns of one facet alone.
    left, right : (local unknowns, r)
        Where owned: Σ left rightᵀ is to be added, one term for each indenter under a force.
    size
        Largest sum of terms that cancel in a force of an indenter.
    """

    matrix: sparse.csr_matrix
    left: Array
    right: Array
    size: float

    def transposed(self) -> SurfaceTangent:
        """Return the transpose."""
        return SurfaceTangent(self.matrix.T.tocsr(), self.right, self.left, self.size)


@dataclass(frozen=True, eq=False)
class CoupledSystem:
    """Tangent of all unknowns: that of a backend, plus Σ left rightᵀ of few terms.

    Attributes
    ----------
    d
        Discretisation.
    system
        Of its backend.
    left, right : (local unknowns, r)
        Where owned.
    size
        Largest sum of terms that cancel in a force of an indenter.
    """

    d: Discretisation[Any]
    system: Any
    left: Array
    right: Array
    size: float

    def solve(self, right: Array, jump: Array, *, again: bool = False, accuracy: float = TIGHTEST) -> Array:
        """Solve as :meth:`Discretisation.solve` does, for further terms by the formula of Woodbury."""
        d = self.d
        x = d.solve(self.system, right, jump, again=again, accuracy=accuracy)
        if not self.left.shape[1]:
            return x
        shares = np.linalg.solve(np.eye(self.left.shape[1]) + self.weighed(self._columns), self.weighed(x))
        return np.asarray(x - self._columns @ shares)

    @cached_property
    def _columns(self) -> Array:
        """Solutions (local unknowns, r) for the left vectors."""
        still = np.zeros(len(self.d.prescribed))
        found = [self.d.solve(self.system, each, still, again=True) for each in self.left.T]
        return np.stack(found, axis=1)

    def weighed(self, x: Array) -> Array:
        """Return rightᵀ x over all processes: how far indenters under a force follow a change of the unknowns."""
        return np.asarray(self.d.communicator.sum(self.right[: self.d.owned].T @ x[: self.d.owned]))

    def magnitudes(self, x: Array) -> Array:
        """Return |A| |x| in the rows of the free unknowns, as :meth:`Discretisation.magnitudes`."""
        found = self.d.magnitudes(self.system, x)
        if not self.left.shape[1]:
            return found
        sizes = self.d.communicator.sum(np.abs(self.right[: self.d.owned]).T @ np.abs(x[: self.d.owned]))
        return np.asarray(found + np.abs(self.left) @ sizes)

    def transposed(self) -> CoupledSystem:
        """Return the transpose; this system is not solved with any more."""
        return CoupledSystem(self.d, self.d.transposed(self.system), self.right, self.left, self.size)


#: Type of the tangent of all unknowns, which only the backend looks into.
System = TypeVar("System", default=Any)


class Discretisation(ABC, Generic[System]):
    """Discrete u–p problem on a mesh, the parts that do not change between iterations.

    Parameters
    ----------
    problem, mesh, boundary
        From the core.
    unknowns : (local unknowns,)
        Number of each in the mesh's order.
    owned
        How many of them, from the first, belong to this process.
    elements : (local elements,)
        Number of each in the mesh's order; an element belongs to one process.
    dofs : (local elements, 81 + 8, 30 + 4, 27 + 4 or 18 + 3)
        Local unknowns of each element in the order of :meth:`contributions`.
    communicator
        The processes.

    Attributes
    ----------
    prescribed : (k,)
        Local unknowns that are prescribed.
    free : (f,)
        Owned unknowns that are not, ascending.
    plates
        For each rigid plate the places in ``free`` of its unknowns, as far as they are owned; they are all one.
    leading : (f,) bool
        Which of ``free`` stand for themselves: all but those of plates, of which only the first of each does, on the
        process that owns it. As many equations are solved.
    is_force : (local unknowns,)
        Whether an unknown is a displacement.
    weights : (points,)
        Volume of each quadrature point.
    rotation
        Sparse (local unknowns, local unknowns), from Cartesian ones; None where all are Cartesian.
    """

    def __init__(
        self,
        problem: MacroProblem,
        mesh: BodyMesh,
        boundary: BoundaryData,
        *,
        unknowns: IntArray,
        owned: int,
        elements: IntArray,
        dofs: IntArray,
        communicator: Communicator | None = None,
    ) -> None:
        self.problem, self.mesh, self.boundary = problem, mesh, boundary
        self.communicator = Communicator() if communicator is None else communicator
        self.unknowns, self.owned, self.elements, self.dofs = unknowns, owned, elements, dofs
        self.is_force = unknowns < mesh.n_u
        is_free = ~np.isin(unknowns, boundary.prescribed)
        self.free = np.flatnonzero(is_free[:owned])
        self.prescribed = np.flatnonzero(~is_free)
        self.plates = tuple(np.flatnonzero(np.isin(unknowns[self.free], plate)) for plate in boundary.plates)
        self.leading = np.ones(len(self.free), bool)
        for places, plate in zip(self.plates, boundary.plates, strict=True):
            self.leading[places] = unknowns[self.free[places]] == plate[0]
        self.rotation = (
            None if boundary.rotation is None else boundary.rotation[unknowns][:, unknowns].tocsr()
        )
        self._loads = self.loads_of(boundary)
        self.weights = mesh.weights[elements].ravel()
        self.stretch = mesh.stretch
        self.linear = LinearWork()  # the backend fills it
        self.keeps_factor = False  # whether to solve again with a system costs little
        self.contact_scales = ContactScales()  # those of the law of a solve
        #: (local unknowns,) State from which prescribed displacements are counted; None: the undeformed one.
        self.origin: Array | None = None

    @property
    def n_points(self) -> int:
        """Quadrature points of this process."""
        return len(self.weights)

    @property
    def n_u(self) -> int:
        """Displacements of an element, which come first in ``dofs``."""
        return 3 * self.mesh.cells.shape[1]

    def begin(self) -> None:
        """Begin a solve, which must not depend on those before it."""
        self.linear.begin()

    def loads(self, acting: Array | float) -> Loads:
        """Return the loads from the values of the time functions (functions,); one number is that of the ramp."""
        return self._loads(np.atleast_1d(np.asarray(acting, dtype=float)))

    def loads_at(self, time: float) -> Loads:
        """Return the loads at ``time`` of a run, whose prescribed displacements are counted from the origin."""
        found = self.loads(self.boundary.amplitudes(self.problem, time))
        if self.origin is None:
            return found
        moved = np.where(self.is_force[self.prescribed], self.origin[self.prescribed], 0.0)
        return replace(found, values=found.values + moved)

    def loads_of(self, boundary: BoundaryData) -> Callable[[Array], Loads]:
        """Return the loads of this process, by the values (functions,) of the time functions.

        The data may be others than those of the problem that prescribe the same unknowns.
        """
        place = np.full(self.mesh.size, -1)
        place[boundary.prescribed] = np.arange(len(boundary.prescribed))
        places = place[self.unknowns]
        values = boundary.values[places[places >= 0]]
        external = np.where(
            np.arange(len(self.unknowns)) < self.owned, boundary.external[:, self.unknowns], 0.0
        )
        if self.rotation is not None:
            external = external @ self.rotation.T

        def at(amplitudes: Array) -> Loads:
            followers = boundary.followers
            pressures = tuple(float(factor * amplitudes[function]) for function, factor, _ in followers)
            indenters = tuple(float(each.factor * amplitudes[each.function]) for each in boundary.contacts)
            return Loads(values @ amplitudes, amplitudes @ external, pressures, indenters)

        return at

    def outflow(self, loads: Loads) -> float:
        """Return the rate of all prescribed fluxes out of the body, ∫ q̄ dS."""
        return float(self.communicator.sum(float(loads.external[~self.is_force].sum())))

    def cartesian(self, x: Array) -> Array:
        """Return local unknowns in Cartesian components."""
        return x if self.rotation is None else np.asarray(self.rotation.T @ x)

    def states(self, x: Array) -> tuple[MacroState, Array]:
        """Return H, p and ∇p (points, 3) at the quadrature points, by element and then in the mesh's order."""
        return self.states_of(self.cartesian(x))

    @abstractmethod
    def states_of(self, x: Array) -> tuple[MacroState, Array]:
        """Return the same from Cartesian unknowns."""

    @abstractmethod
    def contributions(self, response: Integrand) -> tuple[Array, Array, Array]:
        """Return ∫ P_E:∇N (elements, 81 or 30), ∫ Δstorage N and ∫ q·∇N (elements, 8 or 4) of each element."""

    @abstractmethod
    def system(self, tangent: MacroTangent, dt: float, surface: sparse.csr_matrix | None = None) -> System:
        """Return the derivative of the residual by all unknowns, in the form that the other methods take.

        ``surface`` (unknowns, unknowns) is to be added, Cartesian and in the mesh's order; it couples unknowns of one
        element. With a :attr:`rotation` Q it is Q A Qᵀ.
        """

    def coupled(self, tangent: MacroTangent, dt: float, x: Array, loads: Loads) -> CoupledSystem:
        """Return the derivative of the residual at the unknowns ``x`` with that of the forces on the surface."""
        surface = self.surface_tangent(x, loads, dt)
        if surface is None:
            nothing = np.zeros((len(self.unknowns), 0))
            return CoupledSystem(self, self.system(tangent, dt), nothing, nothing, 0.0)
        system = self.system(tangent, dt, surface.matrix)
        return CoupledSystem(self, system, surface.left, surface.right, surface.size)

    @abstractmethod
    def transposed(self, system: System) -> System:
        """Return the transpose, which :meth:`solve` takes with no jumps; ``system`` is not solved with any more."""

    @abstractmethod
    def magnitudes(self, system: System, x: Array) -> Array:
        """Return |A| |x| in the rows of the free unknowns; those of a plate may stand in the first of its rows."""

    @abstractmethod
    def solve(
        self,
        system: System,
        right: Array,
        jump: Array,
        *,
        again: bool = False,
        accuracy: float = TIGHTEST,
    ) -> Array:
        """Solve A d = ``right`` in the equations with d = ``jump`` in the prescribed unknowns.

        The unknowns of a plate change alike. ``again`` says that the factor of the system before may serve as a
        preconditioner. An iteration may leave a residual of ``accuracy`` times the right-hand side.

        Raises
        ------
        StepFailed
            The matrix is singular, or an iterative solver does not converge.
        """

    def add_copies(self, values: Array) -> Array:
        """Add the entries of copies to those of their owners; a backend that distributes overrides this."""
        return values

    def residual(self, response: Integrand, dt: float, loads: Loads, x: Array | None = None) -> Residual:
        """Return the residual under ``loads``; with the unknowns ``x`` also of what acts on the deformed surface."""
        forces, stored, moved = self.contributions(response)
        moved = -dt * moved
        external = np.where(self.is_force, 1.0, dt) * loads.external
        if x is not None and self.has_surface_forces(loads):
            external = external + self.surface_forces(x, loads, dt)
        values = self._rotated(self._gather(forces, stored + moved)) + external
        scales = self._gather(np.abs(forces), np.abs(stored) + np.abs(moved)) + np.abs(external)
        own = np.arange(len(scales)) < self.owned
        force_scale, volume_scale = (
            self.communicator.max(float(scales[rows & own].max(initial=0.0)))
            for rows in (self.is_force, ~self.is_force)
        )
        return Residual(values, force_scale, volume_scale)

    def has_surface_forces(self, loads: Loads) -> bool:
        """Tell whether forces act on the deformed surface: pressures that follow it, or indenters."""
        return any(loads.pressures) or bool(loads.indenters)

    def surface_forces(self, x: Array, loads: Loads, dt: float) -> Array:
        """Return the part of the residual (local unknowns,), where owned, by followers and indenters at ``x``.

        Raises
        ------
        StepFailed
            An indenter under a force does not find the body.
        """
        whole = self.to_mesh(x)
        force = np.zeros(self.mesh.size)
        u = whole[: self.mesh.n_u].reshape(-1, 3)
        for (_, _, facets), pressure in zip(self.boundary.followers, loads.pressures, strict=True):
            if pressure:
                force[: self.mesh.n_u] += follower_forces(facets, u, pressure).ravel()
        for state in self.contact_states(whole, loads):
            force += state.residual(dt)
        return self._owned(force)

    def contact_states(self, whole: Array, loads: Loads) -> list[IndenterContact]:
        """Return the contact of each indenter under all unknowns (mesh.size,), Cartesian.

        Raises
        ------
        StepFailed
            An indenter under a force does not find the body.
        """
        try:
            found = states(self.boundary.contacts, whole, loads.indenters, self.contact_scales, loads.motions)
            return list(found)
        except NoContact as failure:
            raise StepFailed(str(failure)) from None

    def surface_tangent(self, x: Array, loads: Loads, dt: float) -> SurfaceTangent | None:
        """Return the derivative of :meth:`surface_forces` by the unknowns; None: no forces.

        Raises
        ------
        StepFailed
            An indenter under a force does not find the body.
        """
        if not self.has_surface_forces(loads):
            return None
        whole, size = self.to_mesh(x), self.mesh.size
        u = whole[: self.mesh.n_u].reshape(-1, 3)
        matrix = sparse.csr_matrix((size, size))
        for (_, _, facets), pressure in zip(self.boundary.followers, loads.pressures, strict=True):
            if pressure:
                part = follower_tangent(facets, u, pressure)
                part.resize((size, size))
                matrix = matrix + part
        left: list[Array] = []
        right: list[Array] = []
        largest = 0.0
        for state in self.contact_states(whole, loads):
            matrix = matrix + state.tangent(dt)
            largest = max(largest, state.size)
            if state.contact.by_force:
                left.append(self._owned(state.by_motion(dt)))
                right.append(self._owned(state.motion_by_unknowns))
        nothing = np.zeros((len(self.unknowns), 0))
        if not left:
            return SurfaceTangent(matrix, nothing, nothing, largest)
        return SurfaceTangent(matrix, np.stack(left, axis=1), np.stack(right, axis=1), largest)

    def resting(self, x: Array, loads: Loads, before: Loads | None = None) -> Loads:
        """Return the loads with the displacements at which all indenters rest on the body with the unknowns ``x``.

        Those whose displacement is prescribed are where they are, or where they were under the loads ``before``.

        Raises
        ------
        StepFailed
            An indenter under a force does not find the body.
        """
        if not loads.indenters:
            return loads
        found = self.contact_states(self.to_mesh(x), replace(loads, motions=()))
        old = loads if before is None else before
        return replace(
            loads,
            motions=tuple(
                state.motion if state.contact.by_force else given
                for state, given in zip(found, old.indenters, strict=True)
            ),
        )

    def lag(self, loads: Loads) -> tuple[float, ...]:
        """Return how far each indenter with a prescribed displacement is behind it."""
        given = zip(self.boundary.contacts, loads.indenters, loads.motions, strict=True)
        return tuple(0.0 if contact.by_force else to - at for contact, to, at in given)

    def pushed(self, x: Array, loads: Loads) -> tuple[Array, Array]:
        """Return what contact forces exceed those on each indenter under a force by (r,), and their stiffness (r,)."""
        if not any(contact.by_force for contact in self.boundary.contacts):
            return np.zeros(0), np.zeros(0)
        found = zip(self.contact_states(self.to_mesh(x), loads), loads.indenters, strict=True)
        pairs = [(state.force - force, state.stiffness) for state, force in found if state.contact.by_force]
        excess, stiffness = np.array(pairs).T
        return excess, stiffness

    def moved_indenters(self, loads: Loads, by: Array, lag: Sequence[float] = ()) -> Loads:
        """Return the loads with the displacements of the indenters under a force changed ``by`` (r,).

        The others go on by what they ``lag`` behind.
        """
        if not len(by) and not any(lag):
            return loads
        moved = np.array(loads.motions) + (np.array(lag) if len(lag) else 0.0)
        motions, changes = moved.tolist(), iter(by.tolist())
        for number, contact in enumerate(self.boundary.contacts):
            if contact.by_force:
                motions[number] += next(changes)
        return replace(loads, motions=tuple(motions))

    def surface_change(self, x: Array, loads: Loads, own: Loads, dt: float) -> Array:
        """Return the derivative (local unknowns,) of :meth:`surface_forces`, where owned, as loads change by ``own``.

        Pressures change, and what is given of indenters; the unknowns do not.
        """
        changes = own.indenter_changes
        if not any(own.pressures) and not any(each.any for each in changes):
            return np.zeros(len(self.unknowns))
        whole = self.to_mesh(x)
        force = np.zeros(self.mesh.size)
        u = whole[: self.mesh.n_u].reshape(-1, 3)
        for (_, _, facets), pressure in zip(self.boundary.followers, own.pressures, strict=True):
            if pressure:
                force[: self.mesh.n_u] += follower_forces(facets, u, pressure).ravel()
        for state, change in zip(self.contact_states(whole, loads), changes, strict=True):
            if change.any:
                force += state.change(change, dt)[0]
        return self._owned(force)

    def contact_changes(self, x: Array, loads: Loads, changes: list[Array], own: list[Loads]) -> list[Array]:
        """Return the changes (7 · indenters,) of what is measured of all indenters, one for each change of the loads.

        Parameters
        ----------
        x : (local unknowns,)
            Solution under ``loads``.
        changes : (local unknowns,)
            Of the unknowns.
        own
            Of the loads.
        """
        if not self.boundary.contacts:
            return [np.zeros(0)] * len(changes)
        found = self.contact_states(self.to_mesh(x), loads)
        slopes = [state.total_slopes for state in found]
        rows = []
        for change, each in zip(changes, own, strict=True):
            whole = self.to_mesh(change)
            parts = zip(found, slopes, each.indenter_changes, strict=True)
            rows.append(
                np.concatenate([slope @ whole + state.measured_change(c) for state, slope, c in parts])
            )
        return rows

    def surface_product(self, surface: SurfaceTangent, x: Array) -> Array:
        """Return the derivative of the forces on the surface times a change ``x`` (local unknowns,), where owned."""
        own = x[: self.owned]
        shares = self.communicator.sum(surface.right[: self.owned].T @ own)
        return np.asarray(self._owned(surface.matrix @ self.to_mesh(x)) + surface.left @ shares)

    def _owned(self, whole: Array) -> Array:
        """Return the local unknowns from all, zero where another process owns them."""
        return np.where(np.arange(len(self.unknowns)) < self.owned, self.from_mesh(whole), 0.0)

    def _rotated(self, values: Array) -> Array:
        return values if self.rotation is None else np.asarray(self.rotation @ values)

    def equations(self, values: Array) -> Array:
        """Return the values (leading,) of this process's equations from those in the rows of all local unknowns.

        The equation of a plate is the sum over its unknowns, wherever they are.
        """
        values = values[self.free].copy()
        for places in self.plates:
            total = self.communicator.sum(float(values[places].sum()))
            values[places[self.leading[places]]] = total
        return np.asarray(values[self.leading])

    def _gather(self, forces: Array, volumes: Array) -> Array:
        blocks = np.concatenate([forces, volumes], axis=1)
        return self.add_copies(
            np.bincount(self.dofs.ravel(), blocks.ravel(), minlength=len(self.unknowns)).astype(float)
        )

    def to_mesh(self, x: Array) -> Array:
        """Return all unknowns (mesh.size,) in the mesh's order, Cartesian, on every process."""
        return self.gathered(self.cartesian(x))

    def from_mesh(self, whole: Array) -> Array:
        """Return the local unknowns from all."""
        return self._rotated(whole[self.unknowns])

    def gathered(self, values: Array) -> Array:
        """Return the values (mesh.size,) of all local unknowns in the mesh's order, not rotated, on every process."""
        whole = np.zeros(self.mesh.size)
        whole[self.unknowns[: self.owned]] = values[: self.owned]
        return np.asarray(self.communicator.sum(whole))

    def points_to_mesh(self, values: Array) -> Array:
        """Return values at all quadrature points (all points, ...), from those of this process (points, ...)."""
        whole = self._all_elements(self._by_element(values))
        return whole.reshape(self.mesh.weights.size, *values.shape[1:])

    def points_from_mesh(self, whole: Array) -> Array:
        """Return the values of this process from those at all quadrature points."""
        by_element = whole.reshape(*self.mesh.weights.shape, *whole.shape[1:])
        count = len(self.elements) * self.mesh.weights.shape[1]
        return by_element[self.elements].reshape(count, *whole.shape[1:])

    def means(self, values: Array) -> Array:
        """Return means over this process's elements (elements, ...) of values at its points (points, ...)."""
        return self.mesh.means(values, self.elements)

    def all_means(self, values: Array) -> Array:
        """Return the means over all elements, in the mesh's order and on every process."""
        return self._all_elements(self.means(values))

    def _all_elements(self, own: Array) -> Array:
        whole = np.zeros((len(self.mesh.cells), *own.shape[1:]))
        whole[self.elements] = own
        return np.asarray(self.communicator.sum(whole))

    def _by_element(self, values: Array) -> Array:
        return values.reshape(len(self.elements), self.mesh.weights.shape[1], *values.shape[1:])
