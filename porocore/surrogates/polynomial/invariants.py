"""Integrity basis: invariant polynomials of a point group in L = ln U.

The sum of a monomial over its images is invariant, and such sums span the invariant polynomials (Reynolds' operator).
Degree by degree those are kept that are no polynomial in the ones before. For the point groups of the cube there are
none of a degree above six (Smith & Rivlin 1958, Trans. Am. Math. Soc. 88, 175–193).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from porocore.core.tensors.point_group import PointGroup
from porocore.states import Array, IntArray
from porocore.surrogates.polynomial.monomials import exponents_up_to
from porocore.surrogates.symmetry import Action, Ties, on_one, on_variables

HIGHEST = 6
#: Polynomials are told apart by values at random points, modulo a prime so small that sums of products stay exact.
PRIME = 1_048_573

#: Coefficients by exponents of the six components of L.
Invariant = dict[tuple[int, ...], float]


@lru_cache(maxsize=64)
def integrity_basis(group: PointGroup) -> tuple[Invariant, ...]:
    """Return homogeneous polynomials in L, ascending in degree, in which every invariant one is a polynomial."""
    action = on_variables(group)
    on_L = Action(action.to[:, :6], action.sign[:, :6])
    found: list[Invariant] = []
    for degree in range(1, (HIGHEST if len(group) > 1 else 1) + 1):
        # The first of each orbit has the highest powers first, so that power sums come before mixed ones.
        exponents = exponents_up_to((1,) * 6, degree, degree)[::-1]
        ties = Ties.from_actions(exponents, on_L, on_one(group))
        sums = [
            {
                tuple(int(x) for x in exponents[k]): float(ties.sign[0, k])
                for k in np.flatnonzero(ties.number[0] == i)
            }
            for i in range(ties.count)
        ]
        points = np.random.default_rng(degree).integers(0, PRIME, (6, len(sums) + 8))
        values, known = [_values(f, points) for f in found], []
        if found:
            products = exponents_up_to(tuple(_degree(f) for f in found), degree, degree)
            known = [_product(values, e) for e in products]
        rows = np.array([*known, *(_values(f, points) for f in sums)]).reshape(-1, points.shape[1])
        found += [sums[k - len(known)] for k in independent(rows) if k >= len(known)]
    return tuple(found)


def independent(rows: Array | IntArray) -> list[int]:
    """Return the rows (m, n) of whole numbers that are no combination of earlier ones, modulo the prime."""
    echelon = np.empty((0, rows.shape[1]), dtype=np.int64)
    pivots: list[int] = []
    found = []
    for k, row in enumerate(rows.astype(np.int64) % PRIME):
        if len(pivots) == rows.shape[1]:
            break
        rest = (row - row[pivots] @ echelon) % PRIME
        columns = np.flatnonzero(rest)
        if not len(columns):
            continue
        pivot = int(columns[0])
        rest = rest * pow(int(rest[pivot]), -1, PRIME) % PRIME
        echelon = (echelon - echelon[:, pivot, None] * rest) % PRIME
        echelon = np.concatenate([echelon, rest[None]])
        pivots.append(pivot)
        found.append(k)
    return found


def _degree(polynomial: Invariant) -> int:
    return sum(next(iter(polynomial)))


def _values(polynomial: Invariant, points: IntArray) -> IntArray:
    total = np.zeros(points.shape[1], dtype=np.int64)
    for exponents, coefficient in polynomial.items():
        total += int(coefficient) * _product(list(points), np.array(exponents))
    return total % PRIME


def _product(factors: list[IntArray], exponents: IntArray) -> IntArray:
    value = np.ones(factors[0].shape, dtype=np.int64)
    for factor, exponent in zip(factors, exponents, strict=True):
        for _ in range(int(exponent)):
            value = value * factor % PRIME
    return value
