"""Linear equations of the sensitivities of one time step: right-hand sides, solutions and their corrections."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from porocore.interfaces.law import MacroResponse
from porocore.interfaces.law_changes import MemoryChanges, ResponseChanges
from porocore.macro.boundary.conditions import Loads
from porocore.macro.integration.discretisation import Discretisation, Residual, StepFailed
from porocore.macro.integration.linearisation import Linearisation
from porocore.macro.integration.newton import ROUND_OFF, largest_free, misfit_of
from porocore.states import Array

#: Relative residual of a solution that is small enough, one that is too large, and the corrections at most.
SMALL, TOO_LARGE, CORRECTIONS = 1e-10, 1e-7, 3


@dataclass(frozen=True, eq=False)
class UnknownChange:
    """Derivatives of stress (n, 3, 3), storage (n,) and flux (n, 3) at the points by one unknown."""

    stress: Array
    storage: Array
    flux: Array

    @classmethod
    def each(cls, changes: ResponseChanges) -> list[UnknownChange]:
        """Return those by each of k unknowns."""
        parts = (
            np.ascontiguousarray(np.moveaxis(part, -1, 0))
            for part in (changes.stress, changes.storage, changes.flux)
        )
        return [cls(*each) for each in zip(*parts, strict=True)]


def changes_at_points(d: Discretisation, x: list[Array]) -> tuple[Array, Array, Array]:
    """Return the changes of H (n, 3, 3, k), p (n, k) and ∇p (n, 3, k) under changes of the unknowns."""
    found = [d.states(each) for each in x]
    return (
        np.stack([states.grad_u for states, _ in found], axis=-1),
        np.stack([states.p for states, _ in found], axis=-1),
        np.stack([grad_p for _, grad_p in found], axis=-1),
    )


@dataclass(frozen=True, eq=False)
class StepEquations:
    """Equations J δx = −∂R of one step for k unknowns, with the tangent J at its solution.

    Attributes
    ----------
    d
        Discretisation.
    linear
        The tangent.
    response, fixed
        Of the law at the solution, with its tangent, and its derivatives at fixed (H, p, ∇p).
    x : (local unknowns,)
        The solution.
    dt, loads
        Of the step.
    own
        Changes of the loads, one for each unknown.
    """

    d: Discretisation
    linear: Linearisation
    response: MacroResponse
    fixed: ResponseChanges
    x: Array
    dt: float
    loads: Loads
    own: list[Loads]

    def solved(self) -> tuple[list[Array], list[UnknownChange], MemoryChanges, list[Array]]:
        """Return the derivatives of the unknowns, of what is integrated, of the memory, and of the residual.

        Raises
        ------
        StepFailed
            A system has no solution.
        """
        d = self.d
        x = [self._prescribed(own) for own in self.own]
        lifted = d.communicator.max(float(any(each.any() for each in x))) > 0
        parts = self._moved(x)[0] if lifted else UnknownChange.each(self.fixed)
        residuals = [self._residual(*each) for each in zip(parts, self.own, x, strict=True)]
        misfits, still = [np.inf] * len(x), np.zeros(len(d.prescribed))
        for _ in range(1 + CORRECTIONS):
            for j, misfit in enumerate(misfits):
                if misfit > SMALL:
                    x[j] = x[j] - d.solve(self.linear.system, residuals[j].values, still, again=True)
            parts, memory = self._moved(x)
            residuals = [self._residual(*each) for each in zip(parts, self.own, x, strict=True)]
            misfits = [self._misfit(*each) for each in zip(residuals, x, strict=True)]
            if max(misfits) <= SMALL:
                break
        if not max(misfits) <= TOO_LARGE:
            raise StepFailed(f"the linear solver leaves {max(misfits):.2g} of the right-hand side")
        return x, parts, memory, [residual.values for residual in residuals]

    def _prescribed(self, own: Loads) -> Array:
        """Return the changes of the prescribed unknowns, and zero elsewhere."""
        x = np.zeros(len(self.d.unknowns))
        x[self.d.prescribed] = own.values
        return x

    def _moved(self, x: list[Array]) -> tuple[list[UnknownChange], MemoryChanges]:
        """Return the total derivatives of what is integrated and of the memory where the unknowns change by ``x``."""
        assert self.response.tangent is not None
        total, memory = self.fixed.moved(self.response.tangent, *changes_at_points(self.d, x))
        return UnknownChange.each(total), memory

    def _misfit(self, residual: Residual, x: Array) -> float:
        """Return the largest residual over its scale; zero where only round-off is left, as of a rigid motion."""
        d, misfit = self.d, misfit_of(self.d, residual)
        if misfit <= SMALL:
            return misfit
        force, volume = largest_free(d, d.magnitudes(self.linear.system, x))
        return misfit_of(d, residual, (ROUND_OFF * force, ROUND_OFF * volume))

    @cached_property
    def _follower(self) -> sparse.csr_matrix | None:
        return self.d.follower_tangent(self.x, self.loads)

    def _residual(self, change: UnknownChange, own: Loads, x: Array) -> Residual:
        """Return the total derivative of the residual by one unknown, which is zero in the equations."""
        d, found, follower = self.d, self.d.residual(change, self.dt, own, self.x), self._follower
        if follower is None:
            return found
        whole = np.zeros(d.mesh.size)
        whole[: d.mesh.n_u] = follower @ d.to_mesh(x)[: d.mesh.n_u]
        moved = np.where(np.arange(len(d.unknowns)) < d.owned, d.from_mesh(whole), 0.0)
        return Residual(found.values + moved, found.force_scale, found.volume_scale)
