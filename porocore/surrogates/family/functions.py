"""Smooth functions of the parameters: polynomials fitted to values and slopes, degree by cross-validation."""

from __future__ import annotations

import numpy as np

from porocore.states import Array, IntArray
from porocore.surrogates.polynomial.least_squares import (
    FOLDS,
    held_out,
    least_squares,
)
from porocore.surrogates.polynomial.monomials import Polynomial, exponents_up_to

LARGEST_DEGREE = 8
#: Relative ridge for data without noise: a larger one would be seen in the fit.
EXACT_RIDGE = 1e-15
#: Equations for each coefficient: members are solved exactly, so that hardly more than one is enough.
LEAST_EQUATIONS = 1.25
#: Outputs that vary less than this share of the largest weigh no more.
SMALL = 1e-3


def fit_functions(x: Array, values: Array, slopes: Array | None) -> Polynomial:
    """Return polynomials of coordinates.

    Parameters
    ----------
    x : (l, k)
        Coordinates, about [−1, 1], of k points.
    values : (o, k)
        Values of o functions there.
    slopes : (o, l, k) or None
        Their derivatives by the coordinates; NaN where one is not known.
    """
    l, k = x.shape
    size = values.std(axis=1)
    size = np.maximum(size, SMALL * size.max(initial=0.0))
    size[size == 0] = 1.0
    values = values / size[:, None]
    known = slopes is not None and bool(np.isfinite(slopes).all()) and l > 0
    gradients = (
        slopes / size[:, None, None] if known and slopes is not None else np.zeros((len(values), 0, k))
    )
    rows_each = 1 + gradients.shape[1]
    errors: dict[int, float] = {}
    for degree in range(LARGEST_DEGREE + 1):
        exponents = exponents_up_to((1,) * l, 0, degree)
        if errors and len(exponents) * LEAST_EQUATIONS > k * rows_each * (1 - 1 / FOLDS):
            break
        squares = 0.0
        for test in held_out(k):
            found = _solve(x[:, ~test], values[:, ~test], gradients[:, :, ~test], exponents)
            squares += float(((found.evaluate(x[:, test]) - values[:, test]) ** 2).sum())
        errors[degree] = squares
        if l == 0:
            break
    best = min(errors, key=lambda degree: errors[degree])
    found = _solve(x, values, gradients, exponents_up_to((1,) * l, 0, best))
    return Polynomial(found.exponents, found.coefficients * size[:, None])


def _solve(x: Array, values: Array, gradients: Array, exponents: IntArray) -> Polynomial:
    value, slopes, _ = Polynomial.monomials(exponents).derivatives(x, second=False)
    rows = [value, *(slopes[:, a] for a in range(gradients.shape[1]))]
    right = [values, *(gradients[:, a] for a in range(gradients.shape[1]))]
    system, sides = np.concatenate(rows, axis=1).T, np.concatenate(right, axis=1)
    return Polynomial(exponents, least_squares(system, sides.T, EXACT_RIDGE).T.copy())
