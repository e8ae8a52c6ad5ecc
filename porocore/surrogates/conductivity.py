"""Conductivity model by ln U and p: prediction, flags near a closed pore, fit, estimated error.

K_ref = B exp(S) Bᵀ with S = ln(Bᵀ K₀ B) + a polynomial in (ln U, p) that begins at first order. So K_ref is K₀ at rest,
symmetric and positive definite for any coefficients, and objective, as it depends on F through U only. The columns of B
span the directions in which the pore space is open; closed directions stay closed under any deformation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
import numpy.typing as npt

from porocore.core.inputs import SampledRange
from porocore.core.tensors import exponential, logarithm, symmetric_exponential
from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, IntArray, MacroState
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.error_estimate.fit import Equations, draw, estimate, monomials
from porocore.surrogates.polynomial.fit import EQUATIONS_PER_TERM, FOLDS, held_out, tied_least_squares
from porocore.surrogates.polynomial.monomials import Polynomial, plain
from porocore.surrogates.potential import STILL, TrainingBox, variables
from porocore.surrogates.stretch import LogStretch
from porocore.surrogates.symmetry import (
    Equivariance,
    on_one,
    on_places,
    on_triangle,
    on_variables,
    stabiliser,
)

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


#: A component whose range is smaller than this share of the tolerance cannot miss it.
SMALL = 0.1


def with_conductivity_error(
    model: ConductivityModel, t: Array, S: Array, tied: Equivariance, tolerance: float
) -> ConductivityModel:
    """Return the model with an estimate of the errors of ln K_ref.

    The polynomials of the estimate have the symmetry of the cell, as the model has it, so that each state counts for
    all its images. Errors are shares of the range of the component of ln K_ref that varies most.

    Parameters
    ----------
    model
        Without an estimate.
    t : (d, n)
        Active variables of the states that have a conductivity.
    S : (6, n)
        Upper triangle of ln K_ref less its value at rest there.
    tied
        The symmetry of S(t).
    tolerance
        Errors beyond it are flagged.
    """
    d, n = t.shape
    ranges = np.ptp(S, axis=1)
    spread = float(ranges.max()) or 1.0
    varies = ranges > SMALL * tolerance * spread
    # The symmetry ties other components to those that vary.
    learned = sorted(row for together in tied.outputs.orbits() if varies[together].any() for row in together)
    if not learned:
        return model
    ways = Equivariance(tied.variables, tied.outputs.on(learned))
    exponents = monomials(n * len(learned), (1,) * d, 1, count=lambda found: ways.ties(found).count)
    rows, degrees = _rows(exponents, ways, t)
    right = S[None, learned] / spread
    draws, nugget = draw(Equations(rows, right, degrees, np.ones(len(learned), dtype=bool)))
    coefficients = np.zeros((len(draws), 6, len(exponents)))
    ties = ways.ties(exponents)
    coefficients[:, learned] = [spread * ties.coefficients(free) for free in draws[:, 0]]
    members = Polynomial(exponents, coefficients.reshape(-1, len(exponents)))
    found = estimate(members, nugget, tolerance, np.full(6, spread), t, model.beyond_rest)
    return replace(model, estimate=found)


def _rows(exponents: IntArray, ways: Equivariance, t: Array) -> tuple[Array, IntArray]:
    """Return what each free coefficient brings to the components at t (d, n), (F, c, n), and its degree (F,)."""
    ties = ways.ties(exponents)
    values = Polynomial.monomials(exponents).evaluate(t)
    rows = np.zeros((ties.count, len(ties.number), t.shape[1]))
    degrees = np.zeros(ties.count, dtype=np.int64)
    for component, (numbers, signs) in enumerate(zip(ties.number, ties.sign, strict=True)):
        free = numbers >= 0
        np.add.at(rows[:, component], numbers[free], signs[free, None] * values[free])
        degrees[numbers[free]] = exponents[free].sum(axis=1)
    return rows, degrees


LARGEST_DEGREE = 6


def fit_conductivity(data: TrainingSet) -> tuple[ConductivityModel, float] | None:
    """Return a model of K_ref and its cross-validated error in ln K; None where the states hold no conductivity.

    The degree of the polynomial is the one with the smallest cross-validated error. It turns with the operations of the
    cell that lead from the sampled variables to no others: K_ref(Q F Qᵀ) = Q K_ref(F) Qᵀ.

    Raises
    ------
    DataError
        Too few states have a conductivity, or the undeformed cell has none.
    """
    found, rest = data.responses.conductivity, data.reference.conductivity
    if found is None or rest is None:
        return None
    # The error of a free mesh breaks the symmetry of the cell at rest.
    mean = on_places(data.symmetry).mean(on_one(data.symmetry), rest[0].reshape(9, 1)).reshape(3, 3)
    basis = conducting_basis(mean)
    r = basis.shape[1]
    if r == 0:
        raise DataError("the undeformed pore conducts in no direction, so there is no conductivity to learn")
    finite = data.responses.stable & np.isfinite(found).all(axis=(1, 2))
    S = np.full((len(found), r, r), np.nan)
    S[finite] = logarithm(basis.T @ found[finite] @ basis)
    kept = np.flatnonzero(np.isfinite(S).all(axis=(1, 2)))
    if len(kept) < 2:
        raise DataError(
            f"only {len(kept)} of {len(found)} stable states have a conductivity of the deformed pore; sample where "
            "no walls touch, or choose conductivity: piola"
        )
    log_rest = logarithm(basis.T @ mean @ basis)
    log_rest = (log_rest + log_rest.T) / 2
    states = data.states[kept]
    y = variables(LogStretch.from_gradient(states.grad_u), states.p)
    active = tuple(int(a) for a in np.flatnonzero(np.abs(y).max(axis=1) > STILL))
    change = basis @ (S[kept] - log_rest) @ basis.T
    change = np.stack([change[:, i, j] for i, j in triangle(3)])
    group = stabiliser(data.symmetry, active)
    tied = Equivariance(on_variables(group).on(list(active)), on_triangle(group))
    polynomial, error = _fit(y[list(active)], change, active, tied)
    model = ConductivityModel(
        basis,
        log_rest,
        polynomial,
        active,
        TrainingBox.from_states(y, active, data.symmetry),
        SampledRange.around(data.inputs, data.inputs.gather(states)),
        closing=len(kept) < int(data.responses.stable.sum()),
    )
    if data.tolerance is not None:
        model = with_conductivity_error(model, y[list(active)], change, tied, data.tolerance)
    return model, error


def _fit(t: Array, S: Array, active: tuple[int, ...], tied: Equivariance) -> tuple[Polynomial, float]:
    """Return the polynomial fitted to the upper triangle S (6, n) of ln K less its value at rest, and its error.

    The error is the cross-validated root mean square.
    """
    terms = plain(active)
    errors: dict[int, float] = {}
    for degree in range(1, LARGEST_DEGREE + 1):
        exponents = terms.monomials(1, degree)
        free = tied.ties(exponents).count
        if free * EQUATIONS_PER_TERM > S.size * (1 - 1 / FOLDS) and errors:
            break
        wrong = np.empty_like(S)
        for test in held_out(S.shape[1]):
            wrong[:, test] = _solve(t[:, ~test], S[:, ~test], exponents, tied).evaluate(t[:, test])
        errors[degree] = float(np.sqrt(((wrong - S) ** 2).mean()))
    best = min(errors, key=lambda degree: errors[degree])
    return _solve(t, S, terms.monomials(1, best), tied), errors[best]


def _solve(t: Array, S: Array, exponents: IntArray, tied: Equivariance) -> Polynomial:
    """Return the least-squares polynomial of the outputs S (6, n) at t (variables, n)."""
    rows = Polynomial.monomials(exponents).evaluate(t).T
    return Polynomial(exponents, tied_least_squares([(rows, right) for right in S], exponents, tied))
