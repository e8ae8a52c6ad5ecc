"""Polynomials in several variables with their first and second derivatives, as one matrix product for all states."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
import numpy.typing as npt

from porocore.states import Array

IntArray = npt.NDArray[np.int64]


def exponents_up_to(weights: tuple[int, ...], lowest: int, highest: int) -> IntArray:
    """All exponents (K, v) whose total weight lies between ``lowest`` and ``highest``, in ascending order of weight."""
    found: list[tuple[int, ...]] = [()]
    for weight in weights:
        found = [
            (*head, e)
            for head in found
            for e in range((highest - sum(a * b for a, b in zip(head, weights, strict=False))) // weight + 1)
        ]
    total = [sum(a * b for a, b in zip(e, weights, strict=True)) for e in found]
    kept = sorted((t, e) for t, e in zip(total, found, strict=True) if lowest <= t <= highest)
    return np.array([e for _, e in kept], dtype=np.int64).reshape(-1, len(weights))


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

    @property
    def variables(self) -> int:
        """v."""
        return int(self.exponents.shape[1])

    def evaluate(self, t: Array) -> Array:
        """Values (o, n) at t (v, n)."""
        values: Array = self._rows[0] @ self._monomials(t)
        return values

    def derivatives(self, t: Array, *, second: bool = True) -> tuple[Array, Array, Array | None]:
        """Values (o, n), gradients (o, v, n) and Hessians (o, v, v, n) at t (v, n)."""
        o, v, n = len(self.coefficients), self.variables, t.shape[1]
        monomials = self._monomials(t)
        rows, (first, pairs) = self._rows, self._places
        count = len(first) + (len(pairs) if second else 0)
        out = rows[1][:count] @ monomials
        gradient = np.zeros((o, v, n))
        for row, (i, a) in zip(out, first, strict=False):
            gradient[i, a] = row
        values = rows[0] @ monomials
        if not second:
            return values, gradient, None
        hessian = np.zeros((o, v, v, n))
        for row, (i, a, b) in zip(out[len(first) :], pairs, strict=True):
            hessian[i, a, b] = row
            hessian[i, b, a] = row
        return values, gradient, hessian

    # ---- all that does not depend on t -----------------------------------------------------------

    @cached_property
    def _basis(self) -> tuple[list[tuple[int, ...]], dict[tuple[int, ...], int], list[tuple[int, int]]]:
        """The monomials and all their divisors, each with its number, a divisor of one degree less, and the factor."""
        seen: set[tuple[int, ...]] = set()
        todo = [tuple(int(x) for x in e) for e in self.exponents]
        while todo:
            e = todo.pop()
            if e not in seen:
                seen.add(e)
                todo += [(*e[:a], e[a] - 1, *e[a + 1 :]) for a in range(len(e)) if e[a]]
        order = sorted(seen, key=lambda e: (sum(e), e))
        number = {e: i for i, e in enumerate(order)}
        made = [(0, 0)]
        for e in order[1:]:
            a = next(a for a in range(len(e)) if e[a])
            made.append((number[(*e[:a], e[a] - 1, *e[a + 1 :])], a))
        return order, number, made

    def _monomials(self, t: Array) -> Array:
        order, _, made = self._basis
        out = np.empty((len(order), t.shape[1]))
        if len(order):
            out[0] = 1.0
        for k in range(1, len(order)):
            parent, factor = made[k]
            np.multiply(out[parent], t[factor], out=out[k])
        return out

    @cached_property
    def _places(self) -> tuple[list[tuple[int, int]], list[tuple[int, int, int]]]:
        return self._derivative_rows[1:]

    @cached_property
    def _rows(self) -> tuple[Array, Array]:
        order, number, _ = self._basis
        value = np.zeros((len(self.coefficients), len(order)))
        for k, e in enumerate(self.exponents):
            value[:, number[tuple(int(x) for x in e)]] += self.coefficients[:, k]
        return value, self._derivative_rows[0]

    @cached_property
    def _derivative_rows(self) -> tuple[Array, list[tuple[int, int]], list[tuple[int, int, int]]]:
        """Coefficients of the derivatives that are not zero, over the basis, and which derivatives these are."""
        order, number, _ = self._basis
        v = self.variables
        rows, first, pairs = [], [], []
        wanted: list[tuple[int, ...]] = [(a,) for a in range(v)]
        wanted += list(combinations_with_replacement(range(v), 2))
        for by in wanted:
            row = np.zeros((len(self.coefficients), len(order)))
            for k, exponent in enumerate(self.exponents):
                e, factor = [int(x) for x in exponent], 1
                for a in by:
                    factor *= e[a]
                    e[a] -= 1
                if factor:
                    row[:, number[tuple(e)]] += factor * self.coefficients[:, k]
            for i in range(len(self.coefficients)):
                if row[i].any():
                    rows.append(row[i])
                    if len(by) == 1:
                        first.append((i, by[0]))
                    else:
                        pairs.append((i, *by))
        return np.array(rows).reshape(len(rows), len(order)), first, pairs  # type: ignore[return-value]
