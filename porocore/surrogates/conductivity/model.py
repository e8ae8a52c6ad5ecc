"""Conductivity model by ln U and p: prediction, flags near a closed pore, conducting directions.

K_ref = B exp(S) Bᵀ with S = ln(Bᵀ K₀ B) + a polynomial in (ln U, p) that begins at first order. So K_ref is K₀ at rest,
symmetric and positive definite for any coefficients, and objective, as it depends on F through U only. The columns of B
span the directions in which the pore space is open; closed directions stay closed under any deformation.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
import numpy.typing as npt

from porocore.core.inputs.sampled_range import SampledRange
from porocore.core.tensors.symmetric_functions import exponential, symmetric_exponential
from porocore.states import Array, MacroState
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.potential.data import variables
from porocore.surrogates.potential.training_box import TrainingBox
from porocore.surrogates.stretch.log_stretch import LogStretch

#: The pore is closed in directions in which it conducts less than this share of the largest conductivity.
CLOSED = 1e-6


@dataclass(frozen=True, eq=False)
class ConductivityModel:
    """Model of K_ref for any state.

    Attributes
    ----------
    basis : (3, r)
        B, orthonormal; the identity where the pores conduct in all directions.
    log_rest : (r, r)
        ln(Bᵀ K₀ B).
    polynomial
        Polynomial that is added to it, the upper triangle of a matrix in space (3, 3), row by row, in ``active``.
    active
        The variables that were sampled.
    training_box
        Box of the training states; beyond it the polynomial comes to rest.
    sampled
        Hull of the training states that have a conductivity.
    estimate
        Estimate of the errors of ln K_ref, which flags states; None: those beyond the hull are flagged.
    closing
        Some training states have no conductivity, since pore walls touch. No smooth function covers both kinds, so
        states beyond the hull are flagged whatever the estimate.
    """

    basis: Array
    log_rest: Array
    polynomial: Polynomial
    active: tuple[int, ...]
    training_box: TrainingBox
    sampled: SampledRange
    estimate: ErrorEstimate | None = None
    closing: bool = False

    def predict(self, states: MacroState, *, tangent: bool) -> tuple[Array, Array | None, Array | None]:
        """Return K_ref (n, 3, 3), NaN where det F ≤ 0, and if ``tangent`` its derivatives.

        These are ∂K_ref/∂H (n, 3, 3, 3, 3) and ∂K_ref/∂p (n, 3, 3).
        """
        stretch = LogStretch.from_gradient(states.grad_u)
        t = variables(stretch, states.p)[list(self.active)]
        missing = ~np.isfinite(t).all(axis=0)
        t[:, missing] = 0.0
        t, steepness = self._saturated(t)
        if not tangent:
            K = self._in_space(exponential(self._logarithm(self.polynomial.evaluate(t)) + self.log_rest))
            K[missing] = np.nan
            return K, None, None
        value, by_t, _ = self.polynomial.derivatives(t, second=False)
        gradients = np.stack(
            [self._logarithm(by_t[:, a] * steepness[a]) for a in range(len(self.active))], axis=1
        )
        E, dE = symmetric_exponential(self._logarithm(value) + self.log_rest, gradients)
        K, by_active = self._in_space(E), self._in_space(dE)
        n = len(K)
        by_L, by_p = np.zeros((n, 9, 6)), np.zeros((n, 3, 3))
        for a, variable in enumerate(self.active):
            if variable == 6:
                by_p = by_active[:, a]
            else:
                by_L[:, :, variable] = by_active[:, a].reshape(n, 9)
        by_H = (by_L @ stretch.gradient.swapaxes(1, 2)).reshape(n, 3, 3, 3, 3)
        for found in (K, by_H, by_p):
            found[missing] = np.nan
        return K, by_H, by_p

    def error(self, states: MacroState) -> Array:
        """Return the estimated error (n,) of ln K_ref, a share of its range; NaN without an estimate."""
        if self.estimate is None:
            return np.full(len(states), np.nan)
        t = self._variables(states)
        return self.estimate.error(t, self.beyond_rest(t))

    def outside(self, states: MacroState) -> npt.NDArray[np.bool_]:
        """Return which of n states are flagged: far from all that have a conductivity, or by the estimated error."""
        unrotated = self.sampled.inputs.without_rotation(states)
        if self.estimate is None:
            return self.sampled.outside(unrotated)
        strange = (self.sampled.outside if self.closing else self.sampled.far)(unrotated)
        t = self._variables(states)
        return strange | self.estimate.flagged(t, self.beyond_rest(t))

    def next_to_closed(self, states: MacroState) -> npt.NDArray[np.bool_]:
        """Return which of n states within all ranges are flagged since pores are closed in sampled states there."""
        inputs = self.sampled.inputs
        unrotated = inputs.without_rotation(states)
        unit = inputs.to_unit(inputs.gather(unrotated))
        near: npt.NDArray[np.bool_] = ((unit >= 0) & (unit <= 1)).all(axis=1) & self.closing
        return near & self.sampled.outside(unrotated)

    def beyond_rest(self, t: Array) -> Array:
        """Return the upper triangle (6, n) of ln K_ref less its value at rest, at t (d, n) of the active variables."""
        return self.polynomial.evaluate(self._saturated(t)[0])

    def _variables(self, states: MacroState) -> Array:
        """Return the active variables (d, n); NaN where det F ≤ 0."""
        t: Array = variables(LogStretch.from_gradient(states.grad_u), states.p)[list(self.active)]
        return t

    def _saturated(self, t: Array) -> tuple[Array, Array]:
        """Return t (d, n) saturated beyond the sampled box, and its derivative by t (d, n)."""
        saturated, steepness = t.copy(), np.ones_like(t)
        beyond = self.training_box.beyond_active(t)
        if len(beyond):
            saturated[:, beyond], steepness[:, beyond], _ = self.training_box.saturated_active(t[:, beyond])
        return saturated, steepness

    def _logarithm(self, components: Array) -> Array:
        """Return the symmetric (n, r, r) on the directions of B from the upper triangle (6, n) of a matrix in space."""
        S = np.empty((components.shape[1], 3, 3))
        for row, (i, j) in zip(components, triangle(3), strict=True):
            S[:, i, j] = S[:, j, i] = row
        found: Array = S if len(self.log_rest) == 3 else self.basis.T @ S @ self.basis
        return found

    def _in_space(self, E: Array) -> Array:
        space: Array = self.basis @ E @ self.basis.T
        return space


def triangle(r: int) -> list[tuple[int, int]]:
    """Return the places of the upper triangle of an r × r matrix, row by row."""
    return list(combinations_with_replacement(range(r), 2))


def conducting_basis(K: Array) -> Array:
    """Return orthonormal directions (3, r) in which K (3, 3) conducts; the identity for all three."""
    values, vectors = np.linalg.eigh((K + K.T) / 2)
    kept = values > CLOSED * max(float(values.max()), 0.0)
    basis: Array = np.eye(3) if kept.all() else vectors[:, kept]
    return basis
