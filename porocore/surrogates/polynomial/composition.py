"""Functions of terms t(y), and their derivatives with respect to the variables y (7, n)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from porocore.states import Array
from porocore.surrogates.network.network import Derivatives
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.polynomial.terms import VARIABLES, Terms


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

    def push(self, by_t: Array, by_tt: Array, gradient: Array, hessian: Array) -> None:
        """Add to the gradient (7, n) and Hessian (7, 7, n) by y what those by t, (k, n) and (k, k, n), make of them."""
        k, n = by_t.shape
        gradient += (self._tall @ np.ascontiguousarray(by_t.T)[:, :, None])[:, :, 0].T
        rows = np.ascontiguousarray(by_tt.reshape(k * k, n).T).reshape(n, k, k)
        bent = self._tall @ rows @ self._wide
        hessian += np.ascontiguousarray(bent.reshape(n, -1).T).reshape(VARIABLES, VARIABLES, n)
        for (term, a, b), row in self._bends:
            more = by_t[term] * row
            hessian[a, b] += more
            if a != b:
                hessian[b, a] += more


class Part(Protocol):
    """A function of some terms."""

    def start(self, t: Array) -> Callable[[], Derivatives]:
        """Set about its derivatives at t (k, n), in the background if it can, and return what waits for them."""


@dataclass(frozen=True, eq=False)
class Sum:
    """A polynomial in terms and, maybe, another function of some of the same terms.

    Attributes
    ----------
    terms, polynomial
        With one output, or with no monomials at all.
    part, rows
        The other function, and which of the terms it takes.
    """

    terms: Terms
    polynomial: Polynomial
    part: Part | None = None
    rows: tuple[int, ...] = ()

    def start(self, y: Array) -> Callable[[Array, Array, Array], None]:
        """Set about it at y (7, n).

        What is returned adds to a value (n,), a gradient (7, n) and a Hessian (7, 7, n), in place.
        """
        motion = Motion(self.terms, y) if self.terms.name != "plain" else None
        t = y[list(self.terms.variables)] if motion is None else motion.t
        pending = None if self.part is None else self.part.start(t[list(self.rows)])

        def finish(value: Array, gradient: Array, hessian: Array) -> None:
            if motion is None:
                if pending is not None:
                    mine = [self.terms.variables[row] for row in self.rows]
                    _add_at(mine, pending(), value, gradient, hessian)
                self._add_polynomial(t, self.terms.variables, value, gradient, hessian)
                return
            everything = tuple(range(len(t)))
            if pending is not None and self.rows == everything:
                more, by_t, by_tt = pending()
                value += more
            else:
                by_t, by_tt = np.zeros_like(t), np.zeros((len(t), *t.shape))
                if pending is not None:
                    _add_at(self.rows, pending(), value, by_t, by_tt)
            self._add_polynomial(t, everything, value, by_t, by_tt)
            motion.push(by_t, by_tt, gradient, hessian)

        return finish

    def _add_polynomial(
        self, t: Array, places: Sequence[int], value: Array, gradient: Array, hessian: Array
    ) -> None:
        if not len(self.polynomial.exponents):
            return
        values, slopes, curvatures = self.polynomial.entries(t)
        value += values[0]
        for (_, i), row in slopes:
            gradient[places[i]] += row
        for (_, i, j), row in curvatures:
            a, b = places[i], places[j]
            hessian[a, b] += row
            if a != b:
                hessian[b, a] += row


def _add_at(places: Sequence[int], found: Derivatives, value: Array, gradient: Array, hessian: Array) -> None:
    more, slope, curvature = found
    value += more
    for i, a in enumerate(places):
        gradient[a] += slope[i]
        for j, b in enumerate(places):
            hessian[a, b] += curvature[i, j]


def composed(terms: Terms, polynomial: Polynomial, y: Array) -> tuple[Array, Array, Array]:
    """Values (o, n), gradients (o, 7, n) and Hessians (o, 7, 7, n) at y (7, n) of a polynomial in terms."""
    o, n = len(polynomial.coefficients), y.shape[1]
    value, gradient = np.zeros((o, n)), np.zeros((o, VARIABLES, n))
    hessian = np.zeros((o, VARIABLES, VARIABLES, n))
    for i in range(o):
        one = Polynomial(polynomial.exponents, polynomial.coefficients[i : i + 1])
        Sum(terms, one).start(y)(value[i], gradient[i], hessian[i])
    return value, gradient, hessian
