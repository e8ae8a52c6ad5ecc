"""Functions of terms t(y), and their derivatives with respect to the variables y (7, n)."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from porocore.states import Array
from porocore.surrogates.monomials import IntArray, Polynomial
from porocore.surrogates.terms import VARIABLES, Terms

#: Up to this degree a polynomial in terms is multiplied out; beyond it has too many monomials.
LARGEST_EXPANSION = 6
#: Exponents are digits of one number.
_BASE = 16


class Composed:
    """A polynomial in terms as a function of y."""

    def __init__(self, terms: Terms, polynomial: Polynomial) -> None:
        self.terms, self.polynomial = terms, polynomial

    def __call__(self, y: Array) -> tuple[Array, Array, Array]:
        """Values (o, n), gradients (o, 7, n) and Hessians (o, 7, 7, n) at y (7, n)."""
        o, n = len(self.polynomial.coefficients), y.shape[1]
        value, gradient = np.zeros((o, n)), np.zeros((o, VARIABLES, n))
        hessian = np.zeros((o, VARIABLES, VARIABLES, n))
        self._add(y, value, gradient, hessian)
        return value, gradient, hessian

    def add_to(self, y: Array, value: Array, gradient: Array, hessian: Array) -> None:
        """Add a single polynomial to a value (n,), gradient (7, n) and Hessian (7, 7, n) in place."""
        self._add(y, value[None], gradient[None], hessian[None])

    def _add(self, y: Array, value: Array, gradient: Array, hessian: Array) -> None:
        if not len(self.polynomial.exponents):
            return
        if self._expanded is None:
            motion = Motion(self.terms, y)
            v, by_t, by_tt = self.polynomial.derivatives(motion.t)
            assert by_tt is not None
            value += v
            for o in range(len(v)):
                g, h = motion.pushed(by_t[o], by_tt[o])
                gradient[o] += g
                hessian[o] += h
            return
        polynomial, active = self._expanded
        v, slopes, curvatures = polynomial.entries(y[list(active)])
        value += v
        for (o, a), row in slopes:
            gradient[o, active[a]] += row
        for (o, a, b), row in curvatures:
            hessian[o, active[a], active[b]] += row
            if a != b:
                hessian[o, active[b], active[a]] += row

    @cached_property
    def _expanded(self) -> tuple[Polynomial, tuple[int, ...]] | None:
        """As a polynomial in those of y that occur, and which these are; None if it would be too long."""
        if self.terms.name == "plain":
            return self.polynomial, self.terms.variables
        if (self.polynomial.exponents @ np.array(self.terms.weights)).max() > LARGEST_EXPANSION:
            return None
        return expanded(self.terms, self.polynomial), tuple(range(VARIABLES))


class Motion:
    """Terms at y (7, n) with their derivatives, through which derivatives by t become derivatives by y.

    Attributes
    ----------
    t : (k, n)
        The terms.
    """

    def __init__(self, terms: Terms, y: Array) -> None:
        self.t, slopes, self._bends = terms.polynomial.entries(y)
        k, n = self.t.shape
        J = np.zeros((k, VARIABLES, n))
        for at, row in slopes:
            J[at] = row
        self._wide = np.ascontiguousarray(J.reshape(-1, n).T).reshape(n, k, VARIABLES)
        self._tall = np.ascontiguousarray(self._wide.swapaxes(1, 2))

    def pushed(self, by_t: Array, by_tt: Array) -> tuple[Array, Array]:
        """Gradient (7, n) and Hessian (7, 7, n) by y from those by t, (k, n) and (k, k, n)."""
        k, n = by_t.shape
        gradient = (self._tall @ np.ascontiguousarray(by_t.T)[:, :, None])[:, :, 0].T
        rows = np.ascontiguousarray(by_tt.reshape(k * k, n).T).reshape(n, k, k)
        bent = self._tall @ rows @ self._wide
        hessian = np.ascontiguousarray(bent.reshape(n, -1).T).reshape(VARIABLES, VARIABLES, n)
        for (term, a, b), row in self._bends:
            more = by_t[term] * row
            hessian[a, b] += more
            if a != b:
                hessian[b, a] += more
        return gradient, hessian


def expanded(terms: Terms, polynomial: Polynomial) -> Polynomial:
    """A polynomial in the terms, multiplied out to one in the seven variables."""
    digits = _BASE ** np.arange(VARIABLES)
    term_keys = terms.polynomial.exponents @ digits
    factors = [(term_keys[row != 0], row[row != 0]) for row in terms.polynomial.coefficients]
    known: dict[tuple[int, ...], tuple[IntArray, Array]] = {
        (0,) * len(factors): (np.zeros(1, dtype=np.int64), np.ones(1))
    }

    def product(e: tuple[int, ...]) -> tuple[IntArray, Array]:
        if e not in known:
            k = next(k for k in range(len(e)) if e[k])
            keys, values = product((*e[:k], e[k] - 1, *e[k + 1 :]))
            known[e] = _collected(
                (keys[:, None] + factors[k][0]).ravel(), (values[:, None] * factors[k][1]).ravel()
            )
        return known[e]

    parts = [product(tuple(int(x) for x in e)) for e in polynomial.exponents]
    all_keys = np.unique(np.concatenate([keys for keys, _ in parts]))
    coefficients = np.zeros((len(polynomial.coefficients), len(all_keys)))
    for (keys, values), column in zip(parts, polynomial.coefficients.T, strict=True):
        coefficients[:, np.searchsorted(all_keys, keys)] += column[:, None] * values
    return Polynomial(all_keys[:, None] // digits % _BASE, coefficients)


def _collected(keys: IntArray, values: Array) -> tuple[IntArray, Array]:
    """Equal monomials as one."""
    unique, where = np.unique(keys, return_inverse=True)
    sums = np.zeros(len(unique))
    np.add.at(sums, where.ravel(), values)
    return unique, sums
