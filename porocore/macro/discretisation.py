"""What the time loop needs of a backend: states at quadrature points, residuals, and linear solves.

A process holds *local* unknowns: first those that it owns, then copies of others that its elements touch. A
backend that does not distribute owns all. Vectors here are numpy arrays over the local unknowns.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.laws import MacroResponse, MacroTangent
from porocore.macro.boundary import BoundaryData
from porocore.macro.mesh import POINTS, BoxMesh
from porocore.parallel import World
from porocore.states import Array, IntArray, MacroState


class StepFailed(Exception):
    """Newton's iteration did not arrive; the time stepping shortens the step."""


@dataclass(frozen=True, eq=False)
class Residual:
    """Out of balance forces and volumes, and what they are to be compared with.

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


class Discretisation(ABC):
    """The u–p problem on a mesh, as far as it does not change from one iteration to the next.

    Parameters
    ----------
    mesh, boundary
        From the core.
    unknowns : (local unknowns,)
        Number of each in the mesh's order.
    owned
        How many of them, from the first, belong to this process.
    elements : (local elements,)
        Number of each in the mesh's order; an element belongs to one process.
    dofs : (local elements, 81 + 8)
        Local unknowns of each element in the order of :meth:`contributions`.
    world
        The processes.

    Attributes
    ----------
    prescribed, values : (k,)
        Local unknowns that are prescribed, and their values under a load of 1.
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
    """

    def __init__(
        self,
        mesh: BoxMesh,
        boundary: BoundaryData,
        *,
        unknowns: IntArray,
        owned: int,
        elements: IntArray,
        dofs: IntArray,
        world: World | None = None,
    ) -> None:
        self.mesh, self.problem = mesh, mesh.problem
        self.world = World() if world is None else world
        self.unknowns, self.owned, self.elements, self.dofs = unknowns, owned, elements, dofs
        self.is_force = unknowns < mesh.n_u
        everywhere = np.full(mesh.size, np.nan)
        everywhere[boundary.prescribed] = boundary.values
        is_free = np.isnan(everywhere[unknowns])
        self.free = np.flatnonzero(is_free[:owned])
        self.prescribed = np.flatnonzero(~is_free)
        self.values = everywhere[unknowns[self.prescribed]]
        self.plates = tuple(np.flatnonzero(np.isin(unknowns[self.free], plate)) for plate in boundary.plates)
        self.leading = np.ones(len(self.free), bool)
        for places, plate in zip(self.plates, boundary.plates, strict=True):
            self.leading[places] = unknowns[self.free[places]] == plate[0]
        self._external = np.where(np.arange(len(unknowns)) < owned, boundary.external[unknowns], 0.0)
        #: ∫ q̄ dS over the body under a load of 1.
        self.outflow = float(boundary.external[mesh.n_u :].sum())
        self.weights = np.tile(mesh.weights, len(elements))
        self.stretch = mesh.stretch

    @property
    def n_points(self) -> int:
        """Quadrature points of this process."""
        return POINTS * len(self.elements)

    @abstractmethod
    def states(self, x: Array) -> tuple[MacroState, Array]:
        """H, p and ∇p (points, 3) at the quadrature points, by element and then in the mesh's order."""

    @abstractmethod
    def contributions(self, response: MacroResponse) -> tuple[Array, Array, Array]:
        """∫ P_E:∇N (elements, 81), ∫ Δstorage N and ∫ q·∇N (elements, 8), not yet summed over elements."""

    @abstractmethod
    def system(self, tangent: MacroTangent, dt: float) -> Any:
        """The derivative of the residual by all unknowns, as the other methods want it."""

    @abstractmethod
    def magnitudes(self, system: Any, x: Array) -> Array:
        """|A| |x| in the rows of the free unknowns; those of a plate may stand in the first of its rows."""

    @abstractmethod
    def solve(self, system: Any, right: Array, jump: Array) -> Array:
        """The d with A d = ``right`` in the equations and d = ``jump`` in the prescribed unknowns.

        The unknowns of a plate change alike.

        Raises
        ------
        StepFailed
            The matrix is singular, or an iterative solver does not converge.
        """

    def add_copies(self, values: Array) -> Array:
        """Add the entries of copies to those of their owners; a backend that distributes overrides this."""
        return values

    def residual(self, response: MacroResponse, dt: float, factor: float) -> Residual:
        """With the load at ``factor`` (load × ramp)."""
        forces, stored, moved = self.contributions(response)
        moved = -dt * moved
        external = np.where(self.is_force, factor, dt * factor) * self._external
        values = self._gather(forces, stored + moved) + external
        scales = self._gather(np.abs(forces), np.abs(stored) + np.abs(moved)) + np.abs(external)
        own = np.arange(len(scales)) < self.owned
        force_scale, volume_scale = (
            self.world.largest(float(scales[rows & own].max(initial=0.0)))
            for rows in (self.is_force, ~self.is_force)
        )
        return Residual(values, force_scale, volume_scale)

    def equations(self, values: Array) -> Array:
        """From values in the rows of all local unknowns those of the equations of this process, (leading,).

        The equation of a plate is the sum over its unknowns, wherever they are.
        """
        values = values[self.free].copy()
        for places in self.plates:
            total = self.world.total(float(values[places].sum()))
            values[places[self.leading[places]]] = total
        found: Array = values[self.leading]
        return found

    def _gather(self, forces: Array, volumes: Array) -> Array:
        blocks = np.concatenate([forces, volumes], axis=1)
        return self.add_copies(
            np.bincount(self.dofs.ravel(), blocks.ravel(), minlength=len(self.unknowns)).astype(float)
        )

    def to_mesh(self, x: Array) -> Array:
        """(mesh.size,) all unknowns in the mesh's order, on every process."""
        whole = np.zeros(self.mesh.size)
        whole[self.unknowns[: self.owned]] = x[: self.owned]
        return np.asarray(self.world.total(whole))

    def from_mesh(self, whole: Array) -> Array:
        """The local unknowns from all."""
        return whole[self.unknowns]

    def points_to_mesh(self, values: Array) -> Array:
        """Values at all quadrature points (all points, ...), from those of this process (points, ...)."""
        whole = np.zeros((len(self.mesh.cells), POINTS, *values.shape[1:]))
        whole[self.elements] = values.reshape(len(self.elements), POINTS, *values.shape[1:])
        return np.asarray(self.world.total(whole)).reshape(-1, *values.shape[1:])

    def points_from_mesh(self, whole: Array) -> Array:
        """Those of this process from values at all quadrature points."""
        by_element = whole.reshape(len(self.mesh.cells), POINTS, *whole.shape[1:])
        return by_element[self.elements].reshape(-1, *whole.shape[1:])

    def means(self, values: Array) -> Array:
        """Means over the elements of this process (elements, ...) of values at its points (points, ...)."""
        weights = self.mesh.weights
        values = values.reshape(len(self.elements), POINTS, *values.shape[1:])
        return np.asarray(np.einsum("q,eq...->e...", weights / weights.sum(), values))

    def all_means(self, values: Array) -> Array:
        """The same over all elements, in the mesh's order and on every process."""
        means = self.means(values)
        whole = np.zeros((len(self.mesh.cells), *means.shape[1:]))
        whole[self.elements] = means
        return np.asarray(self.world.total(whole))
