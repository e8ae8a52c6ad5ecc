"""Least squares for polynomials in terms and coordinates, from values, first and second derivatives.

The degrees are those with the smallest cross-validated error. All of them share the equations of the largest, so that a
cross-validation costs one pass over the data and small linear systems.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.sparse import csr_array

from porocore.states import Array, IntArray
from porocore.surrogates.family.functions import EXACT_RIDGE
from porocore.surrogates.family.joint import design, joint_exponents
from porocore.surrogates.polynomial.least_squares import (
    EQUATIONS_PER_TERM,
    FOLDS,
    held_out,
    least_squares,
)
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.polynomial.terms import VARIABLES, Terms
from porocore.surrogates.symmetry import Equivariance

#: Degrees in the coordinates beyond what the total degree leaves that are tried.
MORE = (0, 1, 2)
#: Largest degree, and number of coefficients at most.
LARGEST_DEGREE, MOST_COEFFICIENTS = 8, 1500
#: Relative ridge of the normal equations of a cross-validation.
RIDGE = 1e-14
#: Derivatives that vary less than this share of the largest of their kind weigh no more.
SMALL = 1e-2
#: An output that stays below this share of the largest is not learned.
LEAST = 1e-6
#: Kinds of equations.
KINDS = ("value", "by_y", "by_x", "by_yy", "by_yx")


@dataclass(frozen=True, eq=False)
class JointData:
    """Data of o functions f(y, θ̂) at n states; NaN where something is not known.

    Attributes
    ----------
    y : (7, n), x : (l, n)
        Variables and coordinates.
    value : (o, n), by_y : (o, 7, n), by_x : (o, l, n)
        Values and first derivatives.
    by_yy : (o, 7, 7, n) or None, by_yx : (o, 7, l, n) or None
        Second derivatives.
    """

    y: Array
    x: Array
    value: Array
    by_y: Array
    by_x: Array
    by_yy: Array | None = None
    by_yx: Array | None = None


@dataclass(frozen=True)
class Weights:
    """Weights of the kinds of equations, each relative to the spread of its kind; 0 leaves one out."""

    value: float = 1.0
    by_y: float = 1.0
    by_x: float = 1.0
    by_yy: float = 0.3
    by_yx: float = 0.3


@dataclass(frozen=True, eq=False)
class JointFit:
    """Polynomials that were fitted, and their errors.

    Attributes
    ----------
    polynomial
        In the k terms and l coordinates, o outputs.
    degree, more
        Degree in y, and that in θ̂ which monomials of this degree may have.
    errors
        Cross-validated errors of what was tried: root mean squares of the scaled quantities that are judged.
    """

    polynomial: Polynomial
    degree: int
    more: int
    errors: dict[tuple[int, int], float]


@dataclass(frozen=True, eq=False)
class SharedEquations:
    """Equations of f free coefficients at n states, e for each state.

    Attributes
    ----------
    rows : (n, e, f), right : (n, e)
        Scaled equations.
    judged : (e,) bool
        Those whose error is cross-validated.
    weight, degree : (f,)
        Weight in the terms and degree in θ̂ of each coefficient.
    """

    rows: Array
    right: Array
    judged: npt.NDArray[np.bool_]
    weight: IntArray
    degree: IntArray

    def chosen(self, degree: int, more: int) -> npt.NDArray[np.bool_]:
        """Return the coefficients (f,) of a choice of degrees."""
        chosen: npt.NDArray[np.bool_] = (self.weight <= degree) & (self.degree <= degree - self.weight + more)
        return chosen

    def squares(self, choices: list[tuple[int, int]]) -> dict[tuple[int, int], float]:
        """Return for each choice the sum of the squared errors at states that were left out of a fit."""
        n = len(self.rows)
        size = np.sqrt((self.rows**2).sum(axis=(0, 1)))
        size[size == 0] = 1.0
        scaled = self.rows / size
        folds = held_out(n)
        parts = [_normal(scaled[fold], self.right[fold]) for fold in folds]
        gram, moment = sum(part[0] for part in parts), sum(part[1] for part in parts)
        found = dict.fromkeys(choices, 0.0)
        for fold, (A, b) in zip(folds, parts, strict=True):
            there, right = scaled[fold][:, self.judged], self.right[fold][:, self.judged]
            for choice in choices:
                kept = np.flatnonzero(self.chosen(*choice))
                matrix = (gram - A)[np.ix_(kept, kept)] + RIDGE * np.eye(len(kept)) * n
                try:
                    solution = cho_solve(cho_factor(matrix), (moment - b)[kept])
                except LinAlgError:
                    # The other states do not tell so many coefficients apart.
                    found[choice] = np.inf
                    continue
                found[choice] += float(((there[..., kept] @ solution - right) ** 2).sum())
        return found


def _normal(rows: Array, right: Array) -> tuple[Array, Array]:
    A = rows.reshape(-1, rows.shape[-1])
    return A.T @ A, A.T @ right.ravel()


def fit_joint(
    data: JointData,
    terms: Terms,
    lowest: int,
    *,
    tied: Equivariance,
    weights: Weights,
    judged: str = "by_y",
    choice: tuple[int, int] | None = None,
    highest: int = LARGEST_DEGREE,
) -> JointFit:
    """Fit monomials whose weight in the terms is from ``lowest`` to a degree.

    Parameters
    ----------
    tied
        The symmetry that the polynomials have exactly, in terms and coordinates.
    weights
        Weights of the kinds of equations.
    judged
        Kind of equations by whose error the degrees are chosen.
    choice
        Degree and ``more``; None: those of the smallest cross-validated error. The data may allow less.
    highest
        Largest degree that is tried.
    """
    l, o = len(data.x), len(data.value)
    scales = _scales(data, weights, tied)
    each = sum(int(np.isfinite(scale).sum()) for scale in scales.values())
    limit = min(each * data.y.shape[1] * (1 - 1 / FOLDS) / EQUATIONS_PER_TERM, MOST_COEFFICIENTS)
    tries: dict[tuple[int, int], IntArray] = {}
    for degree, more in [(d, m) for d in range(lowest, highest + 1) for m in (MORE if l else (0,))]:
        if choice is None or (degree <= choice[0] and more <= choice[1]):
            exponents = joint_exponents(terms, l, lowest, degree, more)
            if tied.ties(exponents).count <= limit:
                tries[degree, more] = exponents
    if not tries:
        return JointFit(Polynomial.zero(len(terms.weights) + l, o), lowest - 1, 0, {})
    every = np.unique(np.concatenate(list(tries.values())), axis=0)
    ties = tied.ties(every)
    systems = _systems(data, terms, every, scales, judged, tied)
    errors: dict[tuple[int, int], float] = {}
    best = max(tries)
    if choice is None and len(tries) > 1:
        for _, system in systems:
            for key, square in system.squares(list(tries)).items():
                errors[key] = errors.get(key, 0.0) + square
        count = sum(system.right[:, system.judged].size for _, system in systems)
        errors = {key: float(np.sqrt(square / count)) for key, square in errors.items()}
        best = min(errors, key=lambda key: errors[key])
    free = np.zeros(ties.count)
    for numbers, system in systems:
        kept = system.chosen(*best)
        rows = system.rows[..., kept].reshape(-1, int(kept.sum()))
        free[numbers[kept]] = least_squares(rows, system.right.ravel(), EXACT_RIDGE)
    coefficients = ties.coefficients(free)
    used = coefficients.any(axis=0)
    return JointFit(Polynomial(every[used], coefficients[:, used]), *best, errors)


def _scales(data: JointData, weights: Weights, tied: Equivariance) -> dict[str, Array]:
    """Return divisors of each kind of equation, (o, …); infinite where one is not known or does not count."""
    size = np.abs(data.value).max(axis=1)
    learned = size > LEAST * size.max(initial=0.0)
    found = {}
    for kind in KINDS:
        values, weight = getattr(data, kind), getattr(weights, kind)
        if values is None or weight == 0 or not values.size:
            continue
        known = np.isfinite(values).all(axis=-1)
        spread = np.where(known, np.nan_to_num(values).std(axis=-1), 0.0)
        for together in tied.outputs.orbits():
            # Outputs that the symmetry exchanges weigh the same.
            spread[together] = spread[together].max(axis=0)
            known[together] &= learned[together].any()
        spread = np.maximum(spread, SMALL * spread.max())
        if kind == "by_yy":
            # Both orders of a mixed derivative are one equation.
            known = known & np.triu(np.ones((VARIABLES, VARIABLES), dtype=bool))
        found[kind] = np.where(known & (spread > 0), spread / weight, np.inf)
    return found


def _systems(
    data: JointData,
    terms: Terms,
    exponents: IntArray,
    scales: dict[str, Array],
    judged: str,
    tied: Equivariance,
) -> list[tuple[IntArray, SharedEquations]]:
    """Return the equations of outputs that share coefficients, with the numbers of these."""
    second = "by_yy" in scales or "by_yx" in scales
    columns = design(terms, exponents, data.y, data.x, second=second)
    k = len(terms.weights)
    weight = exponents[:, :k] @ np.array(terms.weights, dtype=np.int64)
    degree = exponents[:, k:].sum(axis=1)
    ties = tied.ties(exponents)
    found = []
    for together in tied.outputs.orbits():
        numbers = np.unique(ties.number[together])
        numbers = numbers[numbers >= 0]
        if not len(numbers):
            continue
        rows, right, judges = [], [], []
        of_weight, of_degree = np.zeros((2, len(numbers)), dtype=np.int64)
        for o in together:
            used = np.flatnonzero(ties.number[o] >= 0)
            place = np.searchsorted(numbers, ties.number[o, used])
            of_weight[place], of_degree[place] = weight[used], degree[used]
            selection = csr_array((ties.sign[o, used], (place, used)), (len(numbers), len(exponents)))
            for kind, scale in scales.items():
                values = getattr(columns, kind)
                for at in np.argwhere(np.isfinite(scale[o])):
                    column = values[(slice(None), *at)]
                    if column.any():
                        rows.append((selection @ column).T / scale[(o, *at)])
                        right.append(getattr(data, kind)[(o, *at)] / scale[(o, *at)])
                        judges.append(kind == judged)
        system = np.stack(rows, axis=1), np.stack(right, axis=1), np.array(judges)
        found.append((numbers, SharedEquations(*system, of_weight, of_degree)))
    return found
