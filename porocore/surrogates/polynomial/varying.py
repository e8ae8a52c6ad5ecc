"""Polynomials in t whose coefficients are polynomials of coordinates of each point (VaryingPolynomial).

Coordinates change less often than t. They are bound first: points of a few sets of coordinates share the coefficients
of polynomials in t alone, others have coefficients of their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from math import factorial, prod

import numpy as np

from porocore.core.inputs import Coordinates, PointSets
from porocore.states import Array, IntArray
from porocore.surrogates.polynomial.monomials import (
    LARGEST_BLOCK,
    SMALLEST_BLOCK,
    Entry,
    Place,
    Polynomial,
    Rows,
    Term,
)

#: Numbers in a block of points with coefficients of their own.
BLOCK = 1 << 20
#: Coefficients of points are kept where they are at most so many times as many as the monomials of their coordinates;
#: more are made again faster than they are read.
MOST_KEPT = 8
#: Derivatives of several orders are one product where that has at most so many times as many entries.
STACKED = 2


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

    def at(self, coordinates: Coordinates, unit: Array | float = 1.0) -> BoundPolynomial:
        """Return the polynomials in t at the coordinates of points; see :class:`BoundPolynomial`."""
        return BoundPolynomial(self, coordinates, unit)

    def coefficients_at(self, x: Array) -> Array:
        """Return the coefficients (P, n) of those outputs and monomials t^e/e! that have any, at x (l, n)."""
        return self.from_monomials_of_x @ self.monomials_of_x.evaluate(x)

    @cached_property
    def monomials_of_t(self) -> Polynomial:
        """Monomials of t that occur."""
        return Polynomial.monomials(np.unique(self.polynomial.exponents[:, : self.inner], axis=0))

    @cached_property
    def inverse_factorials(self) -> Array:
        """Numbers 1/e! of the monomials of t and their divisors, (size,)."""
        return 1 / np.array([factorials(e) for e in self.monomials_of_t.basis], dtype=float)

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
    def monomials_of_x(self) -> Polynomial:
        """Monomials of x that occur."""
        return Polynomial.monomials(np.unique(self.polynomial.exponents[:, self.inner :], axis=0))

    @cached_property
    def from_monomials_of_x(self) -> Array:
        """Matrix (P, O) that turns the monomials of x into the coefficients of t^e/e!."""
        exponents = self.monomials_of_x.exponents
        outer = {e.tobytes(): i for i, e in enumerate(exponents)}
        pairs, inner = self._pairs
        number = {pair: i for i, pair in enumerate(pairs)}
        matrix = np.zeros((len(pairs), len(exponents)))
        for o, k in np.argwhere(self.polynomial.coefficients != 0):
            row, column = (
                number[int(o), int(inner[k])],
                outer[self.polynomial.exponents[k, self.inner :].tobytes()],
            )
            matrix[row, column] += self.polynomial.coefficients[o, k]
        return matrix * [[factorials(self.monomials_of_t.exponents[k])] for _, k in pairs]

    def rows_of_t(self, orders: tuple[int, ...], still: tuple[int, ...] = ()) -> list[Rows]:
        """Return the derivatives of some orders by t, together where that is no more work.

        Of monomials with a variable in ``still``, which is zero everywhere, nothing is left.
        """
        key = orders, still
        if key not in self._known_rows:
            apart = [Rows.from_entries(self._entries(order, still)) for order in orders]
            both = Rows.from_entries([row for order in orders for row in self._entries(order, still)])
            together = both.size <= STACKED * sum(rows.size for rows in apart)
            self._known_rows[key] = [both] if together else apart
        return self._known_rows[key]

    @cached_property
    def _known_rows(self) -> dict[tuple[tuple[int, ...], tuple[int, ...]], list[Rows]]:
        return {}

    def _entries(self, order: int, still: tuple[int, ...]) -> Iterator[tuple[Place, list[Term]]]:
        """Yield the place of each derivative of one order, and its terms."""
        exponents, basis = self.monomials_of_t.exponents, self.monomials_of_t.basis
        of_output: dict[int, list[tuple[int, int]]] = {}
        for p, (o, k) in enumerate(self._pairs[0]):
            of_output.setdefault(o, []).append((p, k))
        for by in combinations_with_replacement(range(self.inner), order):
            for o, pairs in of_output.items():
                found = []
                for p, k in pairs:
                    e = [int(x) for x in exponents[k]]
                    for a in by:
                        e[a] -= 1
                    if min(e, default=0) >= 0 and not any(e[a] for a in still):
                        found.append((p, basis[tuple(e)]))
                yield (o, *by), found


class BoundPolynomial:
    """A :class:`VaryingPolynomial` at the coordinates of n points, as a function of t.

    Parameters
    ----------
    whole
        The polynomial.
    coordinates
        Those of the points.
    unit : (n,)
        Numbers by which all is multiplied, the same where the coordinates are.
    """

    def __init__(self, whole: VaryingPolynomial, coordinates: Coordinates, unit: Array | float = 1.0) -> None:
        self.whole, self.coordinates = whole, coordinates
        self.unit = np.broadcast_to(unit, coordinates.x.shape[1])
        self.exponents = whole.monomials_of_t.exponents

    def take(self, points: IntArray) -> BoundPolynomial:
        """Return the polynomials of some of the points."""
        if self.coordinates.same:
            return self
        found = BoundPolynomial(self.whole, self.coordinates.take(points), self.unit[points])
        if self.coordinates.sets is not None:
            found.__dict__["_of_sets"], found.__dict__["_matrices"] = self._of_sets, self._matrices
        elif self._kept is not None:
            found.__dict__["_kept"] = self._kept[:, points]
        else:
            found.__dict__["_kept"], found.__dict__["_outer"] = None, self._outer[:, points]
        return found

    def entries(self, t: Array, *, second: bool = True) -> tuple[Array, list[Entry], list[Entry]]:
        """Return values (o, n) and derivatives by t that are not zero everywhere; see :meth:`Polynomial.entries`."""
        given, first, *pairs = self._derivatives(t, (0, 1, 2) if second else (0, 1))
        return self._filled(given, t.shape[1]), first, pairs[0] if second else []

    def evaluate(self, t: Array) -> Array:
        """Return the values (o, n) alone."""
        return self._filled(self._derivatives(t, (0,))[0], t.shape[1])

    def _filled(self, given: list[Entry], n: int) -> Array:
        values = np.zeros((len(self.whole.polynomial.coefficients), n))
        for (o,), row in given:
            values[o] = row
        return values

    def gradients(self, t: Array) -> list[Entry]:
        """Return the first derivatives by t alone that are not zero everywhere."""
        return self._derivatives(t, (1,))[0]

    def _derivatives(self, t: Array, orders: tuple[int, ...]) -> list[list[Entry]]:
        """Return the derivatives of some orders with their places."""
        sets = self.coordinates.sets
        if sets is None:
            still = tuple(int(a) for a in np.flatnonzero(~t.any(axis=1)))
            blocks = self.whole.rows_of_t(orders, still)
            out = self._each_point(t, blocks)
        elif sets.count == 1 or sets.in_order:
            blocks = self.whole.rows_of_t(orders)
            out = self._each_set(t, blocks, sets, orders)
        else:
            blocks = self.whole.rows_of_t(orders)
            out = [rows[:, sets.back] for rows in self._each_set(t[:, sets.order], blocks, sets, orders)]
        found: dict[int, list[Entry]] = {order: [] for order in orders}
        for rows, values in zip(blocks, out, strict=True):
            for place, row in zip(rows.places, values, strict=True):
                found[len(place) - 1].append((place, row))
        return list(found.values())

    def _each_set(
        self, t: Array, blocks: list[Rows], sets: PointSets, orders: tuple[int, ...]
    ) -> list[Array]:
        """Return the rows at points that come one set after the other."""
        out = [np.empty((len(rows.places), t.shape[1])) for rows in blocks]
        if orders not in self._matrices:
            factors = self.whole.inverse_factorials
            self._matrices[orders] = [
                rows.matrices(self._of_sets) * factors[: rows.columns] for rows in blocks
            ]
        most = max(LARGEST_BLOCK // max(len(self.whole.monomials_of_t.basis), 1), SMALLEST_BLOCK)
        for block in _parts(t.shape[1], most):
            monomials = self.whole.monomials_of_t.basis_at(t[:, block])
            for i, part in [(0, block)] if sets.count == 1 else sets.parts(block.start, block.stop):
                own = slice(part.start - block.start, part.stop - block.start)
                for rows, matrices, values in zip(blocks, self._matrices[orders], out, strict=True):
                    np.matmul(matrices[i], monomials[: rows.columns, own], out=values[:, part])
        return out

    def _each_point(self, t: Array, blocks: list[Rows]) -> list[Array]:
        """Return the rows at points that have coefficients of their own."""
        out = [np.empty((len(rows.places), t.shape[1])) for rows in blocks]
        most = max(BLOCK // max(len(self.whole._pairs[0]), 1), SMALLEST_BLOCK)
        for part in _parts(t.shape[1], most):
            monomials = self.whole.monomials_of_t.basis_at(t[:, part])
            monomials *= self.whole.inverse_factorials[:, None]
            coefficients = self._of_points(part)
            for rows, values in zip(blocks, out, strict=True):
                rows.fill(values[:, part], coefficients, monomials)
        return out

    def _of_points(self, points: slice) -> Array:
        """Return the coefficients (P, n) of some of the points that have their own."""
        if self._kept is not None:
            return self._kept[:, points]
        return self.whole.from_monomials_of_x @ self._outer[:, points]

    @cached_property
    def _kept(self) -> Array | None:
        """Coefficients (P, n) of all points; None where these are many more than the monomials of x in them."""
        P, O = self.whole.from_monomials_of_x.shape
        return self.whole.from_monomials_of_x @ self._outer if P <= MOST_KEPT * O else None

    @cached_property
    def _outer(self) -> Array:
        """Monomials of the coordinates at all points (O, n), times the unit."""
        return self.unit * self.whole.monomials_of_x.evaluate(self.coordinates.x)

    @cached_property
    def _of_sets(self) -> Array:
        """Coefficients (P, sets) of each set of coordinates."""
        x, sets = self.coordinates.x, self.coordinates.sets
        assert sets is not None
        if not x.shape[1]:
            return self.whole.coefficients_at(np.zeros((len(x), 1)))
        return self.unit[sets.first] * self.whole.coefficients_at(x[:, sets.first])

    @cached_property
    def _matrices(self) -> dict[tuple[int, ...], list[Array]]:
        """Rows of the derivatives of some orders for each set, (sets, rows, columns) each."""
        return {}


def _parts(n: int, most: int) -> Iterator[slice]:
    """Yield parts of n points, each of so many at most."""
    for start in range(0, n, most):
        yield slice(start, min(start + most, n))


def factorials(exponents: Sequence[int] | IntArray) -> int:
    """Return e! = Π e_a! of the exponents of a monomial."""
    return prod(factorial(int(e)) for e in exponents)
