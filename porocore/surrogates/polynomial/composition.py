"""Functions of terms t(y): sums, and derivatives by the variables y through the chain rule."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from porocore.states import Array
from porocore.surrogates.network.network import Derivatives
from porocore.surrogates.polynomial.monomials import VARIABLES, Polynomial, Terms
from porocore.surrogates.polynomial.varying import BoundPolynomial


class TermDerivatives:
    """Terms at y (7, n) with their derivatives, which turn derivatives by t into derivatives by y.

    Attributes
    ----------
    t : (k, n)
        The terms.
    """

    def __init__(self, terms: Terms, y: Array) -> None:
        self.t, gradients, self._hessians = terms.polynomial.entries(y)
        k, n = self.t.shape
        J = np.zeros((k, VARIABLES, n))
        for at, row in gradients:
            J[at] = row
        self._wide = np.ascontiguousarray(J.reshape(-1, n).T).reshape(n, k, VARIABLES)
        self._tall = np.ascontiguousarray(self._wide.swapaxes(1, 2))

    def push(self, by_t: Array, by_tt: Array, gradient: Array, hessian: Array) -> None:
        """Add derivatives by t, (k, n) and (k, k, n), to the gradient (7, n) and Hessian (7, 7, n) by y."""
        k, n = by_t.shape
        gradient += (self._tall @ np.ascontiguousarray(by_t.T)[:, :, None])[:, :, 0].T
        rows = np.ascontiguousarray(by_tt.reshape(k * k, n).T).reshape(n, k, k)
        product = self._tall @ rows @ self._wide
        hessian += np.ascontiguousarray(product.reshape(n, -1).T).reshape(VARIABLES, VARIABLES, n)
        for (term, a, b), row in self._hessians:
            entry = by_t[term] * row
            hessian[a, b] += entry
            if a != b:
                hessian[b, a] += entry


class FunctionOfTerms(Protocol):
    """Function of some terms."""

    def start(self, t: Array) -> Callable[[], Derivatives]:
        """Start the evaluation of its derivatives at t (k, n); return a function that waits for them."""


@dataclass(frozen=True, eq=False)
class TermSum:
    """Sum of a polynomial in terms and, maybe, another function of some of them.

    Attributes
    ----------
    terms, polynomial
        Polynomial with one output, or without monomials.
    part, rows
        The other function, and which of the terms it takes.
    """

    terms: Terms
    polynomial: Polynomial | BoundPolynomial
    part: FunctionOfTerms | None = None
    rows: tuple[int, ...] = ()

    def start(self, y: Array) -> Callable[[Array, Array, Array], None]:
        """Start the evaluation at y (7, n).

        The returned function adds to a value (n,), a gradient (7, n) and a Hessian (7, 7, n), in place.
        """
        derivatives = TermDerivatives(self.terms, y) if self.terms.name != "plain" else None
        t = y[list(self.terms.variables)] if derivatives is None else derivatives.t
        pending = None if self.part is None else self.part.start(t[list(self.rows)])

        def finish(value: Array, gradient: Array, hessian: Array) -> None:
            if derivatives is None:
                if pending is not None:
                    mine = [self.terms.variables[row] for row in self.rows]
                    _add_at(mine, pending(), value, gradient, hessian)
                self._add_polynomial(t, self.terms.variables, value, gradient, hessian)
                return
            everything = tuple(range(len(t)))
            if pending is not None and self.rows == everything:
                part_value, by_t, by_tt = pending()
                value += part_value
            else:
                by_t, by_tt = np.zeros_like(t), np.zeros((len(t), *t.shape))
                if pending is not None:
                    _add_at(self.rows, pending(), value, by_t, by_tt)
            self._add_polynomial(t, everything, value, by_t, by_tt)
            derivatives.push(by_t, by_tt, gradient, hessian)

        return finish

    def _add_polynomial(
        self, t: Array, places: Sequence[int], value: Array, gradient: Array, hessian: Array
    ) -> None:
        if not len(self.polynomial.exponents):
            return
        values, gradients, hessians = self.polynomial.entries(t)
        value += values[0]
        for (_, i), row in gradients:
            gradient[places[i]] += row
        for (_, i, j), row in hessians:
            a, b = places[i], places[j]
            hessian[a, b] += row
            if a != b:
                hessian[b, a] += row


def _add_at(places: Sequence[int], found: Derivatives, value: Array, gradient: Array, hessian: Array) -> None:
    v, g, h = found
    value += v
    for i, a in enumerate(places):
        gradient[a] += g[i]
        for j, b in enumerate(places):
            hessian[a, b] += h[i, j]


def composed(terms: Terms, polynomial: Polynomial, y: Array) -> tuple[Array, Array, Array]:
    """Return values (o, n), gradients (o, 7, n) and Hessians (o, 7, 7, n) at y (7, n) of a polynomial in terms."""
    o, n = len(polynomial.coefficients), y.shape[1]
    value, gradient = np.zeros((o, n)), np.zeros((o, VARIABLES, n))
    hessian = np.zeros((o, VARIABLES, VARIABLES, n))
    for i in range(o):
        one = Polynomial(polynomial.exponents, polynomial.coefficients[i : i + 1])
        TermSum(terms, one).start(y)(value[i], gradient[i], hessian[i])
    return value, gradient, hessian
