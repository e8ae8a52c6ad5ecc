"""Polynomials in t whose coefficients are polynomials of coordinates of each point (VaryingPolynomial).

Coordinates change less often than t. They are bound first: points of a few sets of coordinates share the coefficients
of polynomials in t alone, others have coefficients of their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement, pairwise

import numpy as np

from porocore.states import Array, IntArray
from porocore.surrogates.polynomial.monomials import (
    LARGEST_BLOCK,
    SMALLEST_BLOCK,
    Entry,
    Place,
    Polynomial,
)

#: As many sets of coordinates are evaluated one after the other, if each has so many points.
MOST_SETS, LEAST_POINTS = 32, 16
#: Points of which many sets of coordinates are evaluated together.
BLOCK = 512


@dataclass(frozen=True, eq=False)
class Rows:
    """Derivatives of one order as rows over the basis of monomials: entries that are not zero everywhere.

    Attributes
    ----------
    places
        Output and variables of each row.
    ends
        Numbers of entries up to each row, from 0.
    coefficient, column : (entries,)
        Number of the coefficient and of the monomial in an entry.
    factor : (entries,)
        Product of exponents by which it is multiplied.
    columns
        Monomials that the rows use, the first of the basis.
    """

    places: list[Place]
    ends: list[int]
    coefficient: IntArray
    column: IntArray
    factor: Array
    columns: int

    def matrices(self, coefficients: Array) -> Array:
        """Return the rows (sets, rows, columns) for coefficients (P, sets)."""
        flat = np.repeat(np.arange(len(self.places)), np.diff(self.ends)) * self.columns + self.column
        found = np.zeros((coefficients.shape[1], len(self.places) * self.columns))
        found[:, flat] = (coefficients[self.coefficient] * self.factor[:, None]).T
        return found.reshape(len(found), len(self.places), self.columns)

    def fill(self, out: Array, coefficients: Array, monomials: Array) -> None:
        """Write the rows (rows, n) of points with coefficients (P, n) of their own into ``out``."""
        for row, (start, end) in enumerate(pairwise(self.ends)):
            factors = coefficients[self.coefficient[start:end]]
            factors *= self.factor[start:end, None]
            out[row] = np.einsum("pn,pn->n", factors, monomials[self.column[start:end]])


@dataclass(frozen=True, eq=False)
class VaryingPolynomial:
    """o polynomials in variables t and coordinates x.

    Attributes
    ----------
    polynomial
        In both together, t first.
    inner
        Number k of the variables t.
    """

    polynomial: Polynomial
    inner: int

    def at(self, x: Array, unit: Array | float = 1.0) -> BoundPolynomial:
        """Return the polynomials in t at the coordinates of points; see :class:`BoundPolynomial`."""
        return BoundPolynomial(self, x, unit)

    def coefficients_at(self, x: Array) -> Array:
        """Return the coefficients (P, n) in t of those outputs and monomials that have any, at x (l, n)."""
        return self._outer[1] @ self._outer[0].evaluate(x)

    @cached_property
    def monomials_of_t(self) -> Polynomial:
        """Monomials of t that occur."""
        return Polynomial.monomials(np.unique(self.polynomial.exponents[:, : self.inner], axis=0))

    @cached_property
    def _pairs(self) -> tuple[list[tuple[int, int]], IntArray]:
        """Output and monomial of t of each coefficient in t, and the number of the monomial of t of each of all."""
        exponents = self.monomials_of_t.exponents
        number = {e.tobytes(): i for i, e in enumerate(exponents)}
        of_all = np.array(
            [number[e[: self.inner].tobytes()] for e in self.polynomial.exponents], dtype=np.int64
        )
        used = np.argwhere(self.polynomial.coefficients != 0)
        return sorted({(int(o), int(of_all[k])) for o, k in used}), of_all

    @cached_property
    def _outer(self) -> tuple[Polynomial, Array]:
        """Monomials of x that occur, and the matrix that turns them into the coefficients in t."""
        outer, of_all = np.unique(self.polynomial.exponents[:, self.inner :], axis=0, return_inverse=True)
        pairs, inner = self._pairs
        number = {pair: i for i, pair in enumerate(pairs)}
        matrix = np.zeros((len(pairs), len(outer)))
        for o, k in np.argwhere(self.polynomial.coefficients != 0):
            matrix[number[int(o), int(inner[k])], of_all.reshape(-1)[k]] += self.polynomial.coefficients[o, k]
        return Polynomial.monomials(outer), matrix

    @cached_property
    def rows_of_t(self) -> tuple[Rows, Rows, Rows]:
        """Values, first and second derivatives by t."""
        v = range(self.inner)
        orders: list[list[tuple[int, ...]]] = [
            [()],
            [(a,) for a in v],
            list(combinations_with_replacement(v, 2)),
        ]
        values, first, second = (self._rows_of(wanted) for wanted in orders)
        return values, first, second

    def _rows_of(self, wanted: Sequence[tuple[int, ...]]) -> Rows:
        exponents, basis = self.monomials_of_t.exponents, self.monomials_of_t.basis
        places, ends, entries = [], [0], []
        for by in wanted:
            for o in range(len(self.polynomial.coefficients)):
                found = []
                for p, (output, k) in enumerate(self._pairs[0]):
                    e, factor = [int(x) for x in exponents[k]], 1
                    for a in by:
                        factor *= e[a]
                        e[a] -= 1
                    if output == o and factor:
                        found.append((p, basis[tuple(e)], factor))
                if found:
                    places.append((o, *by))
                    entries += found
                    ends.append(len(entries))
        table = np.array(entries, dtype=np.int64).reshape(-1, 3)
        columns = int(table[:, 1].max(initial=-1)) + 1
        return Rows(places, ends, table[:, 0], table[:, 1], table[:, 2].astype(float), columns)


class BoundPolynomial:
    """A :class:`VaryingPolynomial` at the coordinates of n points, as a function of t.

    Parameters
    ----------
    whole
        The polynomial.
    x : (l, n)
        Coordinates; (l, 1) where they are those of all points.
    unit : (n,)
        Numbers by which all is multiplied, the same where the coordinates are.
    """

    def __init__(self, whole: VaryingPolynomial, x: Array, unit: Array | float = 1.0) -> None:
        self.whole, self.x, self.unit = whole, x, np.broadcast_to(unit, x.shape[1])
        self.exponents = whole.monomials_of_t.exponents

    def take(self, points: IntArray) -> BoundPolynomial:
        """Return the polynomials of some of the points."""
        if self.x.shape[1] == 1:
            return self
        return BoundPolynomial(self.whole, self.x[:, points], self.unit[points])

    def entries(self, t: Array, *, second: bool = True) -> tuple[Array, list[Entry], list[Entry]]:
        """Return values (o, n) and derivatives by t that are not zero everywhere; see :meth:`Polynomial.entries`."""
        orders = self.whole.rows_of_t if second else self.whole.rows_of_t[:2]
        n, basis = t.shape[1], self.whole.monomials_of_t
        found = [np.empty((len(rows.places), n)) for rows in orders]
        if self._sets is None:
            for points in _blocks(slice(None), n, BLOCK):
                monomials, coefficients = basis.basis_at(t[:, points]), self._coefficients[:, points]
                for rows, out in zip(orders, found, strict=True):
                    rows.fill(out[:, points], coefficients, monomials)
        else:
            most = max(LARGEST_BLOCK // max(len(basis.basis), 1), SMALLEST_BLOCK)
            for i, own in enumerate(self._sets):
                for points in _blocks(own, n, most):
                    monomials = basis.basis_at(t[:, points])
                    for rows, matrices, out in zip(orders, self._matrices, found, strict=False):
                        out[:, points] = matrices[i] @ monomials[: rows.columns]
        values = np.zeros((len(self.whole.polynomial.coefficients), n))
        for (o,), row in zip(orders[0].places, found[0], strict=True):
            values[o] = row
        entries = [list(zip(rows.places, out, strict=True)) for rows, out in zip(orders, found, strict=True)]
        return values, entries[1], entries[2] if second else []

    @property
    def few(self) -> bool:
        """True where there are few sets of coordinates."""
        return self._sets is not None

    @cached_property
    def _sets(self) -> list[IntArray | slice] | None:
        """Points of each set of coordinates where these are few; None where they are many."""
        n = self.x.shape[1]
        if n == 0 or (self.x == self.x[:, :1]).all():
            return [slice(None)]
        # The first points tell most fields without a sort of all.
        if len(np.unique(self.x[:, : 4 * MOST_SETS], axis=1).T) > MOST_SETS:
            return None
        unique, number = np.unique(self.x, axis=1, return_inverse=True)
        if unique.shape[1] > min(MOST_SETS, n // LEAST_POINTS):
            return None
        return [np.flatnonzero(number.reshape(-1) == i) for i in range(unique.shape[1])]

    @cached_property
    def _coefficients(self) -> Array:
        """Coefficients (P, sets) of each set of coordinates, or (P, n) of each point."""
        if self._sets is None:
            return self.unit * self.whole.coefficients_at(self.x)
        if not self.x.shape[1]:
            return self.whole.coefficients_at(np.zeros((len(self.x), 1)))
        first = [0 if isinstance(points, slice) else points[0] for points in self._sets]
        return self.unit[first] * self.whole.coefficients_at(self.x[:, first])

    @cached_property
    def _matrices(self) -> list[Array]:
        """Rows of each order (sets, rows, columns)."""
        return [rows.matrices(self._coefficients) for rows in self.whole.rows_of_t]


def _blocks(points: IntArray | slice, n: int, most: int) -> Iterator[IntArray | slice]:
    """Yield parts of some of n points, each of so many at most."""
    count = n if isinstance(points, slice) else len(points)
    for start in range(0, count, most):
        part = slice(start, min(start + most, count))
        yield part if isinstance(points, slice) else points[part]
