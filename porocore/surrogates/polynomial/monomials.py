"""Polynomials of several variables: exponents, values, gradients and Hessians for all states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np

from porocore.states import Array, IntArray

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
