"""Polynomials in terms t(y) and coordinates θ̂ together: exponents, designs for fits, evaluation at any θ̂."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np

from porocore.core.inputs import Coordinates
from porocore.states import Array, IntArray
from porocore.surrogates.network.separable import FactoredNetwork
from porocore.surrogates.polynomial.composition import TermSum
from porocore.surrogates.polynomial.monomials import VARIABLES, Polynomial, Terms, exponents_up_to
from porocore.surrogates.polynomial.varying import BoundPolynomial, VaryingPolynomial

K = TypeVar("K")
V = TypeVar("V")


def joint_exponents(terms: Terms, l: int, lowest: int, degree: int, more: int) -> IntArray:
    """Return exponents (K, k + l) of monomials in k terms and l coordinates.

    A monomial of weight w in the terms, ``lowest`` ≤ w ≤ ``degree``, has at most the degree ``degree`` − w + ``more``
    in the coordinates.
    """
    found = []
    inner = terms.monomials(lowest, degree)
    weights = inner @ np.array(terms.weights, dtype=np.int64)
    for weight in range(lowest, degree + 1):
        of_terms = inner[weights == weight]
        outer = exponents_up_to((1,) * l, 0, degree - weight + more)
        found.append(
            np.concatenate(
                [np.repeat(of_terms, len(outer), axis=0), np.tile(outer, (len(of_terms), 1))], axis=1
            )
        )
    return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class MonomialDerivatives:
    """Values and derivatives of K monomials at n states.

    Attributes
    ----------
    value : (K, n), by_y : (K, 7, n), by_x : (K, l, n)
        Values, and derivatives by y and by θ̂.
    by_yy : (K, 7, 7, n), by_yx : (K, 7, l, n)
        Second derivatives; None where they are not wanted.
    """

    value: Array
    by_y: Array
    by_x: Array
    by_yy: Array | None = None
    by_yx: Array | None = None


def design(terms: Terms, exponents: IntArray, y: Array, x: Array, *, second: bool) -> MonomialDerivatives:
    """Return the monomials (K, k + l) at y (7, n) and θ̂ (l, n), with their second derivatives if ``second``."""
    t, J, curved = terms.polynomial.derivatives(y, second=second)
    k = len(t)
    value, first, twice = _monomials(exponents, np.concatenate([t, x]), second)
    by_y = np.einsum("tKn,tan->Kan", first[:k], J)
    by_x = np.ascontiguousarray(np.moveaxis(first[k:], 0, 1))
    if twice is None or curved is None:
        return MonomialDerivatives(value, by_y, by_x)
    by_yy = np.einsum("tsKn,tan,sbn->Kabn", twice[:k, :k], J, J, optimize=True)
    by_yy += np.einsum("tKn,tabn->Kabn", first[:k], curved)
    by_yx = np.einsum("tcKn,tan->Kacn", twice[:k, k:], J)
    return MonomialDerivatives(value, by_y, by_x, by_yy, by_yx)


def _monomials(exponents: IntArray, t: Array, second: bool) -> tuple[Array, Array, Array | None]:
    """Return monomials (K, n) at t (v, n), and their first (v, K, n) and second (v, v, K, n) derivatives."""
    v, (K, n) = len(t), (len(exponents), t.shape[1])
    powers = t ** np.arange(int(exponents.max(initial=0)) + 1)[:, None, None]
    e = exponents.T[:, :, None]
    factors = [
        np.stack([powers[np.maximum(exponents[:, a] - order, 0), a] for a in range(v)]) for order in range(3)
    ]
    factors[1], factors[2] = factors[1] * e, factors[2] * (e * (e - 1))
    value, first = factors[0].prod(axis=0), np.empty((v, K, n))
    for a in range(v):
        first[a] = factors[1][a] * np.delete(factors[0], a, axis=0).prod(axis=0)
    if not second:
        return value, first, None
    twice = np.empty((v, v, K, n))
    for a in range(v):
        others = np.delete(factors[0], a, axis=0)
        twice[a, a] = factors[2][a] * others.prod(axis=0)
        for b in range(a + 1, v):
            rest = np.delete(others, b - 1, axis=0).prod(axis=0)
            twice[a, b] = twice[b, a] = factors[1][a] * factors[1][b] * rest
    return value, first, twice


@dataclass(frozen=True, eq=False)
class JointPolynomial:
    """Polynomial R(t(y), θ̂) with one output.

    Attributes
    ----------
    terms
        t.
    polynomial
        In the k terms and l coordinates.
    """

    terms: Terms
    polynomial: Polynomial

    @property
    def _k(self) -> int:
        return len(self.terms.weights)

    @cached_property
    def by_terms(self) -> VaryingPolynomial:
        """The polynomial of the terms, whose coefficients depend on θ̂."""
        return VaryingPolynomial(self.polynomial, self._k)

    @cached_property
    def _with_slopes(self) -> VaryingPolynomial:
        """The polynomial and its derivatives by θ̂ beside one another, as polynomials of the terms."""
        places = [(), *((a,) for a in range(self._k, self.polynomial.variables))]
        return VaryingPolynomial(self.polynomial.differentiated(places), self._k)

    def _bound(self, x: Array) -> BoundPolynomial:
        return self._latest.of(x, lambda: self._with_slopes.at(Coordinates(x)))

    @cached_property
    def _latest(self) -> Latest[Array, BoundPolynomial]:
        return Latest()

    def by_coordinates(self, y: Array, x: Array) -> tuple[Array, Array, Array, Array]:
        """Return R (n,), ∂R/∂y (7, n), ∂R/∂θ̂ (l, n) and ∂²R/∂y∂θ̂ (7, l, n) at y (7, n) and θ̂ (l, n).

        θ̂ (l, 1) are those of all points.
        """
        n, l = y.shape[1], len(x)
        t, J, _ = self.terms.polynomial.derivatives(y, second=False)
        values, first, _ = self._bound(x).entries(t, second=False)
        by_y = np.zeros((1 + l, VARIABLES, n))
        for (o, i), row in first:
            by_y[o] += J[i] * row
        return values[0], by_y[0], values[1:], by_y[1:].swapaxes(0, 1)


def summed(one: Polynomial, other: Polynomial, factor: float = 1.0) -> Polynomial:
    """Return the sum of a polynomial and another one times a factor."""
    exponents = np.concatenate([one.exponents, other.exponents])
    coefficients = np.concatenate([one.coefficients, factor * other.coefficients], axis=1)
    every, number = np.unique(exponents, axis=0, return_inverse=True)
    total = np.zeros((len(every), len(coefficients)))
    np.add.at(total, number.reshape(-1), coefficients.T)
    return Polynomial(every, total.T.copy())


@dataclass(frozen=True, eq=False)
class BoundParts:
    """Parts of R at the θ̂ of n points, or of one for all.

    Attributes
    ----------
    terms
        Those of the polynomials.
    whole, coarse, fine
        Both polynomials as one, and each; None where there is none.
    network
        The network; None where there is none.
    """

    terms: Terms | None
    whole: BoundPolynomial | None
    coarse: BoundPolynomial | None
    fine: BoundPolynomial | None
    network: FactoredNetwork | None

    def take(self, points: IntArray) -> BoundParts:
        """Return the parts at some of the points."""
        parts = (self.whole, self.coarse, self.fine)
        whole, coarse, fine = (None if part is None else part.take(points) for part in parts)
        network = None if self.network is None else self.network.take(points)
        return BoundParts(self.terms, whole, coarse, fine, network)

    def start(
        self, y: Array, polynomial: BoundPolynomial | None, network: FactoredNetwork | None
    ) -> Callable[[Array, Array, Array], None]:
        """Start the evaluation of a polynomial and a network at y (7, n).

        The returned function adds both to a value (n,), a gradient (7, n) and a Hessian (7, 7, n), in place.
        """
        sums, rows = [], None
        if network is not None:
            own = network.whole.terms
            rows = self.terms.rows_of(own) if self.terms is not None and polynomial is not None else None
            if rows is None:
                count = len(own.weights)
                sums.append(TermSum(own, Polynomial.zero(count, 1), network, tuple(range(count))))
        if polynomial is not None and self.terms is not None:
            # Terms that both have are differentiated once.
            sums.append(TermSum(self.terms, polynomial, None if rows is None else network, rows or ()))
        pending = [each.start(y) for each in sums]

        def add(value: Array, gradient: Array, hessian: Array) -> None:
            for add_to in pending:
                add_to(value, gradient, hessian)

        return add


class Latest(Generic[K, V]):
    """Values of the last keys that were asked for, which are compared by identity."""

    def __init__(self, count: int = 4) -> None:
        self._count = count
        self._found: list[tuple[K, V]] = []

    def of(self, key: K, make: Callable[[], V]) -> V:
        """Return the value of a key; if it is not there, ``make`` returns it."""
        for known, value in self._found:
            if known is key:
                return value
        value = make()
        self._found = [(key, value), *self._found[: self._count - 1]]
        return value
