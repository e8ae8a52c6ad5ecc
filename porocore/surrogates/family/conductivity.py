"""Conductivity of the deformed pore of a family by (ln U, p; θ); error estimate of its potential.

K_ref = (λ³/μ) B exp(S) Bᵀ with S = ln(Bᵀ K(θ) B) + a polynomial in (ln U − ln λ I, p/E; θ̂) that begins at first order
in the first two. So K_ref is that of the undeformed member at rest for every θ, symmetric and positive definite.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.core.inputs import SampledRange
from porocore.core.tensors import exponential, symmetric_exponential, symmetric_logarithm
from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, IntArray, MacroState
from porocore.surrogates.conductivity import triangle
from porocore.surrogates.error_estimate.fit import HIGHEST, MOST_MONOMIALS, Equations, draw, estimate
from porocore.surrogates.family.derivatives import Scaling
from porocore.surrogates.family.fit import FamilyData, JointData, Weights, beside, fit_joint, terms_of
from porocore.surrogates.family.joint import Latest, design, joint_exponents
from porocore.surrogates.family.model import FamilyModel
from porocore.surrogates.family.rest import RestModel, RestValues
from porocore.surrogates.polynomial.monomials import VARIABLES, Polynomial, Terms, plain
from porocore.surrogates.polynomial.varying import BoundPolynomial, VaryingPolynomial
from porocore.surrogates.potential import STILL, TrainingBox, variables
from porocore.surrogates.stretch import LogStretch
from porocore.surrogates.symmetry import Equivariance, on_triangle, on_variables, stabiliser

#: Values and slopes by θ̂; the solved states tell no others.
WEIGHTS = Weights(by_y=0.0, by_x=1.0, by_yy=0.0, by_yx=0.0)
LARGEST_DEGREE = 6


@dataclass(frozen=True, eq=False)
class FamilyConductivity:
    """Model of K_ref of every member of a family, for any state.

    Attributes
    ----------
    rest
        Undeformed members.
    polynomial
        Upper triangle of S beyond rest, a matrix in space (3, 3), in the variables ``active`` and θ̂.
    active
        Variables that were sampled.
    training_box
        Box of the training states; beyond it the polynomial comes to rest.
    sampled
        Hull of the training states that have a conductivity.
    closing
        Some training states have no conductivity, since pore walls touch.
    """

    rest: RestModel
    polynomial: Polynomial
    active: tuple[int, ...]
    training_box: TrainingBox
    sampled: SampledRange
    closing: bool = False

    def predict(self, states: MacroState, *, tangent: bool) -> tuple[Array, Array | None, Array | None]:
        """Return K_ref (n, 3, 3), NaN where det F ≤ 0, and if ``tangent`` its derivatives by H and p."""
        stretch, t, at, scaling, missing = self._at(states)
        S, by_t, _, steepness = self._beyond(t, at)
        factor = (scaling.stretch**3 / scaling.viscosity)[:, None, None]
        if not tangent:
            K = self._in_space(exponential(S)) * factor
            K[missing] = np.nan
            return K, None, None
        by_t = by_t * (steepness * scaling.variables[list(self.active)]).T[..., None, None]
        E, dE = symmetric_exponential(S, by_t)
        K, by_active = self._in_space(E) * factor, self._in_space(dE) * factor[:, None]
        n = len(K)
        by_L, by_p = np.zeros((n, 9, 6)), np.zeros((n, 3, 3))
        for a, variable in enumerate(self.active):
            if variable == 6:
                by_p = by_active[:, a].copy()
            else:
                by_L[:, :, variable] = by_active[:, a].reshape(n, 9)
        by_H = (by_L @ stretch.gradient.swapaxes(1, 2)).reshape(n, 3, 3, 3, 3)
        for found in (K, by_H, by_p):
            found[missing] = np.nan
        return K, by_H, by_p

    def slopes(self, states: MacroState) -> Array:
        """Return the derivatives (n, 3, 3, m) of K_ref by the parameters; NaN where det F ≤ 0."""
        _, t, at, scaling, missing = self._at(states, slopes=True)
        assert states.parameters is not None
        assert at.slopes is not None
        parameters, theta = self.rest.parameters, states.parameters
        S, by_t, by_x, steepness = self._beyond(t, at, by_coordinates=True)
        m, r = len(parameters.kinds), S.shape[-1]
        ways = np.zeros((len(S), m, r, r))
        ways[:, parameters.learned] = np.moveaxis(at.slopes.log_conductivity, 0, 1)
        ways[:, parameters.learned] += np.einsum("ncij,cln->nlij", by_x, at.slopes.x)
        for k, kind in enumerate(parameters.kinds):
            change, power = np.zeros_like(t), 0
            if kind == "modulus":
                change[[a == 6 for a in self.active]] = -t[[a == 6 for a in self.active]] / theta[:, k]
            elif kind == "swelling":
                change[[a < 3 for a in self.active]], power = -1 / theta[:, k], 3
            elif kind == "viscosity":
                power = -1
            ways[:, k] += np.einsum("naij,an->nij", by_t, change * steepness)
            ways[:, k] += (power / theta[:, k])[:, None, None] * np.eye(r)
        _, dE = symmetric_exponential(S, ways)
        found = self._in_space(dE) * (scaling.stretch**3 / scaling.viscosity)[:, None, None, None]
        found[missing] = np.nan
        return np.moveaxis(found, 1, -1)

    def error(self, states: MacroState) -> Array:
        """Return NaN (n,): there is no estimate."""
        return np.full(len(states), np.nan)

    def outside(self, states: MacroState) -> npt.NDArray[np.bool_]:
        """Return which of n states are flagged: those far from all that have a conductivity."""
        unrotated = self.sampled.inputs.without_rotation(states)
        return (self.sampled.outside if self.closing else self.sampled.far)(unrotated)

    def next_to_closed(self, states: MacroState) -> npt.NDArray[np.bool_]:
        """Return which of n states within all ranges are flagged since pores are closed in sampled states there."""
        inputs = self.sampled.inputs
        unrotated = inputs.without_rotation(states)
        unit = inputs.to_unit(inputs.gather(unrotated))
        near: npt.NDArray[np.bool_] = ((unit >= 0) & (unit <= 1)).all(axis=1) & self.closing
        return near & self.sampled.outside(unrotated)

    def _at(
        self, states: MacroState, slopes: bool = False
    ) -> tuple[LogStretch, Array, RestValues, Scaling, npt.NDArray[np.bool_]]:
        self.sampled.inputs.require_parameters(states)
        theta = states.parameters
        assert theta is not None
        stretch = LogStretch.from_gradient(states.grad_u)
        scaling = Scaling.from_parameters(self.rest.parameters, theta)
        t = scaling.inner(variables(stretch, states.p))[list(self.active)]
        missing = ~np.isfinite(t).all(axis=0)
        t[:, missing] = 0.0
        at = self.rest.at(theta, slopes=True) if slopes else self.rest.together(theta)
        return stretch, t, at, scaling, missing

    def _beyond(
        self, t: Array, at: RestValues, by_coordinates: bool = False
    ) -> tuple[Array, Array, Array, Array]:
        """Return S (n, r, r), its derivatives by the saturated t (n, d, r, r), by θ̂ (n, l, r, r), and dt/dt (d, n)."""
        steepness = np.ones_like(t)
        beyond = self.training_box.beyond_active(t)
        if len(beyond):
            t = t.copy()
            t[:, beyond], steepness[:, beyond], _ = self.training_box.saturated_active(t[:, beyond])
        if by_coordinates:
            value, first, _ = self.polynomial.entries(np.concatenate([t, at.x]), second=False)
        else:
            bound = self._latest.of(at, lambda: self._by_y.at(at.coordinates))
            value, first, _ = bound.entries(t, second=False)
        (d, n), r = t.shape, at.log_conductivity.shape[1]
        gradients = np.zeros((n, d + (len(at.x) if by_coordinates else 0), r, r))
        triangles: dict[int, Array] = {}
        for (o, a), row in first:
            triangles.setdefault(a, np.zeros((6, n)))[o] = row
        for a, components in triangles.items():
            gradients[:, a] = self._matrices(components)
        return at.log_conductivity + self._matrices(value), gradients[:, :d], gradients[:, d:], steepness

    @cached_property
    def _latest(self) -> Latest[RestValues, BoundPolynomial]:
        return Latest()

    @cached_property
    def _by_y(self) -> VaryingPolynomial:
        return VaryingPolynomial(self.polynomial, len(self.active))

    def _matrices(self, components: Array) -> Array:
        """Return the symmetric (n, r, r) on the directions of B from the upper triangle (6, n) of matrices in space."""
        S, basis = np.empty((components.shape[1], 3, 3)), self.rest.basis
        for row, (i, j) in zip(components, triangle(3), strict=True):
            S[:, i, j] = S[:, j, i] = row
        found: Array = S if basis.shape[1] == 3 else basis.T @ S @ basis
        return found

    def _in_space(self, E: Array) -> Array:
        space: Array = self.rest.basis @ E @ self.rest.basis.T
        return space


def fit_family_conductivity(data: TrainingSet, rest: RestModel) -> tuple[FamilyConductivity, float] | None:
    """Return a model of K_ref and its cross-validated error in ln K; None where the states hold no conductivity.

    Raises
    ------
    DataError
        Too few states have a conductivity, or the undeformed members have none.
    """
    K = data.responses.conductivity
    if K is None:
        return None
    basis, theta = rest.basis, data.states.parameters
    if basis.shape[1] == 0:
        raise DataError(
            "the undeformed members have no conductivity, so that of the deformed pore cannot be learned; sample again"
        )
    assert theta is not None
    finite = data.responses.stable & np.isfinite(K).all(axis=(1, 2))
    scaling = Scaling.from_parameters(rest.parameters, theta)
    inside = basis.T @ np.where(finite[:, None, None], K, np.eye(3)) @ basis
    kept = np.flatnonzero(finite & (np.linalg.eigvalsh(inside)[:, 0] > 0))
    if len(kept) < 2:
        raise DataError(
            f"only {len(kept)} of {len(K)} stable states have a conductivity of the deformed pore; sample where no "
            "walls touch, or choose conductivity: piola"
        )
    states, factor = data.states[kept], (scaling.viscosity / scaling.stretch**3)[kept]
    y = scaling.inner(variables(LogStretch.from_gradient(data.states.grad_u), data.states.p))[:, kept]
    at = rest.at(theta[kept], slopes=True)
    joint = _joint_data(data, rest, at, y, kept, factor)
    active = tuple(int(a) for a in np.flatnonzero(np.abs(y).max(axis=1) > STILL))
    group = stabiliser(data.symmetry, active)
    tied = Equivariance(beside(on_variables(group).on(list(active)), len(at.x)), on_triangle(group))
    found = fit_joint(
        joint, plain(active), 1, tied=tied, weights=WEIGHTS, judged="value", highest=LARGEST_DEGREE
    )
    error = found.error * float(joint.value.std(axis=1).max())
    model = FamilyConductivity(
        rest,
        found.polynomial,
        active,
        TrainingBox.from_states(y, active, data.symmetry),
        SampledRange.around(data.inputs, data.inputs.gather(states)),
        closing=len(kept) < int(data.responses.stable.sum()),
    )
    return model, error


def _joint_data(
    data: TrainingSet, rest: RestModel, at: RestValues, y: Array, kept: IntArray, factor: Array
) -> JointData:
    """Return the upper triangle of ln K_ref beyond rest and its slopes by θ̂ where they are known."""
    basis, n, l = rest.basis, len(kept), len(at.x)
    r = basis.shape[1]
    K, s = data.responses.conductivity, data.responses.slopes
    assert K is not None
    assert at.slopes is not None
    inside = basis.T @ (K[kept] * factor[:, None, None]) @ basis
    ways = np.zeros((n, l, r, r))
    known = s is not None and s.conductivity is not None
    if s is not None and s.conductivity is not None:
        given = np.moveaxis(s.conductivity[kept][..., rest.parameters.learned], -1, 1)
        known = bool(np.isfinite(given).all())
        given = given * factor[:, None, None, None]
        ways = basis.T @ (given + given.swapaxes(-1, -2)) @ basis / 2
    S, S_slopes = symmetric_logarithm((inside + inside.swapaxes(1, 2)) / 2, np.nan_to_num(ways))
    back = np.linalg.inv(np.moveaxis(at.slopes.x, -1, 0))
    by_theta = S_slopes - np.moveaxis(at.slopes.log_conductivity, 0, 1)
    by_x = np.einsum("nkij,nkc->ncij", by_theta, back)
    places = triangle(3)
    change, slopes = basis @ (S - at.log_conductivity) @ basis.T, basis @ by_x @ basis.T
    value = np.stack([change[:, i, j] for i, j in places])
    by = np.stack([slopes[:, :, i, j].T for i, j in places]) if known else np.full((6, l, n), np.nan)
    return JointData(y, at.x, value, np.full((6, 7, n), np.nan), by)


def with_family_error(model: FamilyModel, data: FamilyData, tolerance: float | None) -> FamilyModel:
    """Return the model with an estimate of the errors of stress and fluid volume; as it is where none is asked for.

    What is judged are the derivatives of R by y, beyond the rest that is exact, as shares of the ranges of stress and
    fluid volume.
    """
    if tolerance is None:
        return model
    terms, joint = terms_of(data), data.potential
    l, n = joint.x.shape
    whole = _with_coordinates(terms, l)
    judged = tuple(int(a) for a in np.flatnonzero(terms.polynomial.exponents.any(axis=0)))
    ranges = np.ptp(data.stress, axis=1)
    ranges[:6] = ranges[:6].max()
    ranges[ranges == 0] = 1.0
    spread = ranges / float(np.sqrt((data.scale**2).mean()))
    exponents = _monomials(terms, l, n * (1 + len(judged) + l))
    columns = design(terms, exponents, joint.y, joint.x, second=False)
    by_value = joint.value.std() or 1.0
    slopes = np.isfinite(joint.by_x[0]).all(axis=1)
    by_x = np.maximum(np.nan_to_num(joint.by_x[0, slopes]).std(axis=1), 1e-3 * by_value)[:, None]
    scale = spread[list(judged), None]
    rows = [
        columns.value[:, None] / by_value,
        columns.by_y[:, list(judged)] / scale,
        columns.by_x[:, slopes] / by_x,
    ]
    right = [
        joint.value[:, None] / by_value,
        joint.by_y[:, list(judged)] / scale,
        joint.by_x[:, slopes] / by_x,
    ]
    k = len(terms.weights)
    degrees = exponents[:, :k] @ np.array(terms.weights, dtype=np.int64) + exponents[:, k:].sum(axis=1)
    count = np.cumsum([1, len(judged), int(slopes.sum())])
    is_judged = (np.arange(count[-1]) >= count[0]) & (np.arange(count[-1]) < count[1])
    equations = Equations(np.concatenate(rows, axis=1), np.concatenate(right, axis=1), degrees, is_judged)
    coefficients, nugget = draw(equations)
    found = estimate(
        Polynomial(exponents, coefficients.reshape(-1, len(exponents))),
        nugget,
        tolerance,
        spread[list(judged)],
        np.concatenate([joint.y, joint.x]),
        lambda z: model.beyond_rest(z[:VARIABLES], z[VARIABLES:])[1][list(judged)],
        terms=whole,
        judged=judged,
        active=(*data.active, *range(VARIABLES, VARIABLES + l)),
    )
    return replace(model, estimate=replace(found, coordinates=l))


def _with_coordinates(terms: Terms, l: int) -> Polynomial:
    """Return the polynomial (y, θ̂) → (t, θ̂)."""
    k, K = terms.polynomial.coefficients.shape
    exponents = np.zeros((K + l, VARIABLES + l), dtype=np.int64)
    exponents[:K, :VARIABLES] = terms.polynomial.exponents
    exponents[K:, VARIABLES:] = np.eye(l, dtype=np.int64)
    coefficients = np.zeros((k + l, K + l))
    coefficients[:k, :K], coefficients[k:, K:] = terms.polynomial.coefficients, np.eye(l)
    return Polynomial(exponents, coefficients)


def _monomials(terms: Terms, l: int, equations: int) -> IntArray:
    """Return monomials of as high a degree as two coefficients for each equation allow."""
    found = joint_exponents(terms, l, 3, 3, 1)
    for degree in range(4, HIGHEST + 1):
        more = joint_exponents(terms, l, 3, degree, 1)
        if len(more) > min(MOST_MONOMIALS, 2 * equations):
            break
        found = more
    return found
