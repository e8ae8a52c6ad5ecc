"""Network in the terms of a potential whose outputs are weighed by a network of θ̂ (SeparableNetwork).

R(y, θ̂) = Σ_o c_o(θ̂) [N_o(t(y)) − its expansion in y up to second order]. What is subtracted does not depend on θ̂.
So R is of third order in y for every θ̂, its derivatives by θ̂ need no third ones of a network, and for one θ̂ it is a
network in t like that of a cell without parameters, at the same cost. That has one output, whose weight is 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from porocore.states import Array, IntArray
from porocore.surrogates.network.network import Derivatives, Evaluator, Network
from porocore.surrogates.polynomial.monomials import Terms


def low_orders(terms: Terms) -> tuple[Array, Array]:
    """Return 1 for gradients (k,) and Hessians (k, k) by the terms of orders up to the second in y, else 0."""
    weights = np.array(terms.weights)
    linear = (weights == 1).astype(float)
    return (weights <= 2).astype(float), linear[:, None] * linear


@dataclass(frozen=True, eq=False)
class SeparableNetwork:
    """R(y, θ̂) with one output.

    With terms that the operations of a cell leave alone, it has the cell's symmetry whatever the weights are.

    Attributes
    ----------
    network
        N, with o outputs.
    terms
        t; a term of weight w is of order w in y.
    factors
        c, with as many outputs; None for a cell without parameters: o = 1 and c = 1.
    """

    network: Evaluator
    terms: Terms
    factors: Network | None = None

    def at(self, x: Array, unit: Array | float = 1.0) -> FactoredNetwork:
        """Return the function of the terms at θ̂ (l, n), multiplied by ``unit`` (n,); (l, 1) is that of all points."""
        if self.factors is None:
            return FactoredNetwork(self)
        return FactoredNetwork(self, self.factors.evaluate(x.T) * np.reshape(unit, (-1, 1)))

    def by_coordinates(self, y: Array, x: Array) -> tuple[Array, Array, Array, Array]:
        """Return R (n,), ∂R/∂y (7, n), ∂R/∂θ̂ (l, n) and ∂²R/∂y∂θ̂ (7, l, n) at y (7, n) and θ̂ (l, n)."""
        assert self.factors is not None
        t, by_y, _ = self.terms.polynomial.derivatives(y, second=False)
        values, by_t = self.network.value_and_gradient(np.ascontiguousarray(t.T))
        v0, g0, h0 = self.at_rest
        h0_t = np.einsum("ijo,jn->ino", h0, t)
        values = values - v0 - t.T @ g0 - (h0_t * t[:, :, None]).sum(axis=0) / 2
        by_t = by_t - g0[:, None] - h0_t
        c, by_x = self.factors.value_and_gradient(x.T)
        slopes = np.einsum("ino,no->in", by_t, c)
        mixed = np.einsum("ino,lno->iln", by_t, by_x)
        return (
            (values * c).sum(axis=1),
            np.einsum("ian,in->an", by_y, slopes),
            np.einsum("lno,no->ln", by_x, values),
            np.einsum("ian,iln->aln", by_y, mixed),
        )

    @cached_property
    def at_rest(self) -> Derivatives:
        """Values (o,), gradients (k, o) and Hessians (k, k, o) at t = 0, as far as they count up to order 2 in y."""
        o, k = (1 if self.factors is None else len(self.factors.biases[-1])), len(self.terms.weights)
        found = self.network.value_gradient_hessian(np.zeros((o, k)), None if o == 1 else np.eye(o))
        first, second = low_orders(self.terms)
        return found[0], found[1] * first[:, None], found[2] * second[:, :, None]


@dataclass(frozen=True, eq=False)
class FactoredNetwork:
    """R of a :class:`SeparableNetwork` at the θ̂ of n points, as a function of the terms.

    Attributes
    ----------
    whole
        R.
    factors : (n, o)
        c(θ̂); (1, o) where they are those of all points; None: those of a cell without parameters.
    """

    whole: SeparableNetwork
    factors: Array | None = None

    def start(self, t: Array) -> Callable[[], Derivatives]:
        """Start the evaluation of R and its derivatives at the terms t (k, n); return a function that waits for it."""
        factors = self.factors
        if factors is not None:
            factors = np.broadcast_to(factors, (t.shape[1], factors.shape[1]))
        return partial(self._finished, t, self.whole.network.start(np.ascontiguousarray(t.T), factors))

    def take(self, rows: IntArray) -> FactoredNetwork:
        """Return the function at some of the points."""
        if self.factors is None or len(self.factors) == 1:
            return self
        return FactoredNetwork(self.whole, self.factors[rows])

    def _finished(self, t: Array, pending: Callable[[], Derivatives]) -> Derivatives:
        value, gradient, hessian = pending()
        v0, g0, h0 = self._at_rest
        for (i, j), row in h0:
            h0_t = row * t[j]
            gradient[i] -= h0_t
            value -= h0_t * t[i] / 2
            hessian[i, j] -= row
        gradient -= g0
        value -= v0 + (g0 * t).sum(axis=0)
        return value, gradient, hessian

    @cached_property
    def _at_rest(self) -> tuple[Array, Array, list[tuple[tuple[int, int], Array]]]:
        """Sums of the expansions at rest at each point: (n,), (k, n), and places and rows (n,) of the Hessians."""
        v0, g0, h0 = self.whole.at_rest
        c = np.ones((1, 1)) if self.factors is None else self.factors.T
        places = np.argwhere(h0.any(axis=2))
        return v0 @ c, g0 @ c, [((int(i), int(j)), h0[i, j] @ c) for i, j in places]
