"""Model of the potential W(ln U, p; θ) of a family: responses, tangents, slopes by θ, flags, estimated error.

W = E λ³ [W₂(y; θ) + M(θ) R(y, θ̂)] with y = (ln U − ln λ I, p/E), W₂ the expansion at rest
(:class:`porocore.surrogates.family.rest.RestModel`), which is exact for every θ, and R a polynomial, or one and a
network, that begins at third order in y.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.core.inputs.point_coordinates import Coordinates
from porocore.core.inputs.sampled_range import SampledRange
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.family.derivatives import Scaling
from porocore.surrogates.family.joint import BoundParts, JointPolynomial, Latest, summed
from porocore.surrogates.family.rest import RestModel, RestValues
from porocore.surrogates.network.network import Derivatives
from porocore.surrogates.network.separable import SeparableNetwork
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.polynomial.terms import VARIABLES
from porocore.surrogates.polynomial.varying import BoundPolynomial, VaryingPolynomial
from porocore.surrogates.potential.data import variables
from porocore.surrogates.potential.training_box import TrainingBox
from porocore.surrogates.stretch.log_stretch import LogStretch


@dataclass(frozen=True, eq=False)
class FamilyModel:
    """Model of W and ⟨∇u¹⟩_s of every member of a family, for any state.

    Attributes
    ----------
    rest
        The undeformed members.
    coarse
        Part of R that is continued beyond the sampled states; None where nothing was learned.
    fine
        Part that comes to rest where they end; None where there is none.
    mean_grad
        Polynomial in the variables ``active`` and θ̂: Rᵀ⟨∇u¹⟩_s beyond its linear limit, 9 outputs.
    active
        Variables that were sampled.
    sampled
        Hull of the training states, parameters included.
    training_box
        Their box in the variables y.
    estimate
        Estimate of its errors, which flags states; None: those beyond the hull are flagged.
    network
        Another part that comes to rest where they end; None where there is none.
    """

    rest: RestModel
    coarse: JointPolynomial | None
    fine: JointPolynomial | None
    mean_grad: Polynomial
    active: tuple[int, ...]
    sampled: SampledRange
    training_box: TrainingBox
    estimate: ErrorEstimate | None = None
    network: SeparableNetwork | None = None

    # ---- the potential ---------------------------------------------------------------------------

    def potential(self, y: Array, at: RestValues) -> Derivatives:
        """Return w (n,), ∂w/∂y (7, n) and ∂²w/∂y² (7, 7, n) at y (7, n) of a cell of unit modulus."""
        return self._potential(y, at, rest_gradient(y, at))

    def _potential(self, y: Array, at: RestValues, at_rest: Array) -> Derivatives:
        """Return the same, given ∂W₂/∂y (7, n)."""
        gradient, hessian = at_rest.copy(), rest_hessian(at, y.shape[1])
        value = at.value + ((gradient + at.gradient) / 2 * y).sum(axis=0)
        parts = self._latest.of(at, lambda: self._parts_at(at.coordinates, at.scale))
        self._add_beyond(y, parts, (value, gradient, hessian))
        return value, gradient, hessian

    def beyond_rest(self, y: Array, x: Array) -> Derivatives:
        """Return R and its derivatives by y, as :meth:`potential`, at θ̂ (l, n)."""
        n = y.shape[1]
        found = np.zeros(n), np.zeros((VARIABLES, n)), np.zeros((VARIABLES, VARIABLES, n))
        self._add_beyond(y, self._parts_at(Coordinates(x)), found)
        return found

    def _add_beyond(self, y: Array, parts: BoundParts, found: Derivatives) -> None:
        """Add all parts of R and their derivatives by y to ``found``, in place."""
        nowhere = parts.fine is None and parts.network is None
        beyond = np.zeros(0, dtype=np.int64) if nowhere else self.training_box.beyond(y)
        if not len(beyond):
            parts.add(y, found, parts.whole, parts.network)
            return
        before = [array[..., beyond].copy() for array in found]
        parts.add(y, found, parts.whole, parts.network)
        near, count = parts.take(beyond), len(beyond)
        z, first, second = self.training_box.saturated(y[:, beyond])
        there = np.zeros(count), np.zeros((VARIABLES, count)), np.zeros((VARIABLES, VARIABLES, count))
        parts.add(z, there, near.fine, near.network)
        _, g, h = there
        h *= first[:, None] * first[None]
        h[range(VARIABLES), range(VARIABLES)] += second * g
        g *= first
        parts.add(y[:, beyond], there, near.coarse, None)
        for array, start, more in zip(found, before, there, strict=True):
            array[..., beyond] = start + more

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
        _, stretch, y, at, scaling = self.at_states(states)
        at_rest = rest_gradient(y, at)
        value, gradient, hessian = self._potential(y, at, at_rest)
        outside = self._outside(states, y, at, gradient - at_rest)
        if not scaling.trivial:
            by, c = scaling.variables, scaling.factor
            value, gradient = value * c, gradient * by * c
            hessian *= by * c
            hessian *= by[:, None]
        mean_grad, derivatives = self._mean_grad(stretch, y, at, scaling, tangent)
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
            outside_training_range=outside,
        )

    def at_states(
        self, states: MacroState, slopes: bool = False
    ) -> tuple[Array, LogStretch, Array, RestValues, Scaling]:
        self.sampled.inputs.require_parameters(states)
        theta = states.parameters
        assert theta is not None
        stretch = LogStretch.from_gradient(states.grad_u)
        scaling = Scaling.from_parameters(self.rest.parameters, theta)
        y = scaling.inner(variables(stretch, states.p))
        at = self.rest.together(theta, slopes=slopes)
        return theta, stretch, y, at, scaling

    def mean_part(
        self, y: Array, at: RestValues, by_coordinates: bool = False
    ) -> tuple[Array, dict[tuple[int, int], Array]]:
        """Return Rᵀ⟨∇u¹⟩ (9, n) and its derivatives by component and variable at a stretch λ of 1, rest left alone.

        With ``by_coordinates`` θ̂ follow the seven variables.
        """
        active = list(self.active)
        t, steepness = y[active], None
        beyond = self.training_box.beyond_active(t)
        if len(beyond):
            t[:, beyond], steepness, _ = self.training_box.saturated_active(t[:, beyond])
        if by_coordinates:
            x = np.broadcast_to(at.x, (len(at.x), y.shape[1]))
            found, first, _ = self.mean_grad.entries(np.concatenate([t, x]), second=False)
        else:
            bound = self._latest_means.of(at, lambda: self._mean_by_y.at(at.coordinates))
            found, first, _ = bound.entries(t, second=False)
        found += at.mean_value
        slopes = dict(at.mean_linear)
        for (o, a), slope in at.mean_linear.items():
            found[o] += slope * y[a]
        for (o, i), row in first:
            if i >= len(active):
                slopes[o, VARIABLES + i - len(active)] = row
                continue
            if steepness is not None:
                row[beyond] *= steepness[i]
            place = o, active[i]
            if place in slopes:
                row += slopes[place]
            slopes[place] = row
        return found, slopes

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
        unrotated, slopes = self.mean_part(y, at)
        if not scaling.trivial:
            unrotated *= scaling.stretch
            slopes = {at: row * scaling.variables[at[1]] * scaling.stretch for at, row in slopes.items()}
        turned = np.ascontiguousarray(unrotated.T).reshape(n, 3, 3)
        turned = turned if R is None else R @ turned
        if not tangent:
            return turned, (turned, turned)
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
        _, _, y, at, _ = self.at_states(states)
        at_rest = rest_gradient(y, at)
        found = self._judged(at, self._potential(y, at, at_rest)[1] - at_rest)
        return self.estimate.error(_with_coordinates(y, at), found)

    def _outside(self, states: MacroState, y: Array, at: RestValues, beyond: Array) -> npt.NDArray[np.bool_]:
        """Return which states are flagged, (n,): far from all known ones, or by the estimated error.

        ``beyond`` are the derivatives (7, n) of w less those of W₂.
        """
        unrotated, estimate = self.sampled.inputs.without_rotation(states), self.estimate
        if estimate is None:
            return self.sampled.outside(unrotated)
        members = self._latest_members.of(at, lambda: estimate.at(at.coordinates))
        flagged = estimate.flagged(_with_coordinates(y, at), self._judged(at, beyond), members)
        return self.sampled.far(unrotated) | flagged

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
    return np.concatenate([y, np.broadcast_to(at.x, (len(at.x), y.shape[1]))])


def rest_gradient(y: Array, at: RestValues) -> Array:
    """Return ∂W₂/∂y (7, n)."""
    if at.matrix.shape[2] == 1:
        return at.gradient + at.matrix[:, :, 0] @ y
    gradient = at.gradient.copy()
    for (a, b), entry in at.linear.items():
        gradient[a] += entry * y[b]
    return gradient


def rest_hessian(at: RestValues, n: int) -> Array:
    """Return ∂²W₂/∂y² (7, 7, n), of which most entries are zero."""
    hessian = np.zeros((VARIABLES, VARIABLES, n))
    for place, entry in at.linear.items():
        hessian[place] = entry
    return hessian
