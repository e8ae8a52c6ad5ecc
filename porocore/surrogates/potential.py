"""The effective potential W(ln U, p) as a sum of parts, and stress, fluid volume and tangents from its derivatives.

W = W₂ + polynomial + refinement + network, where W₂ is the exact second-order expansion at rest and the other parts
begin at third order; the last two, the fine ones, come to rest where the sampled states end. So W, P_E and their
slopes are exact at rest; P_E and −φ are derivatives of one function, so that a closed cycle does no work; and W
depends on F through U only, so it is objective.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.sampled_range import SampledRange
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status
from porocore.surrogates.composition import Composed, Motion
from porocore.surrogates.monomials import Polynomial
from porocore.surrogates.network import Evaluator
from porocore.surrogates.potential_data import Rest, variables
from porocore.surrogates.reach import Reach
from porocore.surrogates.stretch import LogStretch
from porocore.surrogates.terms import Terms, plain


@dataclass(frozen=True, eq=False)
class NetworkPart:
    """s [N(x) − what N says up to second order in y], x = (t − middle)/half for some terms t(y).

    With the terms of a cubic cell, N has the symmetry of the cube whatever its weights are.

    Attributes
    ----------
    network
        N, with one output.
    terms
        t; a term of weight w is of order w in y.
    middle, half : (k,)
        Of the ranges of the terms.
    scale
        s.
    """

    network: Evaluator
    terms: Terms
    middle: Array
    half: Array
    scale: float

    def derivatives(self, y: Array) -> tuple[Array, Array, Array]:
        """Value (n,), gradient (7, n) and Hessian (7, 7, n)."""
        plain = self.terms.name == "plain"
        if plain:
            active = [int(np.argmax(e)) for e in self.terms.polynomial.exponents]
            t = y[active]
        else:
            motion = Motion(self.terms, y)
            t = motion.t
        x = np.ascontiguousarray(((t - self.middle[:, None]) / self.half[:, None]).T)
        value, slope, curvature = self.network.curvatures(x)
        v0, g0, h0 = self._at_rest
        bent = h0 @ t
        value = self.scale * (value - v0 - g0 @ t - (t * bent).sum(axis=0) / 2)
        slope = self.scale * (slope / self.half[:, None] - g0[:, None] - bent)
        curvature = curvature * (self.scale / (self.half[:, None] * self.half))[:, :, None]
        for i, j in np.argwhere(h0):
            curvature[i, j] -= self.scale * h0[i, j]
        if not plain:
            return value, *motion.pushed(slope, curvature)
        gradient, hessian = np.zeros_like(y), np.zeros((len(y), *y.shape))
        gradient[active] = slope
        hessian[np.ix_(active, active)] = curvature
        return value, gradient, hessian

    @cached_property
    def _at_rest(self) -> tuple[Array, Array, Array]:
        """Value, slope and curvature by the terms at y = 0, as far as they make up N to second order in y."""
        value, slope, curvature = self.network.curvatures(-(self.middle / self.half)[None])
        first, second = low_orders(self.terms)
        return (
            value,
            slope[:, 0] / self.half * first,
            curvature[:, :, 0] / (self.half[:, None] * self.half) * second,
        )


def low_orders(terms: Terms) -> tuple[Array, Array]:
    """Which slopes (k,) and curvatures (k, k) by the terms belong to orders up to the second in y; 1 or 0."""
    weights = np.array(terms.weights)
    linear = (weights == 1).astype(float)
    return (weights <= 2).astype(float), linear[:, None] * linear


@dataclass(frozen=True, eq=False)
class PotentialModel:
    """W and <∇u¹>_s of any state.

    Attributes
    ----------
    rest
        W₂, and the linear limit of <∇u¹>_s.
    terms, polynomial
        Third order and a little higher, continued beyond the sampled states; None where there is no such part.
    network
        The rest; None where there is no such part.
    mean_grad
        Polynomial in the variables ``active``: components of Rᵀ<∇u¹>_s beyond the linear limit, (9 outputs).
    active
        The variables that were sampled.
    sampled
        Hull of the training states.
    reach
        Their box in the variables y.
    refinement
        The rest, as a polynomial in the same terms; None where there is no such part.
    """

    rest: Rest
    terms: Terms | None
    polynomial: Polynomial | None
    network: NetworkPart | None
    mean_grad: Polynomial
    active: tuple[int, ...]
    sampled: SampledRange
    reach: Reach
    refinement: Polynomial | None = None

    def potential(self, y: Array) -> tuple[Array, Array, Array]:
        """W (n,), ∂W/∂y (7, n) and ∂²W/∂y² (7, 7, n)."""
        value, gradient = self.rest.potential(y)
        hessian = np.empty((*self.rest.matrix.shape, y.shape[1]))
        hessian[:] = self.rest.matrix[:, :, None]
        settled = self.reach.settled(y)
        coarse, fine, both = self._polynomials
        if settled is None:
            both.add_to(y, value, gradient, hessian)
            if self.network is not None:
                v, g, h = self.network.derivatives(y)
                value, gradient, hessian = value + v, gradient + g, hessian + h
            return value, gradient, hessian
        coarse.add_to(y, value, gradient, hessian)
        z, first, second = settled
        v, g, h = np.zeros_like(value), np.zeros_like(gradient), np.zeros_like(hessian)
        fine.add_to(z, v, g, h)
        if self.network is not None:
            v, g, h = (a + b for a, b in zip((v, g, h), self.network.derivatives(z), strict=True))
        hessian += first[:, None] * first[None, :] * h
        hessian[np.arange(len(y)), np.arange(len(y))] += second * g
        return value + v, gradient + first * g, hessian

    @cached_property
    def _polynomials(self) -> tuple[Composed, Composed, Composed]:
        """What is continued beyond the sampled states, what is not, and their sum."""
        terms = plain(()) if self.terms is None else self.terms
        nothing = Polynomial(np.zeros((0, len(terms.weights)), dtype=np.int64), np.zeros((1, 0)))
        coarse, fine = self.polynomial or nothing, self.refinement or nothing
        if self.terms is None:
            coarse = fine = nothing
        both = Polynomial(
            np.concatenate([coarse.exponents, fine.exponents]),
            np.concatenate([coarse.coefficients, fine.coefficients], axis=1),
        )
        return Composed(terms, coarse), Composed(terms, fine), Composed(terms, both)

    def predict(self, states: MacroState, *, tangent: bool) -> CellResponse:
        """All responses of n states and, where asked for, their exact derivatives."""
        stretch = LogStretch.of(states.grad_u)
        y = variables(stretch, states.p)
        value, gradient, hessian = self.potential(y)
        stress = stretch.stress(gradient[:6])
        mean_grad, derivatives = self._mean_grad(stretch, y, tangent)
        if tangent:
            stress_p = stretch.stress(hessian[:6, 6])
            by_H, by_p = derivatives
            slopes = CellTangent(
                mean_grad_grad_u=by_H,
                mean_grad_p=by_p,
                stress_grad_u=stretch.tangent(gradient[:6], hessian[:6, :6]),
                stress_p=stress_p,
                fluid_volume_grad_u=-stress_p,
                fluid_volume_p=-hessian[6, 6],
            )
        return CellResponse(
            mean_grad=mean_grad,
            status=np.full(len(states), int(Status.converged), dtype=np.int64),
            potential=value,
            stress=stress,
            fluid_volume=-gradient[6],
            tangent=slopes if tangent else None,
            outside=self.sampled.outside(states),
        )

    def _mean_grad(self, stretch: LogStretch, y: Array, tangent: bool) -> tuple[Array, tuple[Array, Array]]:
        n = y.shape[1]
        settled = self.reach.settled(y)
        t = (y if settled is None else settled[0])[list(self.active)]
        unrotated = self.rest.mean_grad @ y
        if tangent:
            more, slopes, _ = self.mean_grad.entries(t, second=False)
        else:
            more = self.mean_grad.evaluate(t)
        unrotated += more
        R = None if stretch.rotation is None else np.ascontiguousarray(stretch.rotation.reshape(9, n).T)
        turned = np.ascontiguousarray(unrotated.T).reshape(n, 3, 3)
        if R is not None:
            turned = R.reshape(n, 3, 3) @ turned
        if not tangent:
            return turned, (turned, turned)
        by_y: dict[tuple[int, int], Array | float] = dict(self._linear_slopes)
        for (output, variable), row in slopes:
            at = output, self.active[variable]
            if settled is not None:
                row = row * settled[1][at[1]]
            by_y[at] = row + by_y.get(at, 0.0)
        by_p = np.zeros((n, 9))
        for output in range(9):
            by_p[:, output] = by_y.pop((output, 6), 0.0)
        by_p = by_p.reshape(n, 3, 3)
        by_H = stretch.rotated_gradient(unrotated.reshape(3, 3, n), by_y)
        return turned, (by_H.reshape(n, 3, 3, 3, 3), by_p if R is None else R.reshape(n, 3, 3) @ by_p)

    @cached_property
    def _linear_slopes(self) -> dict[tuple[int, int], float]:
        """∂Rᵀ<∇u¹>_s/∂y at rest, by (place, variable), where it is not zero."""
        matrix = self.rest.mean_grad
        return {(int(o), int(a)): float(matrix[o, a]) for o, a in np.argwhere(matrix)}


def mean_grad_terms(active: tuple[int, ...]) -> Terms:
    """In which <∇u¹>_s is a polynomial."""
    return plain(active)
