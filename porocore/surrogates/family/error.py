"""Error estimate of a family's potential, from the states that it was learned from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.states import IntArray
from porocore.surrogates.error_estimate.fit import HIGHEST, MOST_MONOMIALS, Equations, draw, estimate
from porocore.surrogates.family.fit import FamilyData, terms_of
from porocore.surrogates.family.joint import design, joint_exponents
from porocore.surrogates.family.model import FamilyModel
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.polynomial.terms import VARIABLES, Terms


def with_family_error(model: FamilyModel, data: FamilyData, tolerance: float | None) -> FamilyModel:
    """Return the model with an estimate of the errors of stress and fluid volume; as it is where none is asked for.

    What is judged are the derivatives of R by y, beyond the rest that is exact, as shares of the ranges of stress and
    fluid volume.
    """
    if tolerance is None:
        return model
    terms, joint = terms_of(data), data.potential
    l, n = joint.x.shape
    whole = _with_coordinates(terms, l)
    judged = tuple(int(a) for a in np.flatnonzero(terms.polynomial.exponents.any(axis=0)))
    ranges = np.ptp(data.stress, axis=1)
    ranges[:6] = ranges[:6].max()
    ranges[ranges == 0] = 1.0
    spread = ranges / float(np.sqrt((data.scale**2).mean()))
    exponents = _monomials(terms, l, n * (1 + len(judged) + l))
    columns = design(terms, exponents, joint.y, joint.x, second=False)
    by_value = joint.value.std() or 1.0
    slopes = np.isfinite(joint.by_x[0]).all(axis=1)
    by_x = np.maximum(np.nan_to_num(joint.by_x[0, slopes]).std(axis=1), 1e-3 * by_value)[:, None]
    scale = spread[list(judged), None]
    rows = [
        columns.value[:, None] / by_value,
        columns.by_y[:, list(judged)] / scale,
        columns.by_x[:, slopes] / by_x,
    ]
    right = [
        joint.value[:, None] / by_value,
        joint.by_y[:, list(judged)] / scale,
        joint.by_x[:, slopes] / by_x,
    ]
    k = len(terms.weights)
    degrees = exponents[:, :k] @ np.array(terms.weights, dtype=np.int64) + exponents[:, k:].sum(axis=1)
    count = np.cumsum([1, len(judged), int(slopes.sum())])
    is_judged = (np.arange(count[-1]) >= count[0]) & (np.arange(count[-1]) < count[1])
    equations = Equations(np.concatenate(rows, axis=1), np.concatenate(right, axis=1), degrees, is_judged)
    coefficients, nugget = draw(equations)
    found = estimate(
        Polynomial(exponents, coefficients.reshape(-1, len(exponents))),
        nugget,
        tolerance,
        spread[list(judged)],
        np.concatenate([joint.y, joint.x]),
        lambda z: model.beyond_rest(z[:VARIABLES], z[VARIABLES:])[1][list(judged)],
        terms=whole,
        judged=judged,
        active=(*data.active, *range(VARIABLES, VARIABLES + l)),
    )
    return replace(model, estimate=replace(found, coordinates=l))


def _with_coordinates(terms: Terms, l: int) -> Polynomial:
    """Return the polynomial (y, θ̂) → (t, θ̂)."""
    k, K = terms.polynomial.coefficients.shape
    exponents = np.zeros((K + l, VARIABLES + l), dtype=np.int64)
    exponents[:K, :VARIABLES] = terms.polynomial.exponents
    exponents[K:, VARIABLES:] = np.eye(l, dtype=np.int64)
    coefficients = np.zeros((k + l, K + l))
    coefficients[:k, :K], coefficients[k:, K:] = terms.polynomial.coefficients, np.eye(l)
    return Polynomial(exponents, coefficients)


def _monomials(terms: Terms, l: int, equations: int) -> IntArray:
    """Return monomials of as high a degree as two coefficients for each equation allow."""
    found = joint_exponents(terms, l, 3, 3, 1)
    for degree in range(4, HIGHEST + 1):
        more = joint_exponents(terms, l, 3, degree, 1)
        if len(more) > min(MOST_MONOMIALS, 2 * equations):
            break
        found = more
    return found
