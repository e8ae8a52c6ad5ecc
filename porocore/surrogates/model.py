"""Model of the potential W(ln U, p; θ) and of ⟨∇u¹⟩_s (PotentialModel): responses, tangents, slopes by θ, flags.

A cell without parameters is a family with none, of θ̂ without components. With Young's modulus E of the solid and its
swelling stretch λ as parameters,

    W = E λ³ [W₂(y; θ) + M(θ) R(y, θ̂)],   y = (ln U − ln λ I, p/E),

W₂ the exact expansion at rest (:class:`porocore.surrogates.rest.Rest`) and R a sum of polynomials and maybe a network
that begins at third order in y. So W, P_E and their gradients are exact at rest for every θ; P_E and −φ are derivatives
of one function, so that a closed cycle does no work; and W depends on F through U only, so it is objective.

A polynomial of high degree, or a network, means nothing outside its training states and soon loses convexity. So only
W₂ and a polynomial of low degree are continued there; all finer parts are evaluated at variables that follow y inside
the sampled box and saturate a little beyond it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.core.inputs import Coordinates, SampledRange
from porocore.states import Array, CellResponse, CellSlopes, CellTangent, Doubt, IntArray, MacroState, Status
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.family.coordinates import Scaling
from porocore.surrogates.family.joint import BoundParts, JointPolynomial, Latest, summed
from porocore.surrogates.network.network import Derivatives
from porocore.surrogates.network.separable import SeparableNetwork
from porocore.surrogates.polynomial.monomials import VARIABLES, Entry, Polynomial
from porocore.surrogates.polynomial.varying import BoundPolynomial, VaryingPolynomial
from porocore.surrogates.potential import variables
from porocore.surrogates.rest import Rest, RestValues
from porocore.surrogates.stretch import LogStretch
from porocore.surrogates.training_box import TrainingBox

#: Derivatives of Rᵀ⟨∇u¹⟩_s by its component and the variable; one number may be for all points.
Slopes = dict[tuple[int, int], Array]


@dataclass(frozen=True, eq=False)
class PotentialModel:
    """Model of W and ⟨∇u¹⟩_s of a cell, or of every member of a family, for any state.

    Attributes
    ----------
    rest
        The undeformed cells.
    coarse
        Part of R that is continued beyond the sampled states; None where nothing was learned.
    fine
        Part that saturates where they end; None where there is none.
    mean_grad
        Polynomial in the variables ``active`` and θ̂: Rᵀ⟨∇u¹⟩_s beyond its linear limit, 9 outputs.
    active
        Variables that were sampled.
    sampled
        Hull of the training states, parameters included.
    training_box
        Their box in the variables y.
    network
        Another part that saturates where they end; None where there is none.
    estimate
        Estimate of its errors, which flags states; None: those beyond the hull are flagged.
    """

    rest: Rest
    coarse: JointPolynomial | None
    fine: JointPolynomial | None
    mean_grad: Polynomial
    active: tuple[int, ...]
    sampled: SampledRange
    training_box: TrainingBox
    network: SeparableNetwork | None = None
    estimate: ErrorEstimate | None = None

    # ---- the potential ---------------------------------------------------------------------------

    def potential(self, y: Array, at: RestValues | None = None) -> Derivatives:
        """Return w (n,), ∂w/∂y (7, n) and ∂²w/∂y² (7, 7, n) at y (7, n) of a cell of unit modulus.

        ``at`` are the undeformed members; None for a cell without parameters.
        """
        at = self.rest.together(None) if at is None else at
        return self._start(y, at, at.potential_gradient(y))()

    def _start(self, y: Array, at: RestValues, at_rest: Array) -> Callable[[], Derivatives]:
        """Start the evaluation of the same, given ∂W₂/∂y (7, n), in the background if a network can."""
        parts = self._latest.of(at, lambda: self._parts_at(at.coordinates, at.scale))
        add = self._start_beyond(y, parts)

        def finish() -> Derivatives:
            gradient, hessian = at_rest.copy(), at.potential_hessian(y.shape[1])
            value = at.value + ((gradient + at.gradient) / 2 * y).sum(axis=0)
            add((value, gradient, hessian))
            return value, gradient, hessian

        return finish

    def beyond_rest(self, y: Array, x: Array) -> Derivatives:
        """Return R and its derivatives by y, as :meth:`potential`, at θ̂ (l, n); (l, 1) is that of all points."""
        n = y.shape[1]
        found = np.zeros(n), np.zeros((VARIABLES, n)), np.zeros((VARIABLES, VARIABLES, n))
        self._start_beyond(y, self._parts_at(Coordinates(x)))(found)
        return found

    def _start_beyond(self, y: Array, parts: BoundParts) -> Callable[[Derivatives], None]:
        """Start all parts of R; the returned function adds them and their derivatives by y in place."""
        pending = parts.start(y, parts.whole, parts.network)

        def add(found: Derivatives) -> None:
            nowhere = parts.fine is None and parts.network is None
            beyond = np.zeros(0, dtype=np.int64) if nowhere else self.training_box.beyond(y)
            before = [array[..., beyond].copy() for array in found] if len(beyond) else []
            pending(*found)
            if not len(beyond):
                return
            near, count = parts.take(beyond), len(beyond)
            z, first, second = self.training_box.saturated(y[:, beyond])
            there = np.zeros(count), np.zeros((VARIABLES, count)), np.zeros((VARIABLES, VARIABLES, count))
            parts.start(z, near.fine, near.network)(*there)
            _, g, h = there
            h *= first[:, None] * first[None]
            h[range(VARIABLES), range(VARIABLES)] += second * g
            g *= first
            parts.start(y[:, beyond], near.coarse, None)(*there)
            for array, start, more in zip(found, before, there, strict=True):
                array[..., beyond] = start + more

        return add

    @cached_property
    def _latest(self) -> Latest[RestValues, BoundParts]:
        return Latest()

    def _parts_at(self, coordinates: Coordinates, unit: Array | float = 1.0) -> BoundParts:
        polynomials = self.whole, self.coarse, self.fine
        whole, coarse, fine = (None if p is None else p.by_terms.at(coordinates, unit) for p in polynomials)
        network = None if self.network is None else self.network.at(coordinates.x, unit)
        terms = None if self.whole is None else self.whole.terms
        return BoundParts(terms, whole, coarse, fine, network)

    @cached_property
    def whole(self) -> JointPolynomial | None:
        """Both polynomials of R as one, which holds within the sampled box."""
        if self.coarse is None or self.fine is None:
            return self.coarse or self.fine
        return JointPolynomial(self.coarse.terms, summed(self.coarse.polynomial, self.fine.polynomial))

    # ---- responses -------------------------------------------------------------------------------

    def predict(self, states: MacroState, *, tangent: bool) -> CellResponse:
        """Return all responses of n states and, if ``tangent``, their exact derivatives by (H, p)."""
        stretch, y, at, scaling = self.at_states(states)
        at_rest = at.potential_gradient(y)
        pending = self._start(y, at, at_rest)
        mean_grad, derivatives = self._mean_grad(stretch, y, at, scaling, tangent)
        value, gradient, hessian = pending()
        doubt = self._doubt(states, y, at, gradient - at_rest)
        if not scaling.trivial:
            by, c = scaling.variables, scaling.factor
            value, gradient = value * c, gradient * by * c
            hessian *= by * c
            hessian *= by[:, None]
        found = None
        if not tangent:
            stress = stretch.stress(gradient[:6])
        else:
            stress, stress_p = stretch.stresses(gradient[:6], hessian[:6, 6])
            found = CellTangent(
                mean_grad_grad_u=derivatives[0],
                mean_grad_p=derivatives[1],
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
            tangent=found,
            doubt=doubt,
        )

    def at_states(
        self, states: MacroState, slopes: bool = False
    ) -> tuple[LogStretch, Array, RestValues, Scaling]:
        self.sampled.inputs.require_parameters(states)
        stretch = LogStretch.from_gradient(states.grad_u)
        scaling = self.rest.scaling(states.parameters)
        y = scaling.inner(variables(stretch, states.p))
        return stretch, y, self.rest.together(states.parameters, slopes=slopes), scaling

    def mean_part(self, y: Array, at: RestValues) -> tuple[Array, Slopes]:
        """Return Rᵀ⟨∇u¹⟩ (9, n) and its derivatives by component and variable, θ̂ last, at a stretch λ of 1."""
        active, x = list(self.active), np.broadcast_to(at.x, (len(at.x), y.shape[1]))
        t, beyond, steepness = self._saturated(y[active])
        found, first, _ = self.mean_grad.entries(np.concatenate([t, x]), second=False)
        found += at.mean_part(y)
        return found, self._mean_slopes(at, first, beyond, steepness)

    def _saturated(self, t: Array) -> tuple[Array, IntArray, Array | None]:
        """Return t (d, n), saturated in place beyond the box; which are beyond it, and derivatives there."""
        beyond, steepness = self.training_box.beyond_active(t), None
        if len(beyond):
            t[:, beyond], steepness, _ = self.training_box.saturated_active(t[:, beyond])
        return t, beyond, steepness

    def _mean_slopes(
        self, at: RestValues, first: list[Entry], beyond: IntArray, steepness: Array | None
    ) -> Slopes:
        """Return the derivatives of Rᵀ⟨∇u¹⟩ from those of its polynomial."""
        slopes = dict(at.mean_linear)
        for (o, i), row in first:
            if i >= len(self.active):
                slopes[o, VARIABLES + i - len(self.active)] = row
                continue
            if steepness is not None:
                row[beyond] *= steepness[i]
            place = o, self.active[i]
            if place in slopes:
                row += slopes[place]
            slopes[place] = row
        return slopes

    @cached_property
    def _mean_by_y(self) -> VaryingPolynomial:
        return VaryingPolynomial(self.mean_grad, len(self.active))

    @cached_property
    def _latest_means(self) -> Latest[RestValues, BoundPolynomial]:
        return Latest()

    def _mean_grad(
        self, stretch: LogStretch, y: Array, at: RestValues, scaling: Scaling, tangent: bool
    ) -> tuple[Array, tuple[Array, Array]]:
        n, R = y.shape[1], stretch.rotations
        t, beyond, steepness = self._saturated(y[list(self.active)])
        bound = self._latest_means.of(at, lambda: self._mean_by_y.at(at.coordinates))
        if tangent:
            unrotated, first, _ = bound.entries(t, second=False)
        else:
            unrotated, first = bound.evaluate(t), []
        unrotated += at.mean_part(y)
        if not scaling.trivial:
            unrotated *= scaling.stretch
        turned = np.ascontiguousarray(unrotated.T).reshape(n, 3, 3)
        turned = turned if R is None else R @ turned
        if not tangent:
            return turned, (turned, turned)
        slopes = self._mean_slopes(at, first, beyond, steepness)
        if not scaling.trivial:
            slopes = {at: row * scaling.variables[at[1]] * scaling.stretch for at, row in slopes.items()}
        by_p = np.zeros((n, 3, 3))
        for o in range(9):
            if (o, 6) in slopes:
                by_p[:, o // 3, o % 3] = slopes.pop((o, 6))
        by_H = stretch.rotated_gradient(unrotated.reshape(3, 3, n), slopes)
        return turned, (by_H.reshape(n, 3, 3, 3, 3), by_p if R is None else R @ by_p)

    # ---- flags -----------------------------------------------------------------------------------

    def error(self, states: MacroState) -> Array:
        """Return the estimated error of n states, a share of the range of stress or fluid volume; NaN without one."""
        if self.estimate is None:
            return np.full(len(states), np.nan)
        _, y, at, _ = self.at_states(states)
        at_rest = at.potential_gradient(y)
        found = self._judged(at, self._start(y, at, at_rest)()[1] - at_rest)
        return self.estimate.error(_with_coordinates(y, at), found)

    def _doubt(self, states: MacroState, y: Array, at: RestValues, beyond: Array) -> IntArray:
        """Return the doubts (n,) of states: far from all known ones, or by the estimated error.

        ``beyond`` are the derivatives (7, n) of w less those of W₂.
        """
        unrotated, estimate = self.sampled.inputs.without_rotation(states), self.estimate
        if estimate is None:
            return self.sampled.doubt(unrotated)
        members = self._latest_members.of(at, lambda: estimate.at(at.coordinates))
        flagged = estimate.flagged(_with_coordinates(y, at), self._judged(at, beyond), members)
        return self.sampled.far(unrotated) | Doubt.where(error=flagged)

    def _judged(self, at: RestValues, beyond: Array) -> Array:
        """Return the quantities that the estimate judges, (c, n)."""
        assert self.estimate is not None
        found: Array = beyond[list(self.estimate.judged)] / at.scale
        return found

    @cached_property
    def _latest_members(self) -> Latest[RestValues, BoundPolynomial]:
        return Latest()


def _with_coordinates(y: Array, at: RestValues) -> Array:
    """Return y and θ̂ (7 + l, n)."""
    return np.concatenate([y, np.broadcast_to(at.x, (len(at.x), y.shape[1]))]) if len(at.x) else y


def slopes_by_parameters(model: PotentialModel, states: MacroState) -> CellSlopes:
    """Return the derivatives of all responses but the conductivity by the m parameters, at fixed (H, p)."""
    stretch, y, at, scaling = model.at_states(states, slopes=True)
    parameters, theta, n = model.rest.parameters, states.parameters, len(states)
    assert parameters is not None
    assert theta is not None
    m = len(parameters.kinds)
    value, gradient, hessian = model.potential(y, at)
    by, c = scaling.variables, scaling.factor
    W, T = np.zeros((m, n)), np.zeros((7, m, n))
    mean, rows = model.mean_part(y, at)
    mean_slopes = np.zeros((9, VARIABLES + len(at.x), n))
    for place, row in rows.items():
        mean_slopes[place] = row
    more, porosity = np.zeros((9, m, n)), np.zeros((m, n))
    learned = parameters.learned
    W[learned], T[:, learned], more[:, learned] = _learned(model, y, at, mean_slopes)
    W[learned] *= c
    T[:, learned] *= (by * c)[:, None]
    more[:, learned] *= scaling.stretch
    assert at.slopes is not None
    porosity[learned] = at.slopes.porosity
    for k, kind in enumerate(parameters.kinds):
        if kind in ("modulus", "swelling"):
            W[k], T[:, k], more[:, k] = _exact(
                kind, theta[:, k], y, scaling, (value, gradient, hessian), mean, mean_slopes
            )
    R = stretch.rotations
    turned = np.moveaxis(more, -1, 0).reshape(n, 3, 3, m)
    return CellSlopes(
        potential=W.T.copy(),
        stress=np.stack(stretch.stresses(*(T[:6, k] for k in range(m))), axis=-1),
        fluid_volume=-T[6].T,
        porosity=porosity.T.copy(),
        mean_grad=turned if R is None else np.einsum("nij,njkm->nikm", R, turned),
    )


def _learned(
    model: PotentialModel, y: Array, at: RestValues, mean_slopes: Array
) -> tuple[Array, Array, Array]:
    """Return the derivatives of w (l, n), ∂w/∂y (7, l, n) and Rᵀ⟨∇u¹⟩ (9, l, n) by the learned parameters."""
    s, l = at.slopes, len(at.x)
    assert s is not None
    linear = _summed(np.moveaxis(s.matrix, 1, 2), y)
    W = s.value + ((s.gradient + linear / 2) * y[:, None]).sum(axis=0)
    T = s.gradient + linear
    beyond = len(model.training_box.beyond(y)) > 0
    parts = (model.coarse, model.fine) if beyond else (model.whole,)
    for part in (*parts, model.network):
        if part is None:
            continue
        first: Array | float = 1.0
        z = y
        if beyond and part is not model.coarse:
            z, first, _ = model.training_box.saturated(y)
        x = np.broadcast_to(at.x, (l, y.shape[1])) if part is model.network else at.x
        value, by_y, by_x, by_yx = part.by_coordinates(z, x)
        W = W + s.scale * value + at.scale * _chained(by_x, s.x)
        across = _chained(by_yx, s.x) * at.scale + by_y[:, None] * s.scale
        T = T + across * (first if isinstance(first, float) else first[:, None])
    mean = s.mean_value + _summed(np.moveaxis(s.mean, 1, 2), y) + _chained(mean_slopes[:, VARIABLES:], s.x)
    return W, T, mean


def _summed(rows: Array, y: Array) -> Array:
    """Return the sums (..., l, n) over the variables of rows (..., l, a, n) times y (a, n); one row may be for all."""
    if rows.shape[-1] == 1:
        return np.asarray(rows[..., 0] @ y)
    return np.asarray(np.einsum("olan,an->oln", rows, y))


def _chained(by_x: Array, slopes: Array) -> Array:
    """Return derivatives (..., l, n) by θ from those (..., c, n) by θ̂ and ∂θ̂/∂θ (c, l, n), which may be one for all."""
    if slopes.shape[-1] == 1:
        return np.asarray(slopes[..., 0].T @ by_x)
    return np.asarray(np.einsum("...cn,cln->...ln", by_x, slopes))


def _exact(
    kind: str, theta: Array, y: Array, scaling: Scaling, w: Derivatives, mean: Array, mean_slopes: Array
) -> tuple[Array, Array, Array]:
    """Return the derivatives of W, ∂W/∂y and ⟨∇u¹⟩ by the modulus or the swelling stretch, from the scaling of w."""
    value, gradient, hessian = w
    by, c = scaling.variables, scaling.factor
    change = np.zeros_like(y)
    if kind == "modulus":
        change[6] = -y[6] / theta
    else:
        change[:3] = -1 / theta
    power = 1 if kind == "modulus" else 3
    W = c * (power / theta * value + (gradient * change).sum(axis=0))
    T = c * by * (power / theta * gradient + np.einsum("abn,bn->an", hessian, change))
    if kind == "modulus":
        T[6] -= c * by[6] / theta * gradient[6]
    more = scaling.stretch * np.einsum("oan,an->on", mean_slopes[:, :VARIABLES], change)
    return W, T, more if kind == "modulus" else more + mean * scaling.stretch / theta
