"""Least-squares fit of the conductivity model to solved states, degree by cross-validation."""

from __future__ import annotations

import numpy as np

from porocore.core.inputs.sampled_range import SampledRange
from porocore.core.tensors.symmetric_functions import logarithm
from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, IntArray
from porocore.surrogates.conductivity.error import with_conductivity_error
from porocore.surrogates.conductivity.model import ConductivityModel, conducting_basis, triangle
from porocore.surrogates.polynomial.least_squares import (
    EQUATIONS_PER_TERM,
    FOLDS,
    held_out,
    tied_least_squares,
)
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.polynomial.terms import plain
from porocore.surrogates.potential.data import STILL, variables
from porocore.surrogates.potential.training_box import TrainingBox
from porocore.surrogates.stretch.log_stretch import LogStretch
from porocore.surrogates.symmetry import (
    Equivariance,
    on_one,
    on_places,
    on_triangle,
    on_variables,
    stabiliser,
)

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
