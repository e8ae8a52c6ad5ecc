"""Polynomials of several variables and their derivatives; invariants of a point group.

The sum of a monomial over its images is invariant, and such sums span the invariant polynomials (Reynolds' operator).
Degree by degree those are kept that are no polynomial in the ones before. For the point groups of the cube there are
none of a degree above six (Smith & Rivlin 1958, Trans. Am. Math. Soc. 88, 175–193).

The variables y are the six components of L = ln U (11, 22, 33, 23, 13, 12) and the pressure p.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import combinations_with_replacement

import numpy as np

from porocore.core.tensors import PointGroup
from porocore.states import Array, IntArray
from porocore.surrogates.symmetry import Action, Ties, on_one, on_variables

#: Numbers in a block of states, which stay in the processor's cache, and least states in a block.
LARGEST_BLOCK, SMALLEST_BLOCK = 200_000, 256
#: Output and variables of a derivative; and with its values (n,).
Place = tuple[int, ...]
Entry = tuple[Place, Array]


def exponents_up_to(weights: tuple[int, ...], lowest: int, highest: int) -> IntArray:
    """Return all exponents (K, v) with a total weight from ``lowest`` to ``highest``, ascending in weight."""
    found: list[tuple[int, ...]] = [()]
    for weight in weights:
        found = [
            (*head, e)
            for head in found
            for e in range((highest - sum(a * b for a, b in zip(head, weights, strict=False))) // weight + 1)
        ]
    total = [sum(a * b for a, b in zip(e, weights, strict=True)) for e in found]
    kept = sorted((t, e) for t, e in zip(total, found, strict=True) if lowest <= t <= highest)
    return np.array([e for _, e in kept], dtype=np.int64).reshape(len(kept), len(weights))


@dataclass(frozen=True, eq=False)
class Polynomial:
    """o polynomials in v variables, Σ_k c_ok Π_a t_a^e_ka.

    Attributes
    ----------
    exponents : (K, v) int
        e.
    coefficients : (o, K)
        c.
    """

    exponents: IntArray
    coefficients: Array

    @classmethod
    def monomials(cls, exponents: IntArray) -> Polynomial:
        """Return the monomials (K, v) themselves, one output for each."""
        return cls(exponents, np.eye(len(exponents)))

    @classmethod
    def zero(cls, variables: int, outputs: int) -> Polynomial:
        """Return the polynomials without monomials."""
        return cls(np.zeros((0, variables), dtype=np.int64), np.zeros((outputs, 0)))

    @property
    def variables(self) -> int:
        """Number of variables v."""
        return int(self.exponents.shape[1])

    def evaluate(self, t: Array) -> Array:
        """Return values (o, n) at t (v, n)."""
        values: Array = self._rows[0] @ self.basis_at(t)
        return values

    def derivatives(self, t: Array, *, second: bool = True) -> tuple[Array, Array, Array | None]:
        """Return values (o, n), gradients (o, v, n) and Hessians (o, v, v, n) at t (v, n)."""
        o, v, n = len(self.coefficients), self.variables, t.shape[1]
        values, gradients, hessians = self.entries(t, second=second)
        gradient = np.zeros((o, v, n))
        for at, row in gradients:
            gradient[at] = row
        if not second:
            return values, gradient, None
        hessian = np.zeros((o, v, v, n))
        for (i, a, b), row in hessians:
            hessian[i, a, b] = row
            hessian[i, b, a] = row
        return values, gradient, hessian

    def entries(self, t: Array, *, second: bool = True) -> tuple[Array, list[Entry], list[Entry]]:
        """Return values (o, n) and the derivatives that are not zero everywhere.

        As pairs ((output, a), (n,)) and ((output, a, b), (n,)), a ≤ b.
        """
        value, (by_one, first), (by_two, pairs) = self._rows
        used = self._used
        n, outputs = t.shape[1], len(used)
        count = outputs + len(first) + (len(pairs) if second else 0)
        out = np.empty((count, n))
        block = max(LARGEST_BLOCK // max(value.shape[1], 1), SMALLEST_BLOCK)
        buffer = np.empty((value.shape[1], min(block, n)))
        for start in range(0, n, block):
            columns = slice(start, min(start + block, n))
            monomials = self.basis_at(t[:, columns], buffer)
            np.matmul(value[used], monomials, out=out[:outputs, columns])
            at = outputs
            for rows in (by_one, by_two) if second else (by_one,):
                np.matmul(rows, monomials[: rows.shape[1]], out=out[at : at + len(rows), columns])
                at += len(rows)
        after = outputs + len(first)
        values = out[:outputs]
        if outputs < len(value):
            values = np.zeros((len(value), n))
            values[used] = out[:outputs]
        return (
            values,
            list(zip(first, out[outputs:after], strict=True)),
            list(zip(pairs, out[after:], strict=True)) if second else [],
        )

    def differentiated(self, by: Sequence[tuple[int, ...]]) -> Polynomial:
        """Return the derivatives by some variables as polynomials, those of all outputs for each of ``by``."""
        order, _ = self._basis
        rows = np.zeros((len(by), len(self.coefficients), len(order)))
        for row, variables in zip(rows, by, strict=True):
            found = self._derivative(variables)
            row[:, : found.shape[1]] = found
        exponents = np.array(order, dtype=np.int64).reshape(len(order), self.variables)
        return Polynomial(exponents, rows.reshape(-1, len(order)))

    # ---- all that does not depend on t -----------------------------------------------------------

    @cached_property
    def _basis(self) -> tuple[list[tuple[int, ...]], dict[tuple[int, ...], int]]:
        """The monomials and all their divisors, ascending in degree and then in exponents, and their numbers."""
        seen: set[tuple[int, ...]] = set()
        todo = [tuple(int(x) for x in e) for e in self.exponents]
        while todo:
            e = todo.pop()
            if e not in seen:
                seen.add(e)
                todo += [(*e[:a], e[a] - 1, *e[a + 1 :]) for a in range(len(e)) if e[a]]
        order = sorted(seen, key=lambda e: (sum(e), e))
        return order, {e: i for i, e in enumerate(order)}

    @property
    def basis(self) -> dict[tuple[int, ...], int]:
        """Numbers of the monomials and all their divisors by exponents, ascending in degree."""
        return self._basis[1]

    @cached_property
    def _steps(self) -> list[tuple[slice, slice | IntArray, int]]:
        """Rows of the basis as products of other rows with a variable; slices where no monomial is missing."""
        order, number = self._basis
        groups: dict[tuple[int, int], list[tuple[int, int]]] = {}
        for i, e in enumerate(order[1:], start=1):
            a = next(a for a in range(len(e)) if e[a])
            groups.setdefault((sum(e), a), []).append((i, number[(*e[:a], e[a] - 1, *e[a + 1 :])]))
        steps: list[tuple[slice, slice | IntArray, int]] = []
        for (_, a), members in groups.items():
            rows, parents = np.array(members, dtype=np.int64).T
            together = bool((np.diff(parents) == 1).all())
            source = slice(parents[0], parents[-1] + 1) if together else parents
            steps.append((slice(rows[0], rows[-1] + 1), source, a))
        return steps

    def basis_at(self, t: Array, buffer: Array | None = None) -> Array:
        """Return the monomials and their divisors at t (v, n), (size, n); see :attr:`basis`."""
        size, n = len(self._basis[0]), t.shape[1]
        out = np.empty((size, n)) if buffer is None else buffer[:, :n]
        out[:1] = 1.0
        for rows, parents, a in self._steps:
            np.multiply(out[parents], t[a], out=out[rows])
        return out

    @cached_property
    def _used(self) -> IntArray:
        """Outputs that are not zero everywhere."""
        return np.flatnonzero(self.coefficients.any(axis=1))

    @cached_property
    def _rows(self) -> tuple[Array, tuple[Array, list[Place]], tuple[Array, list[Place]]]:
        """Coefficients of values, and of non-zero first and second derivatives with their places, over the basis."""
        v = range(self.variables)
        pairs = list(combinations_with_replacement(v, 2))
        return self._derivative(()), self._derivatives([(a,) for a in v]), self._derivatives(pairs)

    def _derivatives(self, wanted: Sequence[tuple[int, ...]]) -> tuple[Array, list[Place]]:
        """Return the rows over the basis that are not zero, and the places, of derivatives by some variables."""
        found = [(row, (i, *by)) for by in wanted for i, row in enumerate(self._derivative(by)) if row.any()]
        rows = np.array([row for row, _ in found])
        return rows.reshape(len(found), -1 if found else 0), [place for _, place in found]

    def _derivative(self, by: tuple[int, ...]) -> Array:
        """Return the coefficients of a derivative, (o, columns).

        The basis ascends in degree, so its columns end before those of the polynomial.
        """
        order, number = self._basis
        degrees = np.array([sum(e) for e in order])
        columns = int((degrees <= degrees.max(initial=0) - len(by)).sum())
        row = np.zeros((len(self.coefficients), columns))
        for k, exponent in enumerate(self.exponents):
            e, factor = [int(x) for x in exponent], 1
            for a in by:
                factor *= e[a]
                e[a] -= 1
            if factor:
                row[:, number[tuple(e)]] += factor * self.coefficients[:, k]
        return row


HIGHEST = 6
#: Polynomials are distinguished by values at random points, modulo a prime so small that sums of products stay exact.
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
        Variables that states move. On them alone monomials of invariant terms are distinguished.
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


#: Number of a coefficient and of a monomial.
Term = tuple[int, int]


@dataclass(frozen=True, eq=False)
class RowGroup:
    """Rows with the same monomials.

    Attributes
    ----------
    rows
        Which of all rows.
    coefficient : (m, k)
        Numbers of the coefficients of the m rows.
    column : (k,)
        Numbers of the monomials.
    """

    rows: slice
    coefficient: IntArray
    column: IntArray


@dataclass(frozen=True, eq=False)
class Rows:
    """Derivatives as rows over a basis of monomials t^e/e!, of which those of one are others; rows that are not zero.

    Attributes
    ----------
    places
        Output and variables of each row.
    groups
        What the rows consist of.
    columns
        Monomials that the rows use, the first of the basis.
    """

    places: list[Place]
    groups: list[RowGroup]
    columns: int

    @classmethod
    def from_entries(cls, rows: Iterable[tuple[Place, list[Term]]]) -> Rows:
        """Return the rows with these places and terms."""
        together: dict[tuple[int, ...], list[tuple[Place, list[int]]]] = {}
        for place, terms in rows:
            if terms:
                own = tuple(column for _, column in terms)
                together.setdefault(own, []).append((place, [coefficient for coefficient, _ in terms]))
        places: list[Place] = []
        groups, columns = [], 0
        for own, members in together.items():
            first = len(places)
            places += [place for place, _ in members]
            coefficient = np.array([numbers for _, numbers in members], dtype=np.int64)
            groups.append(RowGroup(slice(first, len(places)), coefficient, np.array(own, dtype=np.int64)))
            columns = max(columns, max(own) + 1)
        return cls(places, groups, columns)

    @property
    def size(self) -> int:
        """Number of entries of the rows."""
        return len(self.places) * self.columns

    def matrices(self, coefficients: Array) -> Array:
        """Return the rows (sets, rows, columns) for coefficients (P, sets)."""
        found = np.zeros((coefficients.shape[1], len(self.places), self.columns))
        for group in self.groups:
            found[:, group.rows, group.column] = np.moveaxis(coefficients[group.coefficient], -1, 0)
        return found

    def fill(self, out: Array, coefficients: Array, monomials: Array) -> None:
        """Write the rows (rows, n) of points with coefficients (P, n) of their own into ``out``."""
        for group in self.groups:
            np.einsum(
                "rkn,kn->rn",
                coefficients[group.coefficient],
                monomials[group.column],
                out=out[group.rows],
            )
