"""Conductivity of the deformed pore by (ln U, p; θ): prediction, flags near a closed pore, fit, estimated error.

K_ref = (λ³/μ) B exp(S) Bᵀ with S = ln(Bᵀ K(θ) B) + a polynomial in (ln U − ln λ I, p/E; θ̂) that begins at first order
in the first two; θ, and with it θ̂, may have no components. So K_ref is that of the undeformed cell at rest for every θ,
symmetric and positive definite for any coefficients, and objective, as it depends on F through U only. The columns of B
span the directions in which the pore space is open; closed directions stay closed under any deformation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement

import numpy as np
import numpy.typing as npt

from porocore.core.inputs import SampledRange
from porocore.core.tensors import exponential, logarithm, symmetric_exponential, symmetric_logarithm
from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, Doubt, IntArray, MacroState
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.error_estimate.fit import Equations, draw, estimate, monomials
from porocore.surrogates.family.coordinates import Scaling
from porocore.surrogates.family.fit import JointData, Weights, beside, fit_joint
from porocore.surrogates.family.joint import Latest, joint_exponents
from porocore.surrogates.family.rest import RestModel
from porocore.surrogates.polynomial.fit import EQUATIONS_PER_TERM, FOLDS, held_out, tied_least_squares
from porocore.surrogates.polynomial.monomials import Polynomial, plain
from porocore.surrogates.polynomial.varying import BoundPolynomial, VaryingPolynomial
from porocore.surrogates.potential import STILL, variables
from porocore.surrogates.rest import Rest, RestValues, SingleRest
from porocore.surrogates.stretch import LogStretch
from porocore.surrogates.symmetry import Equivariance, on_triangle, on_variables, stabiliser
from porocore.surrogates.training_box import TrainingBox


@dataclass(frozen=True, eq=False)
class ConductivityModel:
    """Model of K_ref of a cell, or of every member of a family, for any state.

    Attributes
    ----------
    rest
        Undeformed cells.
    polynomial
        Upper triangle of S beyond rest, a matrix in space (3, 3), row by row, in the variables ``active`` and θ̂.
    active
        Variables that were sampled.
    training_box
        Box of the training states; beyond it the polynomial saturates.
    sampled
        Hull of the training states that have a conductivity.
    estimate
        Estimate of the errors of ln K_ref, which flags states; None: those beyond the hull are flagged.
    closing
        Some training states have no conductivity, since pore walls touch. No smooth function covers both kinds, so
        states beyond the hull are flagged whatever the estimate.
    """

    rest: Rest
    polynomial: Polynomial
    active: tuple[int, ...]
    training_box: TrainingBox
    sampled: SampledRange
    estimate: ErrorEstimate | None = None
    closing: bool = False

    def predict(self, states: MacroState, *, tangent: bool) -> tuple[Array, Array | None, Array | None]:
        """Return K_ref (n, 3, 3), NaN where det F ≤ 0, and if ``tangent`` its derivatives.

        These are ∂K_ref/∂H (n, 3, 3, 3, 3) and ∂K_ref/∂p (n, 3, 3).
        """
        stretch, t, at, scaling, missing = self._at(states)
        factor = (scaling.stretch**3 / scaling.viscosity)[:, None, None]
        if not tangent:
            K = self._in_space(exponential(self._logarithm(t, at))) * factor
            K[missing] = np.nan
            return K, None, None
        S, by_t, _, steepness = self._derivatives(t, at)
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
        parameters, theta = self.rest.parameters, states.parameters
        assert parameters is not None
        assert theta is not None
        assert at.slopes is not None
        S, by_t, by_x, steepness = self._derivatives(t, at, by_coordinates=True)
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

    # ---- flags -----------------------------------------------------------------------------------

    def error(self, states: MacroState) -> Array:
        """Return the estimated error (n,) of ln K_ref, a share of its range; NaN without an estimate."""
        if self.estimate is None:
            return np.full(len(states), np.nan)
        z, at = self._inputs(states)
        return self.estimate.error(z, self.beyond_rest(z, at))

    def doubt(self, states: MacroState) -> IntArray:
        """Return the doubts (n,) of states: far from all that have a conductivity, or by the estimated error.

        Those within all ranges beside which pores are closed in sampled states have a doubt of their own.
        """
        inputs, judge = self.sampled.inputs, self.estimate
        unrotated = inputs.without_rotation(states)
        found = self.sampled.far(unrotated) if judge and not self.closing else self.sampled.doubt(unrotated)
        if self.closing:
            unit = inputs.to_unit(inputs.gather(unrotated))
            near = ((unit >= 0) & (unit <= 1)).all(axis=1) & (found == int(Doubt.outside))
            found = np.where(near, int(Doubt.closed), found)
        if judge is None:
            return found
        z, at = self._inputs(states)
        members = self._latest_members.of(at, lambda: judge.at(at.coordinates)) if len(at.x) else None
        return found | Doubt.where(error=judge.flagged(z, self.beyond_rest(z, at), members))

    def beyond_rest(self, z: Array, at: RestValues | None = None) -> Array:
        """Return the upper triangle (6, n) of S less its value at rest, at active variables and θ̂ z (d + l, n).

        ``at`` are the undeformed members there, if they are known.
        """
        d = len(self.active)
        t = self._saturated(z[:d])[0]
        return (
            self.polynomial.evaluate(np.concatenate([t, z[d:]]))
            if at is None
            else self._bound(at).evaluate(t)
        )

    def _inputs(self, states: MacroState) -> tuple[Array, RestValues]:
        """Return the active variables, NaN where det F ≤ 0, and θ̂, (d + l, n); the undeformed members."""
        _, t, at, _, missing = self._at(states)
        t[:, missing] = np.nan
        return (np.concatenate([t, np.broadcast_to(at.x, (len(at.x), t.shape[1]))]) if len(at.x) else t), at

    # ---- parts -----------------------------------------------------------------------------------

    def _at(
        self, states: MacroState, slopes: bool = False
    ) -> tuple[LogStretch, Array, RestValues, Scaling, npt.NDArray[np.bool_]]:
        self.sampled.inputs.require_parameters(states)
        stretch = LogStretch.from_gradient(states.grad_u)
        scaling = self.rest.scaling(states.parameters)
        t = scaling.inner(variables(stretch, states.p))[list(self.active)]
        missing = ~np.isfinite(t).all(axis=0)
        t[:, missing] = 0.0
        return stretch, t, self.rest.together(states.parameters, slopes=slopes), scaling, missing

    def _saturated(self, t: Array) -> tuple[Array, Array]:
        """Return t (d, n) saturated beyond the sampled box, and its derivative by t (d, n)."""
        saturated, steepness = t.copy(), np.ones_like(t)
        beyond = self.training_box.beyond_active(t)
        if len(beyond):
            saturated[:, beyond], steepness[:, beyond], _ = self.training_box.saturated_active(t[:, beyond])
        return saturated, steepness

    def _logarithm(self, t: Array, at: RestValues) -> Array:
        """Return S (n, r, r) at t (d, n)."""
        return at.log_conductivity + self._matrices(self._bound(at).evaluate(self._saturated(t)[0]))

    def _derivatives(
        self, t: Array, at: RestValues, by_coordinates: bool = False
    ) -> tuple[Array, Array, Array, Array]:
        """Return S (n, r, r), its derivatives by the saturated t (n, d, r, r), by θ̂ (n, l, r, r), and dt/dt (d, n)."""
        t, steepness = self._saturated(t)
        if by_coordinates:
            x = np.broadcast_to(at.x, (len(at.x), t.shape[1]))
            value, first, _ = self.polynomial.entries(np.concatenate([t, x]), second=False)
        else:
            value, first, _ = self._bound(at).entries(t, second=False)
        (d, n), r = t.shape, at.log_conductivity.shape[1]
        gradients = np.zeros((n, d + (len(at.x) if by_coordinates else 0), r, r))
        triangles: dict[int, Array] = {}
        for (o, a), row in first:
            triangles.setdefault(a, np.zeros((6, n)))[o] = row
        for a, components in triangles.items():
            gradients[:, a] = self._matrices(components)
        return at.log_conductivity + self._matrices(value), gradients[:, :d], gradients[:, d:], steepness

    def _bound(self, at: RestValues) -> BoundPolynomial:
        return self._latest.of(at, lambda: self._by_y.at(at.coordinates))

    @cached_property
    def _latest(self) -> Latest[RestValues, BoundPolynomial]:
        return Latest()

    @cached_property
    def _latest_members(self) -> Latest[RestValues, BoundPolynomial]:
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


def triangle(r: int) -> list[tuple[int, int]]:
    """Return the places of the upper triangle of an r × r matrix, row by row."""
    return list(combinations_with_replacement(range(r), 2))


#: A component whose range is smaller than this share of the tolerance cannot miss it.
SMALL = 0.1


def with_conductivity_error(
    model: ConductivityModel, z: Array, S: Array, tied: Equivariance, tolerance: float
) -> ConductivityModel:
    """Return the model with an estimate of the errors of ln K_ref.

    The polynomials of the estimate have the symmetry of the cell, as the model has it, so that each state counts for
    all its images. Errors are shares of the range of the component of ln K_ref that varies most.

    Parameters
    ----------
    model
        Without an estimate.
    z : (d + l, n)
        Active variables and θ̂ of the states that have a conductivity.
    S : (6, n)
        Upper triangle of ln K_ref less its value at rest there.
    tied
        The symmetry of S(z).
    tolerance
        Errors beyond it are flagged.
    """
    n = z.shape[1]
    ranges = np.ptp(S, axis=1)
    spread = float(ranges.max()) or 1.0
    varies = ranges > SMALL * tolerance * spread
    # The symmetry ties other components to those that vary.
    learned = sorted(row for together in tied.outputs.orbits() if varies[together].any() for row in together)
    if not learned:
        return model
    ways = Equivariance(tied.variables, tied.outputs.on(learned))
    terms, l = plain(model.active), model.rest.learned
    exponents = monomials(
        n * len(learned),
        lambda low, high: joint_exponents(terms, l, low, high, 1 if l else 0),
        1,
        count=lambda found: ways.ties(found).count,
    )
    rows, degrees = _rows(exponents, ways, z)
    right = S[None, learned] / spread
    draws, nugget = draw(Equations(rows, right, degrees, np.ones(len(learned), dtype=bool)))
    coefficients = np.zeros((len(draws), 6, len(exponents)))
    ties = ways.ties(exponents)
    coefficients[:, learned] = [spread * ties.coefficients(free) for free in draws[:, 0]]
    members = Polynomial(exponents, coefficients.reshape(-1, len(exponents)))
    found = estimate(members, nugget, tolerance, np.full(6, spread), z, model.beyond_rest)
    return replace(model, estimate=replace(found, coordinates=l))


def _rows(exponents: IntArray, ways: Equivariance, z: Array) -> tuple[Array, IntArray]:
    """Return what each free coefficient brings to the components at z (v, n), (F, c, n), and its degree (F,)."""
    ties = ways.ties(exponents)
    values = Polynomial.monomials(exponents).evaluate(z)
    rows = np.zeros((ties.count, len(ties.number), z.shape[1]))
    degrees = np.zeros(ties.count, dtype=np.int64)
    for component, (numbers, signs) in enumerate(zip(ties.number, ties.sign, strict=True)):
        free = numbers >= 0
        np.add.at(rows[:, component], numbers[free], signs[free, None] * values[free])
        degrees[numbers[free]] = exponents[free].sum(axis=1)
    return rows, degrees


#: Values and slopes by θ̂ of ln K_ref; no others are known from the solved states.
WEIGHTS = Weights(by_y=0.0, by_x=1.0, by_yy=0.0, by_yx=0.0)
LARGEST_DEGREE = 6


def fit_conductivity(data: TrainingSet, rest: Rest | None = None) -> tuple[ConductivityModel, float] | None:
    """Return a model of K_ref and its cross-validated error in ln K; None where the states hold no conductivity.

    The polynomial turns with the operations of the cell that lead from the sampled variables to no others:
    K_ref(Q F Qᵀ) = Q K_ref(F) Qᵀ. ``rest`` are the undeformed cells; None: the one of the training set.

    Raises
    ------
    DataError
        Too few states have a conductivity, or the undeformed cell has none.
    """
    rest = SingleRest.of_conductivity(data.reference, data.symmetry) if rest is None else rest
    K, basis = data.responses.conductivity, rest.basis
    if K is None or (rest.parameters is None and data.reference.conductivity is None):
        return None
    if basis.shape[1] == 0:
        raise DataError(
            "the undeformed pore conducts in no direction, so there is no conductivity to learn"
            if rest.parameters is None
            else "the undeformed members have no conductivity, so that of the deformed pore cannot be learned; "
            "sample again"
        )
    finite = data.responses.stable & np.isfinite(K).all(axis=(1, 2))
    inside = basis.T @ np.where(finite[:, None, None], K, np.eye(3)) @ basis
    kept = np.flatnonzero(finite & (np.linalg.eigvalsh(inside)[:, 0] > 0))
    if len(kept) < 2:
        raise DataError(
            f"only {len(kept)} of {len(K)} stable states have a conductivity of the deformed pore; sample where no "
            "walls touch, or choose conductivity: piola"
        )
    states = data.states[kept]
    y = rest.scaling(states.parameters).inner(variables(LogStretch.from_gradient(states.grad_u), states.p))
    active = tuple(int(a) for a in np.flatnonzero(np.abs(y).max(axis=1) > STILL))
    group = stabiliser(data.symmetry, active)
    tied = Equivariance(beside(on_variables(group).on(list(active)), rest.learned), on_triangle(group))
    joint = _joint_data(data, rest, y, kept)
    if rest.parameters is None:
        polynomial, error = _fit(y[list(active)], joint.value, active, tied)
    else:
        found = fit_joint(
            joint, plain(active), 1, tied=tied, weights=WEIGHTS, judged="value", highest=LARGEST_DEGREE
        )
        polynomial, error = found.polynomial, found.error * float(joint.value.std(axis=1).max())
    model = ConductivityModel(
        rest,
        polynomial,
        active,
        TrainingBox.from_states(y, active, data.symmetry),
        SampledRange.around(data.inputs, data.inputs.gather(states)),
        closing=len(kept) < int(data.responses.stable.sum()),
    )
    if data.tolerance is not None:
        z = np.concatenate([y[list(active)], joint.x])
        model = with_conductivity_error(model, z, joint.value, tied, data.tolerance)
    return model, error


def _joint_data(data: TrainingSet, rest: Rest, y: Array, kept: IntArray) -> JointData:
    """Return the upper triangle of ln K_ref beyond rest and its slopes by θ̂ where they are known."""
    basis, theta, n = rest.basis, data.states[kept].parameters, len(kept)
    K, s = data.responses.conductivity, data.responses.slopes
    assert K is not None
    scaling, unknown = rest.scaling(theta), np.full((6, 7, n), np.nan)

    def upper(change: Array) -> Array:
        space = basis @ change @ basis.T
        return np.stack([space[:, i, j] for i, j in triangle(3)])

    factor = scaling.viscosity / scaling.stretch**3
    inside = basis.T @ (K[kept] * factor[:, None, None]) @ basis
    if rest.parameters is None:
        value = upper(logarithm(inside) - rest.together(None).log_conductivity)
        return JointData(y, np.zeros((0, n)), value, unknown, np.zeros((6, 0, n)))
    assert isinstance(rest, RestModel)
    assert theta is not None
    at, r = rest.at(theta, slopes=True), basis.shape[1]
    assert at.slopes is not None
    l = len(at.x)
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
    by_x = basis @ np.einsum("nkij,nkc->ncij", by_theta, back) @ basis.T
    by = np.stack([by_x[:, :, i, j].T for i, j in triangle(3)]) if known else np.full((6, l, n), np.nan)
    return JointData(y, at.x, upper(S - at.log_conductivity), unknown, by)


def _fit(t: Array, S: Array, active: tuple[int, ...], tied: Equivariance) -> tuple[Polynomial, float]:
    """Return the polynomial fitted to the upper triangle S (6, n) of ln K less its value at rest, and its error.

    The error is the cross-validated root mean square.
    """
    terms = plain(active)
    errors: dict[int, float] = {}
    for degree in range(1, LARGEST_DEGREE + 1):
        exponents = terms.monomials(1, degree)
        free = tied.ties(exponents).count
        if free * EQUATIONS_PER_TERM > S.size * (1 - 1 / FOLDS) and errors:
            break
        wrong = np.empty_like(S)
        for test in held_out(S.shape[1]):
            wrong[:, test] = _solve(t[:, ~test], S[:, ~test], exponents, tied).evaluate(t[:, test])
        errors[degree] = float(np.sqrt(((wrong - S) ** 2).mean()))
    best = min(errors, key=lambda degree: errors[degree])
    return _solve(t, S, terms.monomials(1, best), tied), errors[best]


def _solve(t: Array, S: Array, exponents: IntArray, tied: Equivariance) -> Polynomial:
    """Return the least-squares polynomial of the outputs S (6, n) at t (variables, n)."""
    rows = Polynomial.monomials(exponents).evaluate(t).T
    return Polynomial(exponents, tied_least_squares([(rows, right) for right in S], exponents, tied))
