"""Polynomials fitted to values and gradients, degree by cross-validation, tied coefficients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from porocore.states import Array, IntArray
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.polynomial.terms import Terms
from porocore.surrogates.symmetry import Equivariance

#: Equations for each coefficient; with fewer, a bad fit need not show in its residual.
EQUATIONS_PER_TERM = 2
RIDGE = 1e-10
LARGEST_DEGREE = 12
FOLDS = 5


def held_out(n: int) -> list[npt.NDArray[np.bool_]]:
    """Return which of n states each fold of a cross-validation leaves out."""
    count = min(FOLDS, n)
    return [np.arange(n) % count == fold for fold in range(count)]


@dataclass(frozen=True, eq=False)
class RegressionData:
    """Data to be fitted, o quantities at n states.

    Attributes
    ----------
    y : (7, n)
        Variables.
    value : (o, n), gradients : (o, 7, n)
        Quantities and derivatives.
    value_scale : (o,), gradient_scale : (o, 7)
        Divisors of the errors; infinite for a derivative that is not fitted.
    """

    y: Array
    value: Array
    gradients: Array
    value_scale: Array
    gradient_scale: Array

    def subset(self, rows: IntArray) -> RegressionData:
        """Return the data of some states."""
        return RegressionData(
            self.y[:, rows],
            self.value[:, rows],
            self.gradients[:, :, rows],
            self.value_scale,
            self.gradient_scale,
        )

    @property
    def fitted(self) -> Array:
        """Derivatives that count, (7,) bool."""
        finite: Array = np.isfinite(self.gradient_scale).any(axis=0)
        return finite


@dataclass(frozen=True, eq=False)
class Fit:
    """Fitted polynomial in terms.

    Attributes
    ----------
    polynomial
        In the terms; o outputs.
    degree
        Largest weight of a monomial.
    errors
        Cross-validated error of each degree that was tried: root mean square of the scaled gradients' errors.
    """

    polynomial: Polynomial
    degree: int
    errors: dict[int, float]


def fit(
    samples: RegressionData,
    terms: Terms,
    lowest: int,
    *,
    degree: int | None = None,
    highest: int = LARGEST_DEGREE,
    tied: Equivariance | None = None,
) -> Fit:
    """Fit monomials of weight ``lowest`` … degree; without ``degree`` that of the smallest cross-validated error.

    With ``tied`` the polynomials have that symmetry exactly.

    No more monomials are tried than leave two equations for each. With too few equations for any, the
    polynomial is zero (degree ``lowest`` − 1).
    """
    n = samples.value.shape[1]
    equations = n * (1 + int(samples.fitted.sum()))
    degrees = [lowest - 1]
    for candidate in range(lowest, highest + 1):
        if len(terms.monomials(lowest, candidate)) * EQUATIONS_PER_TERM > equations:
            break
        degrees.append(candidate)
    if degree is not None:
        degrees = [degree] if degree in degrees else [degrees[-1]]
    errors: dict[int, float] = {}
    if len(degrees) > 1:
        for candidate in degrees:
            exponents = terms.monomials(lowest, candidate)
            if len(exponents) * EQUATIONS_PER_TERM > equations * (1 - 1 / FOLDS):
                break
            squares = 0.0
            for test in held_out(n):
                trained = _solve(samples.subset(np.flatnonzero(~test)), terms, exponents, tied)
                squares += _error(samples.subset(np.flatnonzero(test)), terms, trained)
            errors[candidate] = float(np.sqrt(squares / n))
        best = min(errors, key=lambda d: errors[d])
    else:
        best = degrees[0]
    return Fit(_solve(samples, terms, terms.monomials(lowest, best), tied), best, errors)


def _solve(
    samples: RegressionData, terms: Terms, exponents: IntArray, tied: Equivariance | None
) -> Polynomial:
    outputs = len(samples.value)
    if not len(exponents):
        return Polynomial(exponents, np.zeros((outputs, 0)))
    design = terms.design(exponents, samples.y)
    value, gradients = design[:, 0], design[:, 1:]
    equations = []
    for o in range(outputs):
        kept = np.isfinite(samples.gradient_scale[o])
        scale = samples.gradient_scale[o, kept][:, None]
        rows = np.concatenate(
            [value / samples.value_scale[o], (gradients[:, kept] / scale).reshape(len(exponents), -1)], axis=1
        ).T
        right = np.concatenate(
            [samples.value[o] / samples.value_scale[o], (samples.gradients[o, kept] / scale).ravel()]
        )
        equations.append((rows, right))
    return Polynomial(exponents, tied_least_squares(equations, exponents, tied))


def tied_least_squares(
    equations: list[tuple[Array, Array]], exponents: IntArray, tied: Equivariance | None
) -> Array:
    """Return the least-squares coefficients (o, K) of the monomials (K, v), with one system for each output.

    Parameters
    ----------
    equations
        Rows (m, K) and right-hand sides (m,).
    tied
        The symmetry that the polynomials have exactly; None: none.
    """
    if tied is None:
        return np.stack([least_squares(rows, right) for rows, right in equations])
    ties = tied.ties(exponents)
    coefficients = np.zeros((len(equations), len(exponents)))
    for together in tied.outputs.orbits():
        free = np.unique(ties.number[together])
        free = free[free >= 0]
        if not len(free):
            continue
        blocks = []
        for o in together:
            selection = np.zeros((len(exponents), len(free)))
            used = np.flatnonzero(ties.number[o] >= 0)
            selection[used, np.searchsorted(free, ties.number[o, used])] = ties.sign[o, used]
            blocks.append((equations[o][0] @ selection, selection))
        found = least_squares(
            np.concatenate([rows for rows, _ in blocks]),
            np.concatenate([equations[o][1] for o in together]),
        )
        for o, (_, selection) in zip(together, blocks, strict=True):
            coefficients[o] = selection @ found
    return coefficients


def least_squares(rows: Array, right: Array, ridge: float = RIDGE) -> Array:
    """Return the solution (K,) of equations (m, K), or (K, o) of several right-hand sides, columns of any size.

    A ridge, relative to the squares of the columns, keeps small what the equations do not tell.
    """
    size = np.sqrt((rows**2).sum(axis=0))
    size[size == 0] = 1.0
    # As further equations: columns that the samples do not move stay small.
    more = np.sqrt(ridge) * np.eye(len(size))
    nothing = np.zeros((len(size), *right.shape[1:]))
    solution = np.linalg.lstsq(
        np.concatenate([rows / size, more]), np.concatenate([right, nothing]), rcond=None
    )[0]
    found: Array = (solution.T / size).T
    return found


def _error(samples: RegressionData, terms: Terms, polynomial: Polynomial) -> float:
    """Return the sum over the states of the mean square of the scaled gradient errors."""
    t, J, _ = terms.polynomial.derivatives(samples.y, second=False)
    _, by_t, _ = polynomial.derivatives(t, second=False)
    wrong = np.einsum("otn,tan->oan", by_t, J) - samples.gradients
    counts = np.isfinite(samples.gradient_scale)
    scaled = np.where(counts[:, :, None], wrong / samples.gradient_scale[:, :, None], 0.0)
    return float((scaled**2).sum() / max(counts.sum(), 1))
