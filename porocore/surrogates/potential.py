"""The effective potential W(ln U, p) as a sum of parts, and stress, fluid volume and tangents from its derivatives.

W = W₂ + polynomial + network, where W₂ is the exact second-order expansion at rest and the other parts begin at
third order. So W, P_E and their slopes are exact at rest; P_E and −φ are derivatives of one function, so that a
closed cycle does no work; and W depends on F through U only, so it is objective.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.sampled_range import SampledRange
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status
from porocore.surrogates.least_squares import composed
from porocore.surrogates.monomials import Polynomial
from porocore.surrogates.network import Evaluator
from porocore.surrogates.potential_data import Rest, variables
from porocore.surrogates.stretch import LogStretch
from porocore.surrogates.terms import Terms, plain


@dataclass(frozen=True, eq=False)
class NetworkPart:
    """s [N(x) − N(x₀) − N′(x₀)(x − x₀) − ½ (x − x₀)·N″(x₀)(x − x₀)], x = (y − middle)/half for the active y.

    Attributes
    ----------
    network
        N, with one output.
    active
        The variables that it knows.
    middle, half : (d,)
        Of the range of these.
    scale
        s.
    symmetry : (g, d, d) or None
        Matrices on the active y, over which N is averaged.
    """

    network: Evaluator
    active: tuple[int, ...]
    middle: Array
    half: Array
    scale: float
    symmetry: Array | None = None

    def derivatives(self, y: Array) -> tuple[Array, Array, Array]:
        """Value (n,), gradient (7, n) and Hessian (7, 7, n)."""
        d, n = len(self.active), y.shape[1]
        z = y[list(self.active)]
        value, slope, curvature = self._raw(z)
        v0, g0, h0 = self._at_rest
        bent = h0 @ z
        value = self.scale * (value - v0 - g0 @ z - (z * bent).sum(axis=0) / 2)
        slope = self.scale * (slope - g0[:, None] - bent)
        curvature = self.scale * (curvature - h0[:, :, None])
        gradient, hessian = np.zeros((7, n)), np.zeros((7, 7, n))
        for a in range(d):
            gradient[self.active[a]] = slope[a]
            for b in range(d):
                hessian[self.active[a], self.active[b]] = curvature[a, b]
        return value, gradient, hessian

    def _raw(self, z: Array) -> tuple[Array, Array, Array]:
        """N at the active y (d, n), with derivatives with respect to these."""
        if self.symmetry is None:
            return self._one(z)
        g, n = len(self.symmetry), z.shape[1]
        images = np.einsum("gab,bn->agn", self.symmetry, z).reshape(len(z), g * n)
        value, slope, curvature = self._one(images)
        d = len(z)
        return (
            value.reshape(g, n).mean(axis=0),
            np.einsum("gab,agn->bn", self.symmetry, slope.reshape(d, g, n)) / g,
            np.einsum(
                "gac,abgn,gbd->cdn",
                self.symmetry,
                curvature.reshape(d, d, g, n),
                self.symmetry,
                optimize=True,
            )
            / g,
        )

    def _one(self, z: Array) -> tuple[Array, Array, Array]:
        x = ((z - self.middle[:, None]) / self.half[:, None]).T
        value, slope, curvature = self.network.curvatures(np.ascontiguousarray(x))
        h = self.half[:, None]
        return value, slope / h, curvature / (h[:, None] * h[None, :])

    @cached_property
    def _at_rest(self) -> tuple[Array, Array, Array]:
        value, slope, curvature = self._raw(np.zeros((len(self.active), 1)))
        return value, slope[:, 0], curvature[:, :, 0]


@dataclass(frozen=True, eq=False)
class PotentialModel:
    """W and <∇u¹>_s of any state.

    Attributes
    ----------
    rest
        W₂, and the linear limit of <∇u¹>_s.
    terms, polynomial
        Third order and higher; None where there is no such part.
    network
        Third order and higher; None where there is no such part.
    mean_grad
        Polynomial in the variables ``active``: components of Rᵀ<∇u¹>_s beyond the linear limit, (9 outputs).
    active
        The variables that were sampled.
    sampled
        Hull of the training states.
    """

    rest: Rest
    terms: Terms | None
    polynomial: Polynomial | None
    network: NetworkPart | None
    mean_grad: Polynomial
    active: tuple[int, ...]
    sampled: SampledRange

    def potential(self, y: Array) -> tuple[Array, Array, Array]:
        """W (n,), ∂W/∂y (7, n) and ∂²W/∂y² (7, 7, n)."""
        value, gradient = self.rest.potential(y)
        hessian = np.repeat(self.rest.matrix[:, :, None], y.shape[1], axis=2)
        parts = []
        if self._polynomial is not None:
            parts.append(tuple(part[0] for part in self._polynomial(y)))
        if self.network is not None:
            parts.append(self.network.derivatives(y))
        for v, g, h in parts:
            value, gradient, hessian = value + v, gradient + g, hessian + h
        return value, gradient, hessian

    @cached_property
    def _polynomial(self):  # type: ignore[no-untyped-def]
        if self.terms is None or self.polynomial is None or not len(self.polynomial.exponents):
            return None
        return composed(self.terms, self.polynomial)

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
        unrotated = self.rest.mean_grad @ y
        t = y[list(self.active)]
        if tangent:
            more, slopes, _ = self.mean_grad.derivatives(t, second=False)
        else:
            more, slopes = self.mean_grad.evaluate(t), np.zeros((9, len(t), n))
        unrotated = unrotated + more
        R = None if stretch.rotation is None else np.moveaxis(stretch.rotation, -1, 0)
        rows = np.moveaxis(unrotated, -1, 0).reshape(n, 3, 3)
        turned = rows if R is None else R @ rows
        if not tangent:
            return turned, (turned, turned)
        by_y = np.repeat(self.rest.mean_grad[None], n, axis=0)
        by_y[:, :, list(self.active)] += np.moveaxis(slopes, -1, 0)
        if R is not None:
            by_y = (R @ by_y.reshape(n, 3, 21)).reshape(n, 9, 7)
        by_H = by_y[:, :, :6] @ stretch.gradient.swapaxes(1, 2)
        by_H += np.moveaxis(stretch.rotation_gradient(unrotated.reshape(3, 3, n)), -1, 0).reshape(n, 9, 9)
        return turned, (by_H.reshape(n, 3, 3, 3, 3), by_y[:, :, 6].reshape(n, 3, 3))


def mean_grad_terms(active: tuple[int, ...]) -> Terms:
    """In which <∇u¹>_s is a polynomial."""
    return plain(active)
