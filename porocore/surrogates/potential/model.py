"""Model of the potential W(ln U, p): responses, tangents, flags, estimated error (PotentialModel).

W = W₂ + polynomial + refinement + network, where W₂ is the exact second-order expansion at rest and the other parts
begin at third order; the last two, the fine ones, come to rest where the sampled states end. So W, P_E and their
gradients are exact at rest; P_E and −φ are derivatives of one function, so that a closed cycle does no work; and W
depends on F through U only, so it is objective.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.core.inputs.sampled_range import SampledRange
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.network.network import Derivatives, Evaluator
from porocore.surrogates.polynomial.composition import TermSum
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.polynomial.terms import Terms, plain
from porocore.surrogates.potential.data import RestExpansion, variables
from porocore.surrogates.potential.training_box import TrainingBox
from porocore.surrogates.stretch.log_stretch import LogStretch


@dataclass(frozen=True, eq=False)
class NetworkPart:
    """Network N(t) less its expansion up to second order in y, for some terms t(y).

    With terms that the operations of a cell leave alone, N has its symmetry whatever the weights are.

    Attributes
    ----------
    network
        N, with one output.
    terms
        t; a term of weight w is of order w in y.
    """

    network: Evaluator
    terms: Terms

    def start(self, t: Array) -> Callable[[], Derivatives]:
        """Start the evaluation of N less its expansion and its derivatives at t (k, n)."""
        pending = self.network.start(np.ascontiguousarray(t.T))

        def finish() -> Derivatives:
            value, gradient, hessian = pending()
            v0, g0, h0 = self._at_rest
            h0_t = h0 @ t
            value = value - v0 - g0 @ t - (t * h0_t).sum(axis=0) / 2
            gradient = gradient - g0[:, None] - h0_t
            for i, j in np.argwhere(h0):
                hessian[i, j] -= h0[i, j]
            return value, gradient, hessian

        return finish

    @cached_property
    def _at_rest(self) -> tuple[Array, Array, Array]:
        """Value, gradient and Hessian by the terms at y = 0, as far as they belong to orders up to the second in y."""
        value, gradient, hessian = self.network.value_gradient_hessian(np.zeros((1, len(self.terms.weights))))
        first, second = low_orders(self.terms)
        return value, gradient[:, 0] * first, hessian[:, :, 0] * second


def low_orders(terms: Terms) -> tuple[Array, Array]:
    """Return 1 for gradients (k,) and Hessians (k, k) by the terms of orders up to the second in y, else 0."""
    weights = np.array(terms.weights)
    linear = (weights == 1).astype(float)
    return (weights <= 2).astype(float), linear[:, None] * linear


@dataclass(frozen=True, eq=False)
class PotentialModel:
    """Model of W and <∇u¹>_s for any state.

    Attributes
    ----------
    rest
        W₂, and the linear limit of <∇u¹>_s.
    terms, polynomial
        Third order and a little higher, continued beyond the sampled states; None where there is no such part.
    network
        Finer part; None where there is no such part.
    mean_grad
        Polynomial in the variables ``active``: components of Rᵀ<∇u¹>_s beyond the linear limit, (9 outputs).
    active
        The variables that were sampled.
    sampled
        Hull of the training states.
    training_box
        Their box in the variables y.
    refinement
        Finer part as a polynomial in the same terms; None where there is no such part.
    estimate
        Estimate of its errors, which flags states; None: those beyond the hull are flagged.
    """

    rest: RestExpansion
    terms: Terms | None
    polynomial: Polynomial | None
    network: NetworkPart | None
    mean_grad: Polynomial
    active: tuple[int, ...]
    sampled: SampledRange
    training_box: TrainingBox
    refinement: Polynomial | None = None
    estimate: ErrorEstimate | None = None

    def potential(self, y: Array) -> tuple[Array, Array, Array]:
        """Return W (n,), ∂W/∂y (7, n) and ∂²W/∂y² (7, 7, n)."""
        return self._start(y)()

    def _start(self, y: Array) -> Callable[[], Derivatives]:
        """Start the evaluation of :meth:`potential`, in the background if the backend can."""
        parts = [part.start(y) for part in self._everything]

        def finish() -> Derivatives:
            value, gradient, hessian = self._second_order(y)
            for add_to in parts:
                add_to(value, gradient, hessian)
            beyond = self.training_box.beyond(y) if self._fine else ()
            if len(beyond):
                value[beyond], gradient[:, beyond], hessian[:, :, beyond] = self._beyond(y[:, beyond])
            return value, gradient, hessian

        return finish

    def _beyond(self, y: Array) -> Derivatives:
        """Return the same at states outside the sampled box."""
        value, gradient, hessian = self._second_order(y)
        for part in self._coarse:
            part.start(y)(value, gradient, hessian)
        z, first, second = self.training_box.saturated(y)
        v, g, h = np.zeros_like(value), np.zeros_like(gradient), np.zeros_like(hessian)
        for part in self._fine:
            part.start(z)(v, g, h)
        hessian += first[:, None] * first[None, :] * h
        hessian[np.arange(len(y)), np.arange(len(y))] += second * g
        return value + v, gradient + first * g, hessian

    def _second_order(self, y: Array) -> tuple[Array, Array, Array]:
        """Return W₂ and its derivatives."""
        value, gradient = self.rest.potential(y)
        hessian = np.empty((*self.rest.matrix.shape, y.shape[1]))
        hessian[:] = self.rest.matrix[:, :, None]
        return value, gradient, hessian

    @cached_property
    def _everything(self) -> list[TermSum]:
        return self._sums([self.polynomial, self.refinement], self.network)

    @cached_property
    def _coarse(self) -> list[TermSum]:
        return self._sums([self.polynomial], None)

    @cached_property
    def _fine(self) -> list[TermSum]:
        return self._sums([self.refinement], self.network)

    def _sums(self, polynomials: list[Polynomial | None], network: NetworkPart | None) -> list[TermSum]:
        """Return one sum for each set of terms, so that each term is differentiated once."""
        terms = self.terms or plain(())
        found = [Polynomial.zero(len(terms.weights), 1), *(p for p in polynomials if p is not None)]
        if network is not None:
            rows = terms.rows_of(network.terms)
            if rows is None:
                own, k = network.terms, len(network.terms.weights)
                alone = TermSum(own, Polynomial.zero(k, 1), network, tuple(range(k)))
                return [*self._sums(polynomials, None), alone]
        if network is None and len(found) == 1:
            return []
        both = Polynomial(
            np.concatenate([p.exponents for p in found]),
            np.concatenate([p.coefficients for p in found], axis=1),
        )
        return [TermSum(terms, both) if network is None else TermSum(terms, both, network, rows or ())]

    def predict(self, states: MacroState, *, tangent: bool) -> CellResponse:
        """Return all responses of n states and, if ``tangent``, their exact derivatives."""
        stretch = LogStretch.from_gradient(states.grad_u)
        y = variables(stretch, states.p)
        pending = self._start(y)
        mean_grad, derivatives = self._mean_grad(stretch, y, tangent)
        value, gradient, hessian = pending()
        if not tangent:
            stress = stretch.stress(gradient[:6])
        else:
            stress, stress_p = stretch.stresses(gradient[:6], hessian[:6, 6])
            by_H, by_p = derivatives
            gradients = CellTangent(
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
            tangent=gradients if tangent else None,
            outside_training_range=self._outside(states, y, gradient),
        )

    def beyond_rest(self, y: Array, judged: tuple[int, ...], gradient: Array | None = None) -> Array:
        """Return ∂(W − W₂)/∂y (c, n) of the judged variables at y (7, n); ∂W/∂y may be given."""
        whole = self.potential(y)[1] if gradient is None else gradient
        return (whole - self.rest.potential(y)[1])[list(judged)]

    def error(self, states: MacroState) -> Array:
        """Return the estimated error of n states, a share of the range of stress or fluid volume; NaN without one."""
        if self.estimate is None:
            return np.full(len(states), np.nan)
        y = variables(LogStretch.from_gradient(states.grad_u), states.p)
        return self.estimate.error(y, self.beyond_rest(y, self.estimate.judged))

    def _outside(self, states: MacroState, y: Array, gradient: Array) -> npt.NDArray[np.bool_]:
        """Return which states are flagged, (n,): far from all known ones, or by the estimated error."""
        unrotated = self.sampled.inputs.without_rotation(states)
        if self.estimate is None:
            return self.sampled.outside(unrotated)
        found = self.beyond_rest(y, self.estimate.judged, gradient)
        return self.sampled.far(unrotated) | self.estimate.flagged(y, found)

    def _mean_grad(self, stretch: LogStretch, y: Array, tangent: bool) -> tuple[Array, tuple[Array, Array]]:
        n = y.shape[1]
        t = y[list(self.active)]
        beyond, steepness = self.training_box.beyond_active(t), None
        if len(beyond):
            t[:, beyond], steepness, _ = self.training_box.saturated_active(t[:, beyond])
        unrotated = self.rest.held[:, None] + self.rest.mean_grad @ y
        if tangent:
            more, gradients, _ = self.mean_grad.entries(t, second=False)
        else:
            more = self.mean_grad.evaluate(t)
        unrotated += more
        turned = np.ascontiguousarray(unrotated.T).reshape(n, 3, 3)
        R = stretch.rotations
        if R is not None:
            turned = R @ turned
        if not tangent:
            return turned, (turned, turned)
        by_y: dict[tuple[int, int], Array | float] = dict(self._linear_slopes)
        for (output, variable), row in gradients:
            at = output, self.active[variable]
            if steepness is not None:
                row[beyond] *= steepness[variable]
            row += by_y.get(at, 0.0)
            by_y[at] = row
        by_p = np.zeros((n, 3, 3))
        for output in range(9):
            if (output, 6) in by_y:
                by_p[:, output // 3, output % 3] = by_y.pop((output, 6))
        by_H = stretch.rotated_gradient(unrotated.reshape(3, 3, n), by_y)
        return turned, (by_H.reshape(n, 3, 3, 3, 3), by_p if R is None else R @ by_p)

    @cached_property
    def _linear_slopes(self) -> dict[tuple[int, int], float]:
        """∂Rᵀ<∇u¹>_s/∂y at rest, by (place, variable), where it is not zero."""
        matrix = self.rest.mean_grad
        return {(int(o), int(a)): float(matrix[o, a]) for o, a in np.argwhere(matrix)}
