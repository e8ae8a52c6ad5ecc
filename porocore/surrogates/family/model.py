"""Model of the potential W(ln U, p; θ) of a family: responses, tangents, slopes by θ, flags, estimated error.

W = E λ³ [W₂(y; θ) + M(θ) R(y, θ̂)] with y = (ln U − ln λ I, p/E), W₂ the expansion at rest
(:class:`porocore.surrogates.family.rest.RestModel`), which is exact for every θ, and R a polynomial that begins at
third order in y.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.core.inputs.sampled_range import SampledRange
from porocore.states import Array, CellResponse, CellTangent, IntArray, MacroState, Status
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.family.derivatives import Scaling
from porocore.surrogates.family.joint import JointPolynomial, summed
from porocore.surrogates.family.rest import RestModel, RestValues
from porocore.surrogates.network.network import Derivatives
from porocore.surrogates.polynomial.composition import TermSum
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.polynomial.terms import VARIABLES
from porocore.surrogates.potential.data import variables
from porocore.surrogates.potential.training_box import TrainingBox
from porocore.surrogates.stretch.log_stretch import LogStretch

#: As many sets of parameters are evaluated one after the other, each as a polynomial in y alone.
MOST_BOUND = 32
#: Of fewer terms several sets of parameters are faster evaluated together.
MANY = 6


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
    """

    rest: RestModel
    coarse: JointPolynomial | None
    fine: JointPolynomial | None
    mean_grad: Polynomial
    active: tuple[int, ...]
    sampled: SampledRange
    training_box: TrainingBox
    estimate: ErrorEstimate | None = None

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
        if self.coarse is None:
            return found
        self._add(self._whole, y, x, found)
        beyond = self.training_box.beyond(y) if self.fine is not None else ()
        if self.fine is not None and len(beyond):
            (value, gradient, hessian), (v, g, h) = found, _zeros(len(beyond))
            z, first, second = self.training_box.saturated(y[:, beyond])
            self.fine.add(z, x[:, beyond], v, g, h)
            h *= first[:, None] * first[None]
            h[range(VARIABLES), range(VARIABLES)] += second * g
            g *= first
            self.coarse.add(y[:, beyond], x[:, beyond], v, g, h)
            value[beyond], gradient[:, beyond], hessian[:, :, beyond] = v, g, h
        return found

    @cached_property
    def _whole(self) -> JointPolynomial:
        """Both parts of R as one polynomial, which holds within the sampled box."""
        assert self.coarse is not None
        if self.fine is None:
            return self.coarse
        return JointPolynomial(self.coarse.terms, summed(self.coarse.polynomial, self.fine.polynomial))

    def _add(self, part: JointPolynomial, y: Array, x: Array, found: Derivatives) -> None:
        """Add a polynomial and its derivatives by y to ``found``, in place."""
        groups = self._groups(x)
        if groups is None:
            part.add(y, x, *found)
        elif len(groups) == 1:
            self._bound(part, x[:, 0]).start(y)(*found)
        else:
            for rows in groups:
                v, g, h = _zeros(len(rows))
                self._bound(part, x[:, rows[0]]).start(y[:, rows])(v, g, h)
                found[0][rows], found[1][:, rows], found[2][:, :, rows] = v, g, h

    def _bound(self, part: JointPolynomial, x: Array) -> TermSum:
        key = x.tobytes()
        if key not in self._known_bound:
            if len(self._known_bound) >= 2 * MOST_BOUND:
                self._known_bound.clear()
            self._known_bound[key] = part.bound(x)
        return self._known_bound[key]

    @cached_property
    def _known_bound(self) -> dict[bytes, TermSum]:
        return {}

    @cached_property
    def _last_groups(self) -> list[tuple[Array, list[IntArray] | None]]:
        return []

    def _groups(self, x: Array) -> list[IntArray] | None:
        """Return the points of each θ̂ where there are few; None where there are many."""
        for known, groups in self._last_groups:
            if known is x:
                return groups
        n = x.shape[1]
        if not len(x):
            return [np.arange(n)] if n else None
        # The first points tell most fields without a sort of all.
        few = n > 0 and len(np.unique(x[:, : 4 * MOST_BOUND], axis=1).T) <= MOST_BOUND
        groups = None
        if few:
            unique, number = np.unique(x, axis=1, return_inverse=True)
            most = MOST_BOUND if self.coarse is not None and len(self.coarse.terms.weights) >= MANY else 1
            if unique.shape[1] <= max(min(most, n // 16), 1):
                groups = [np.flatnonzero(number.reshape(-1) == i) for i in range(unique.shape[1])]
        self._last_groups.insert(0, (x, groups))
        del self._last_groups[2:]
        return groups

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

    def mean_part(self, y: Array, x: Array, at: RestValues) -> tuple[Array, Array]:
        """Return Rᵀ⟨∇u¹⟩ (9, n) and its derivatives (9, 7 + l, n) by y and θ̂ at a stretch λ of 1, rest left alone."""
        active = list(self.active)
        t, steepness, _ = y[active], np.ones((len(active), y.shape[1])), None
        beyond = self.training_box.beyond_active(t)
        if len(beyond):
            t[:, beyond], steepness[:, beyond], _ = self.training_box.saturated_active(t[:, beyond])
        value, first, _ = self.mean_grad.entries(np.concatenate([t, x]), second=False)
        found = at.mean_value + np.einsum("oan,an->on", at.mean, y) + value
        slopes = np.zeros((9, VARIABLES + len(x), y.shape[1]))
        slopes[:, :VARIABLES] = at.mean
        for (o, i), row in first:
            if i < len(active):
                slopes[o, active[i]] += row * steepness[i]
            else:
                slopes[o, VARIABLES + i - len(active)] += row
        return found, slopes

    def _mean_grad(
        self, stretch: LogStretch, y: Array, at: RestValues, scaling: Scaling, tangent: bool
    ) -> tuple[Array, tuple[Array, Array]]:
        n, R = y.shape[1], stretch.rotations
        unrotated, slopes = self.mean_part(y, at.x, at)
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
