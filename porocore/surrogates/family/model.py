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

from porocore.core.inputs.sampled_range import SampledRange
from porocore.states import Array, CellResponse, CellTangent, MacroState, Status
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.family.derivatives import Scaling
from porocore.surrogates.family.joint import JointPolynomial, summed
from porocore.surrogates.family.rest import RestModel, RestValues
from porocore.surrogates.network.network import Derivatives
from porocore.surrogates.network.separable import FactoredNetwork, SeparableNetwork
from porocore.surrogates.polynomial.composition import TermSum
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
        value, gradient, hessian = self.beyond_rest(y, at.x)
        value *= at.scale
        gradient *= at.scale
        hessian *= at.scale
        linear = np.einsum("abn,bn->an", at.matrix, y)
        value += at.value + ((at.gradient + linear / 2) * y).sum(axis=0)
        gradient += at.gradient + linear
        hessian += at.matrix
        return value, gradient, hessian

    def beyond_rest(self, y: Array, x: Array) -> Derivatives:
        """Return R and its derivatives by y, as :meth:`potential`, at θ̂ (l, n)."""
        found = _zeros(y.shape[1])
        part = None if self.network is None else self.network.at(x)
        whole = self._whole
        _add(whole, None if whole is None else whole.by_terms.at(x), part, y, found)
        if self.fine is None and part is None:
            return found
        beyond = self.training_box.beyond(y)
        if len(beyond):
            (value, gradient, hessian), there = found, _zeros(len(beyond))
            z, first, second = self.training_box.saturated(y[:, beyond])
            _add(
                self.fine,
                _bound(self.fine, x[:, beyond]),
                None if part is None else part.take(beyond),
                z,
                there,
            )
            _, g, h = there
            h *= first[:, None] * first[None]
            h[range(VARIABLES), range(VARIABLES)] += second * g
            g *= first
            _add(self.coarse, _bound(self.coarse, x[:, beyond]), None, y[:, beyond], there)
            value[beyond], gradient[:, beyond], hessian[:, :, beyond] = there
        return found

    @cached_property
    def _whole(self) -> JointPolynomial | None:
        """Both polynomials of R as one, which holds within the sampled box."""
        if self.coarse is None or self.fine is None:
            return self.coarse or self.fine
        return JointPolynomial(self.coarse.terms, summed(self.coarse.polynomial, self.fine.polynomial))

    # ---- responses -------------------------------------------------------------------------------

    def predict(self, states: MacroState, *, tangent: bool) -> CellResponse:
        """Return all responses of n states and, if ``tangent``, their exact derivatives by (H, p)."""
        _, stretch, y, at, scaling = self.at_states(states)
        value, gradient, hessian = self.potential(y, at)
        by, c = scaling.variables, scaling.factor
        gradient_y = gradient * by * c
        mean_grad, derivatives = self._mean_grad(stretch, y, at, scaling, tangent)
        found = None
        if not tangent:
            stress = stretch.stress(gradient_y[:6])
        else:
            hessian *= by * c
            hessian *= by[:, None]
            stress, stress_p = stretch.stresses(gradient_y[:6], hessian[:6, 6])
            found = CellTangent(
                mean_grad_grad_u=derivatives[0],
                mean_grad_p=derivatives[1],
                stress_grad_u=stretch.tangent(gradient_y[:6], hessian[:6, :6]),
                stress_p=stress_p,
                fluid_volume_grad_u=-stress_p,
                fluid_volume_p=-hessian[6, 6],
            )
        return CellResponse(
            mean_grad=mean_grad,
            status=np.full(len(states), int(Status.converged), dtype=np.int64),
            potential=c * value,
            stress=stress,
            fluid_volume=-gradient_y[6],
            tangent=found,
            outside_training_range=self._outside(states, y, at, gradient),
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
        return theta, stretch, y, self.rest.at(theta, slopes=slopes), scaling

    def mean_part(self, y: Array, at: RestValues, by_coordinates: bool = False) -> tuple[Array, Array]:
        """Return Rᵀ⟨∇u¹⟩ (9, n) and its derivatives by y (9, 7, n) at a stretch λ of 1, rest left alone.

        With ``by_coordinates`` the derivatives by θ̂ follow those by y, (9, 7 + l, n).
        """
        active, more = list(self.active), len(at.x) if by_coordinates else 0
        t, steepness = y[active], None
        beyond = self.training_box.beyond_active(t)
        if len(beyond):
            t[:, beyond], steepness, _ = self.training_box.saturated_active(t[:, beyond])
        if by_coordinates:
            found, first, _ = self.mean_grad.entries(np.concatenate([t, at.x]), second=False)
        else:
            found, first, _ = self._mean_by_y.at(at.x).entries(t, second=False)
        found += at.mean_value
        slopes = np.zeros((9, VARIABLES + more, y.shape[1]))
        slopes[:, :VARIABLES] = at.mean
        for o, a in at.mean_places:
            found[o] += at.mean[o, a] * y[a]
        for (o, i), row in first:
            if i >= len(active):
                slopes[o, VARIABLES + i - len(active)] += row
                continue
            if steepness is not None:
                row[beyond] *= steepness[i]
            slopes[o, active[i]] += row
        return found, slopes

    @cached_property
    def _mean_by_y(self) -> VaryingPolynomial:
        return VaryingPolynomial(self.mean_grad, len(self.active))

    def _mean_grad(
        self, stretch: LogStretch, y: Array, at: RestValues, scaling: Scaling, tangent: bool
    ) -> tuple[Array, tuple[Array, Array]]:
        n, R = y.shape[1], stretch.rotations
        unrotated, slopes = self.mean_part(y, at)
        unrotated *= scaling.stretch
        turned = np.ascontiguousarray(unrotated.T).reshape(n, 3, 3)
        turned = turned if R is None else R @ turned
        if not tangent:
            return turned, (turned, turned)
        slopes = slopes[:, :VARIABLES] * scaling.variables * scaling.stretch
        rows = {(int(o), int(a)): slopes[o, a] for o, a in np.argwhere(slopes[:, :6].any(axis=2))}
        by_p = np.ascontiguousarray(slopes[:, 6].T).reshape(n, 3, 3)
        by_H = stretch.rotated_gradient(unrotated.reshape(3, 3, n), rows)
        return turned, (by_H.reshape(n, 3, 3, 3, 3), by_p if R is None else R @ by_p)

    # ---- flags -----------------------------------------------------------------------------------

    def error(self, states: MacroState) -> Array:
        """Return the estimated error of n states, a share of the range of stress or fluid volume; NaN without one."""
        if self.estimate is None:
            return np.full(len(states), np.nan)
        _, _, y, at, _ = self.at_states(states)
        judged = list(self.estimate.judged)
        return self.estimate.error(np.concatenate([y, at.x]), self.beyond_rest(y, at.x)[1][judged])

    def _outside(
        self, states: MacroState, y: Array, at: RestValues, gradient: Array
    ) -> npt.NDArray[np.bool_]:
        """Return which states are flagged, (n,): far from all known ones, or by the estimated error."""
        unrotated = self.sampled.inputs.without_rotation(states)
        if self.estimate is None:
            return self.sampled.outside(unrotated)
        linear = at.gradient + np.einsum("abn,bn->an", at.matrix, y)
        found = ((gradient - linear) / at.scale)[list(self.estimate.judged)]
        return self.sampled.far(unrotated) | self.estimate.flagged(np.concatenate([y, at.x]), found)


def _zeros(n: int) -> Derivatives:
    """Return a value (n,), a gradient (7, n) and a Hessian (7, 7, n) of zeros."""
    return np.zeros(n), np.zeros((VARIABLES, n)), np.zeros((VARIABLES, VARIABLES, n))


def _bound(polynomial: JointPolynomial | None, x: Array) -> BoundPolynomial | None:
    return None if polynomial is None else BoundPolynomial(polynomial.by_terms, x)


def _add(
    polynomial: JointPolynomial | None,
    bound: BoundPolynomial | None,
    part: FactoredNetwork | None,
    y: Array,
    found: Derivatives,
) -> None:
    """Add a polynomial that is bound to θ̂, a network, and their derivatives by y (7, n) to ``found``, in place."""
    sums = []
    rows = None
    if part is not None:
        own = part.whole.terms
        rows = None if polynomial is None else polynomial.terms.rows_of(own)
        if rows is None:
            count = len(own.weights)
            sums.append(TermSum(own, Polynomial.zero(count, 1), part, tuple(range(count))))
    if polynomial is not None and bound is not None:
        # Terms that both have are differentiated once.
        sums.append(TermSum(polynomial.terms, bound, None if rows is None else part, rows or ()))
    for add_to in [each.start(y) for each in sums]:
        add_to(*found)
