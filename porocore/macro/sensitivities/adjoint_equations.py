"""Transposed equations of one step (AdjointEquations): adjoint unknowns λ, and what they make of the weights."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from porocore.interfaces.law import MacroTangent
from porocore.macro.boundary.conditions import Loads
from porocore.macro.integration.discretisation import Discretisation, StepFailed
from porocore.macro.integration.newton import ROUND_OFF, largest_free
from porocore.macro.sensitivities.equations import CORRECTIONS, SMALL, TOO_LARGE
from porocore.macro.sensitivities.point_weights import PointWeights
from porocore.states import Array


@dataclass(frozen=True, eq=False)
class AdjointEquations:
    """Equations Jᵀ λ = −g of one step, with the tangent J at its solution.

    Attributes
    ----------
    d
        Discretisation.
    system
        The transposed tangent of all unknowns.
    tangent
        Of the law at the solution.
    x : (local unknowns,)
        The solution.
    dt, loads
        Of the step.
    still
        Loads that are zero.
    """

    d: Discretisation
    system: Any
    tangent: MacroTangent
    x: Array
    dt: float
    loads: Loads
    still: Loads

    def of_residual(self, rows: Array) -> PointWeights:
        """Return the weights of the response where the residual's values weigh ``rows`` (local unknowns,)."""
        tests, grad = self.d.states(rows)
        return PointWeights(tests.grad_u, tests.p, -self.dt * grad)

    def of_unknowns(self, states: PointWeights) -> Array:
        """Return the weights (local unknowns,), where owned, from those of H, p and ∇p at the points."""
        # A step of the length −1 has ∫ flux · ∇N.
        return self.d.residual(states, -1.0, self.still).values

    def following(self, rows: Array) -> Array:
        """Return the weights of the displacements by which follower pressures change the residual."""
        if self._follower is None:
            return np.zeros(len(rows))
        d, whole = self.d, np.zeros(self.d.mesh.size)
        whole[: d.mesh.n_u] = self._follower.T @ d.to_mesh(rows)[: d.mesh.n_u]
        return np.where(np.arange(len(rows)) < d.owned, d.from_mesh(whole), 0.0)

    @cached_property
    def _follower(self) -> sparse.csr_matrix | None:
        return self.d.follower_tangent(self.x, self.loads)

    def solved(self, weights: Array, *, again: bool) -> tuple[Array, PointWeights, Array]:
        """Return λ, the weights of the response by it, and the weights of the unknowns with it.

        The latter vanish in the equations; at prescribed unknowns they are the derivatives by their values.

        Parameters
        ----------
        weights : (local unknowns,)
            Weights g of the solution, where owned.
        again
            The transposed system has been solved with before.

        Raises
        ------
        StepFailed
            It has no solution.
        """
        d, still = self.d, np.zeros(len(self.d.prescribed))
        rows, total = np.zeros(len(d.unknowns)), weights
        at_points = PointWeights.zeros(d.n_points)
        misfit = np.inf
        for _ in range(1 + CORRECTIONS):
            rows = rows - d.solve(self.system, total, still, again=again)
            again = True
            at_points = self.of_residual(rows)
            total = weights + self.of_unknowns(at_points.of_states(self.tangent)) + self.following(rows)
            misfit = self._misfit(total, weights, rows)
            if misfit <= SMALL:
                break
        if not misfit <= TOO_LARGE:
            raise StepFailed(f"the linear solver leaves {misfit:.2g} of the right-hand side")
        return rows, at_points, total

    def _misfit(self, total: Array, weights: Array, rows: Array) -> float:
        """Return the largest weight that is left over those that met; zero where only round-off is left."""
        d = self.d
        left, given = largest_free(d, total), largest_free(d, weights)
        terms = largest_free(d, d.magnitudes(self.system, rows))
        return max(
            value / max(right, each) if value > ROUND_OFF * max(right, each) else 0.0
            for value, right, each in zip(left, given, terms, strict=True)
        )
