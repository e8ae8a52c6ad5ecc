"""Terms of the polynomials: plain variables, or combinations that a point group leaves unchanged.

The variables y are the six components of L = ln U (11, 22, 33, 23, 13, 12) and the pressure p.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from porocore.core.tensors.point_group import PointGroup
from porocore.states import Array, IntArray
from porocore.surrogates.polynomial.invariants import PRIME, Invariant, independent, integrity_basis
from porocore.surrogates.polynomial.monomials import Polynomial, exponents_up_to

#: Number of variables: six components of L, and p.
VARIABLES = 7


@dataclass(frozen=True, eq=False)
class Terms:
    """Set of terms t(y), each a polynomial with a weight, the degree that it counts as.

    Attributes
    ----------
    name
        ``plain`` or ``invariant``.
    polynomial
        y → t.
    weights
        One for each term.
    once
        Terms of which a monomial may hold one only: the states tell gradients in their direction, and no more.
    active
        Variables that states move. On them alone monomials of invariant terms are told apart.
    crosswise
        True if a monomial has to hold one of ``once``.
    """

    name: str
    polynomial: Polynomial
    weights: tuple[int, ...]
    once: tuple[int, ...] = ()
    active: tuple[int, ...] = tuple(range(VARIABLES))
    crosswise: bool = False

    def monomials(self, lowest: int, highest: int) -> IntArray:
        """Return the exponents (K, k) of all monomials of weight ``lowest`` … ``highest``, or a basis of them."""
        exponents = exponents_up_to(self.weights, lowest, highest)
        once = exponents[:, list(self.once)].sum(axis=1)
        kept: IntArray = exponents[once == 1 if self.crosswise else once <= 1]
        if self.name == "plain":
            return kept
        # p multiplies what L makes, so that it is enough to tell that apart.
        of_L = kept.copy()
        of_L[:, [k for k, e in enumerate(self.polynomial.coefficients) if self._is_pressure(k)]] = 0
        found = {row.tobytes() for weight in range(highest + 1) for row in _basis(self, weight)}
        basis: IntArray = kept[[row.tobytes() in found for row in of_L]]
        return basis

    def design(self, exponents: IntArray, y: Array) -> Array:
        """Return values and gradients by the variables y (7, n) of monomials (K, k), (K, 1 + 7, n)."""
        t, J, _ = self.polynomial.derivatives(y, second=False)
        value, by_t, _ = Polynomial.monomials(exponents).derivatives(t, second=False)
        return np.concatenate([value[:, None], np.einsum("ktn,tan->kan", by_t, J)], axis=1)

    def _is_pressure(self, row: int) -> bool:
        used = self.polynomial.coefficients[row] != 0
        return bool(self.polynomial.exponents[used, 6].any())

    @property
    def variables(self) -> tuple[int, ...]:
        """Indices of the variables y that ``plain`` terms are."""
        return tuple(int(np.argmax(e)) for e in self.polynomial.exponents)

    def rows_of(self, others: Terms) -> tuple[int, ...] | None:
        """Return the indices of the ``others`` among these terms; None if some are missing."""
        known = [_described(self.polynomial, row) for row in range(len(self.weights))]
        wanted = [_described(others.polynomial, row) for row in range(len(others.weights))]
        return tuple(known.index(w) for w in wanted) if all(w in known for w in wanted) else None

    def subset(self, rows: tuple[int, ...]) -> Terms:
        """Return some of the terms; ``plain`` ones are then fewer variables."""
        coefficients = self.polynomial.coefficients[list(rows)]
        used = coefficients.any(axis=0)
        return Terms(
            self.name,
            Polynomial(self.polynomial.exponents[used], coefficients[:, used]),
            tuple(self.weights[row] for row in rows),
            tuple(k for k, row in enumerate(rows) if row in self.once),
            self.active,
        )

    def across(self) -> Terms:
        """Return the terms with only those monomials that act across the variables that states move."""
        return replace(self, crosswise=True)


def plain(active: tuple[int, ...], still: tuple[int, ...] = ()) -> Terms:
    """Return the variables in ``active``, and those in ``still``, which no state moves, once in a monomial."""
    both = active + still
    return Terms(
        "plain",
        Polynomial(np.eye(VARIABLES, dtype=np.int64)[list(both)], np.eye(len(both))),
        (1,) * len(both),
        tuple(range(len(active), len(both))),
        active,
    )


@lru_cache(maxsize=64)
def invariant(group: PointGroup, active: tuple[int, ...] = tuple(range(VARIABLES))) -> Terms:
    """Return terms that no operation of a group changes, in which each invariant polynomial can be written; p last.

    For the cube, with s = (L_23², L_13², L_12²): ΣL_ii, ΣL_ii², Σs_i, ΣL_ii³, ΣL_ii s_i, L_23 L_13 L_12, ΣL_ii² s_i,
    Σs_i², ΣL_ii s_i² and p. Terms with neither a value nor a gradient where only the
    variables in ``active`` move are left out; those with a gradient only are in a monomial once.
    """
    pressure: Invariant = {(0, 0, 0, 0, 0, 0, 1): 1.0}
    every = [*({(*e, 0): c for e, c in f.items()} for f in integrity_basis(group)), pressure]
    still = [a for a in range(VARIABLES) if a not in active]
    order = [min(sum(e[a] for a in still) for e in f) for f in every]
    kept = [f for f, o in zip(every, order, strict=True) if o < 2]
    exponents = sorted({e for f in kept for e in f})
    return Terms(
        "invariant",
        Polynomial(np.array(exponents), np.array([[f.get(e, 0.0) for e in exponents] for f in kept])),
        tuple(sum(next(iter(f))) for f in kept),
        tuple(k for k, o in enumerate(o for o in order if o < 2) if o == 1),
        active,
    )


@lru_cache(maxsize=512)
def _basis(terms: Terms, weight: int) -> IntArray:
    """Return the independent monomials (K, k) of the terms without p, of one weight; each times any power of p too.

    Values, and gradients by the variables that no state moves, are compared at random points modulo a prime.
    """
    rows = [k for k in range(len(terms.weights)) if not terms._is_pressure(k)]
    found = exponents_up_to(tuple(terms.weights[k] for k in rows), weight, weight)
    exponents = np.zeros((len(found), len(terms.weights)), dtype=np.int64)
    exponents[:, rows] = found
    exponents = exponents[exponents[:, list(terms.once)].sum(axis=1) <= 1]
    still = [a for a in range(6) if a not in terms.active]
    if len(rows) <= 6 and not still:
        return np.asarray(exponents)
    points = np.zeros((VARIABLES, len(exponents) + 8))
    # So small that their sixth powers are exact.
    points[[a for a in range(6) if a in terms.active]] = np.random.default_rng(weight).integers(
        1, 100, (6 - len(still), points.shape[1])
    )
    value, gradients, _ = terms.polynomial.derivatives(points, second=False)
    numbers = [np.concatenate([value[k : k + 1], gradients[k, still]]).astype(np.int64) % PRIME for k in rows]
    table = np.array([_powers(numbers, e[rows]) for e in exponents]).reshape(len(exponents), -1)
    return np.asarray(exponents[independent(table)])


def _powers(numbers: list[IntArray], exponents: IntArray) -> IntArray:
    """Return the product of powers of numbers (1 + d, n), each a value with d derivatives, modulo the prime."""
    found = np.zeros_like(numbers[0])
    found[0] = 1
    for number, exponent in zip(numbers, exponents, strict=True):
        for _ in range(int(exponent)):
            gradients = found[0] * number[1:] + found[1:] * number[0]
            found = np.concatenate([found[:1] * number[:1], gradients]) % PRIME
    return found


def _described(polynomial: Polynomial, row: int) -> dict[tuple[int, ...], float]:
    pairs = zip(polynomial.exponents, polynomial.coefficients[row], strict=True)
    return {tuple(int(x) for x in e): float(c) for e, c in pairs if c}
