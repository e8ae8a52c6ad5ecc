"""Undeformed members as functions of θ (RestModel), and their fit to solved ones.

W₂(y; θ) = W₀ + g·y + ½ y·A y. The drained stiffness is A_LL = N^½ exp(S) N^½ in Mandel's components, N isotropic with
the upper bounds of Hashin and Shtrikman, S(θ̂) a symmetric polynomial: positive definite for all coefficients. What an
isotropic solid that is the same everywhere ties to it is not learned but follows: Biot's coupling and modulus from
the state in which solid and fluid bear the same pressure, and the linear ⟨∇u¹⟩ from the mean stress of the solid.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from porocore.core.inputs import InputSpace
from porocore.core.tensors import PointGroup, exponential, symmetric_exponential, symmetric_logarithm
from porocore.errors import DataError
from porocore.interfaces.records import RestData
from porocore.states import Array, IntArray
from porocore.surrogates.family.coordinates import (
    MANDEL,
    Bounds,
    ParameterMap,
    Scaling,
    bounds,
    normaliser,
    tied,
)
from porocore.surrogates.family.derivatives import PotentialSlopes
from porocore.surrogates.polynomial.fit import FOLDS, held_out, least_squares
from porocore.surrogates.polynomial.monomials import Polynomial, exponents_up_to
from porocore.surrogates.rest import Rest, RestValues, conducting_basis
from porocore.surrogates.stretch import PLACES
from porocore.surrogates.symmetry import on_one, on_places, on_variables

#: Sets of parameters whose rest is kept.
KEPT = 4


@dataclass(frozen=True, eq=False)
class KnownRest:
    """Undeformed members at parameters that were asked for.

    Attributes
    ----------
    theta : (n, m)
        θ.
    values, rows
        Members, and which of them the points have; None: one each.
    """

    theta: Array
    values: RestValues
    rows: IntArray | None = None

    @cached_property
    def at_points(self) -> RestValues:
        """The members at the n points."""
        return self.values if self.rows is None else self.values.take(self.rows)


@dataclass(frozen=True, eq=False)
class RestModel(Rest):
    """Model of the undeformed members.

    Attributes
    ----------
    parameters
        Kinds and coordinates of θ.
    symmetry
        Point group that all members have.
    centre, half : (l,)
        θ̂ = (coordinates − centre)/half.
    porosity
        Polynomial of the shape coordinates, one output.
    stiffness
        S, 36 outputs, of θ̂.
    level : float
        N where there are no bounds.
    affine
        W₀ and g, 8 outputs, beyond W₀ = 0, g = (0, −φ_f); without monomials where these are exact.
    coupling
        Last row of A, 7 outputs, beyond what the solid ties to the stiffness.
    mean
        ⟨∇u¹⟩_s at y = 0 and its derivatives by y, 9 + 63 outputs, beyond the same.
    basis : (3, r)
        B, directions in which the pores conduct; r = 0 where no conductivity is known.
    conductivity
        ln(Bᵀ K B), r² outputs.
    """

    parameters: ParameterMap
    symmetry: PointGroup
    centre: Array
    half: Array
    porosity: Polynomial
    stiffness: Polynomial
    level: float
    affine: Polynomial
    coupling: Polynomial
    mean: Polynomial
    basis: Array
    conductivity: Polynomial

    def at(self, theta: Array, *, slopes: bool = False) -> RestValues:
        """Return the undeformed members at θ (n, m); those of the last parameters are kept."""
        return self._known(theta, slopes).at_points

    def together(self, theta: Array | None, *, slopes: bool = False) -> RestValues:
        """Return the same; of one point, n = 1, where all parameters are the same."""
        assert theta is not None
        known = self._known(theta, slopes)
        return known.values if known.values.x.shape[1] == 1 else known.at_points

    def _known(self, theta: Array, slopes: bool) -> KnownRest:
        kept = self._kept
        for i, known in enumerate(kept):
            if (not slopes or known.values.slopes is not None) and np.array_equal(known.theta, theta):
                kept.insert(0, kept.pop(i))
                return known
        unique, rows = np.unique(theta, axis=0, return_inverse=True)
        if len(unique) <= len(theta) // 2:
            found = KnownRest(theta.copy(), self._compute(unique, slopes), rows.reshape(-1))
        else:
            found = KnownRest(theta.copy(), self._compute(theta, slopes))
        kept.insert(0, found)
        del kept[KEPT:]
        return found

    @cached_property
    def _kept(self) -> list[KnownRest]:
        return []

    def coordinates(self, theta: Array) -> tuple[Array, Array, Array, Array]:
        """Return θ̂ (l, n), its derivatives by θ (l, l, n), φ_f (n,) and its derivatives (l, n)."""
        shape, slope = self.parameters.shape(theta)
        phi, by_shape, _ = self.porosity.derivatives(shape.T, second=False)
        phi_slopes = by_shape[0].T * slope
        x, J = self.parameters.smooth(theta, phi[0], phi_slopes)
        scaled = ((x - self.centre) / self.half).T
        return scaled, np.moveaxis(J / self.half[:, None], 0, -1), phi[0], phi_slopes.T

    def conductivities(self, theta: Array) -> Array | None:
        """Return K (n, 3, 3) of the undeformed pore at θ (n, m); None where it is not known."""
        if not self.basis.shape[1]:
            return None
        _, _, viscosity = self.parameters.factors(theta)
        found: Array = self.basis @ exponential(self.at(theta).log_conductivity) @ self.basis.T
        return found / viscosity[:, None, None]

    def conductivity_slopes(self, theta: Array) -> Array | None:
        """Return the derivatives (n, 3, 3, m) of K of the undeformed pore by θ; None where it is not known."""
        if not self.basis.shape[1]:
            return None
        at, kinds, r = self.together(theta, slopes=True), self.parameters.kinds, self.basis.shape[1]
        assert at.slopes is not None
        n = at.x.shape[1]
        if n == 1 < len(theta):
            same = self.conductivity_slopes(theta[:1])
            return None if same is None else np.broadcast_to(same, (len(theta), *same.shape[1:]))
        _, _, viscosity = self.parameters.factors(theta)
        ways = np.zeros((n, len(kinds), r, r))
        ways[:, self.parameters.learned] = np.moveaxis(at.slopes.log_conductivity, 0, 1)
        for k in np.flatnonzero(np.array(kinds) == "viscosity"):
            ways[:, k] = -np.eye(r) / theta[:, k, None, None]
        _, found = symmetric_exponential(at.log_conductivity, ways)
        found = self.basis @ found @ self.basis.T / viscosity[:, None, None, None]
        return np.moveaxis(found, 1, -1)

    def _compute(self, theta: Array, slopes: bool) -> RestValues:
        x, J, phi, phi_slopes = self.coordinates(theta)
        if not slopes:
            J, phi_slopes = J[:, :0], phi_slopes[:0]
        solid = self.solid(theta, phi, phi_slopes) if self.parameters.isotropic else None
        C, C_slopes = self._stiffness(x, J, solid)
        wave = np.einsum("aan->n", C) / 6 if solid is None else solid[0].wave
        wave_slopes = np.einsum("aaln->ln", C_slopes) / 6 if solid is None else solid[1].wave
        A, A_slopes, m, m_slopes = tied(C, C_slopes, phi, phi_slopes, solid)
        more, more_slopes = _chained(self.coupling, x, J)
        A[6] += more
        A[:6, 6] += more[:6]
        affine, affine_slopes = _chained(self.affine, x, J)
        mean, mean_slopes = _chained(self.mean, x, J)
        K, K_slopes = _chained(self.conductivity, x, J)
        r, n = self.basis.shape[1], len(theta)
        affine[7] -= phi
        found = None
        if slopes:
            A_slopes[6] += more_slopes
            A_slopes[:6, 6] += more_slopes[:6]
            affine_slopes[7] -= phi_slopes
            m_slopes += mean_slopes[9:].reshape(9, 7, *mean_slopes.shape[1:])
            found = RestValues(
                J, phi_slopes, affine_slopes[0], affine_slopes[1:], A_slopes, mean_slopes[:9], m_slopes,
                wave_slopes, np.moveaxis(K_slopes.reshape(r, r, len(x), n), (2, 3), (0, 1)),
            )  # fmt: skip
        m += mean[9:].reshape(9, 7, n)
        log_K = np.moveaxis(K.reshape(r, r, n), -1, 0)
        return RestValues(x, phi, affine[0], affine[1:], A, mean[:9], m, wave, log_K, found)

    def solid(self, theta: Array, phi: Array, phi_slopes: Array) -> tuple[Bounds, Bounds]:
        """Return the bounds (n,) and their derivatives (l, n) by θ, as many as those of φ_f."""
        nu, nu_slopes = self.parameters.poisson_ratio(theta)
        values, by_phi, by_nu = bounds(phi, nu)
        by = [
            getattr(by_phi, name) * phi_slopes + getattr(by_nu, name) * nu_slopes.T[: len(phi_slopes)]
            for name in ("bulk", "shear", "drained", "wave")
        ]
        return values, Bounds(*by)

    def _stiffness(self, x: Array, J: Array, solid: tuple[Bounds, Bounds] | None) -> tuple[Array, Array]:
        """Return the stiffness in Mandel's components (6, 6, n) and its derivatives (6, 6, l, n)."""
        n = x.shape[1]
        S, S_slopes = _chained(self.stiffness, x, J)
        S_slopes = S_slopes.reshape(6, 6, J.shape[1], n)
        E, E_slopes = symmetric_exponential(
            np.moveaxis(S.reshape(6, 6, n), -1, 0), np.moveaxis(S_slopes, (2, 3), (1, 0))
        )
        if solid is None:
            return self.level * np.moveaxis(E, 0, -1), self.level * np.moveaxis(E_slopes, (0, 1), (3, 2))
        root, root_slopes = normaliser(*solid)
        C = root @ E @ root
        left = root_slopes @ (E @ root)[:, None]
        C_slopes = left + left.swapaxes(-1, -2) + root[:, None] @ E_slopes @ root[:, None]
        return np.moveaxis(C, 0, -1), np.moveaxis(C_slopes, (0, 1), (3, 2))


def _chained(polynomial: Polynomial, x: Array, J: Array) -> tuple[Array, Array]:
    """Return values (o, n) of polynomials of θ̂, and derivatives (o, l, n) by as many of θ as those of θ̂, (l, l, n)."""
    if not J.shape[1]:
        return polynomial.evaluate(x), np.zeros((len(polynomial.coefficients), 0, x.shape[1]))
    value, by_x, _ = polynomial.derivatives(x, second=False)
    return value, np.einsum("ocn,cln->oln", by_x, J)


#: Beyond what follows from the stiffness nothing is learned that stays below this share of the largest number.
NOTHING = 1e-7
#: A stiffness whose smallest eigenvalue is below this share of the largest cannot be a logarithm.
SINGULAR = 1e-9
#: Learned parameters of which all combinations of ends are looked at.
MOST_CORNERS = 10
#: Of the polynomials of the coordinates.
LARGEST_DEGREE = 8
#: Relative ridge for data without noise: a larger one would be seen in the fit.
EXACT_RIDGE = 1e-15
#: Equations for each coefficient: members are solved exactly, so that hardly more than one is enough.
LEAST_EQUATIONS = 1.25
#: Outputs that vary less than this share of the largest weigh no more.
SMALL = 1e-3


def fit_rest(rests: RestData, inputs: InputSpace, symmetry: PointGroup) -> RestModel:
    """Return the model of undeformed members.

    Raises
    ------
    DataError
        Too few members, members without values, derivatives or parameters, or one whose solid bears no load.
    """
    inputs.require_parameters(rests.states)
    if len(rests) < 2 or not rests.responses.stable.all():
        raise DataError(
            f"expected at least two undeformed members with stable responses, got {int(rests.responses.stable.sum())} "
            f"of {len(rests)}; sample again"
        )
    theta = rests.states.parameters
    assert theta is not None
    # The members are those before they swell, whatever the stretch of the family is.
    parameters = ParameterMap(inputs, rests.kinds, rests.young, rests.poisson)
    shape, slope = parameters.shape(theta)
    given = None if rests.responses.slopes is None else rests.responses.slopes.porosity
    by_shape = None if given is None else (given[:, parameters.learned] / slope).T[None]
    porosity = fit_functions(shape.T, rests.porosity[None], by_shape)
    centre, half = _range(parameters, porosity, theta)
    l = len(centre)
    empty = Polynomial.zero(l, 0)
    start = RestModel(
        parameters, symmetry, centre, half, porosity, empty, 1.0, empty, empty, empty, np.zeros((3, 0)), empty
    )
    model = _fitted(rests, start, theta)
    return replace(model, parameters=replace(parameters, stretch=rests.stretch))


def _range(parameters: ParameterMap, porosity: Polynomial, theta: Array) -> tuple[Array, Array]:
    """Return centre and half width (l,) of the smooth coordinates over the ranges of the parameters."""
    ends = parameters.inputs.parameter_ranges
    if len(parameters.learned) <= MOST_CORNERS:
        corners = np.tile(ends.mean(axis=1), (2 ** len(parameters.learned), 1))
        corners[:, parameters.learned] = list(itertools.product(*ends[parameters.learned]))
        theta = np.concatenate([theta, corners])
    shape, _ = parameters.shape(theta)
    phi = porosity.evaluate(shape.T)[0]
    x, _ = parameters.smooth(theta, phi, np.zeros_like(shape))
    low, high = x.min(axis=0), x.max(axis=0)
    return (low + high) / 2, np.where(high > low, (high - low) / 2, 1.0)


def _fitted(rests: RestData, start: RestModel, theta: Array) -> RestModel:
    parameters, group, k = start.parameters, start.symmetry, len(theta)
    x, J, phi, phi_slopes = start.coordinates(theta)
    back = np.moveaxis(np.linalg.inv(np.moveaxis(J, -1, 0)), 0, -1)
    data = PotentialSlopes.from_states(rests.states, rests.responses, parameters)
    scaling = Scaling.from_parameters(parameters, theta)
    y_action, place_action = on_variables(group), on_places(group)
    A = np.stack([y_action.mean(y_action, data.hessian[..., i]) for i in range(k)], axis=-1)
    m = np.stack([place_action.mean(y_action, data.mean_gradient[..., i]) for i in range(k)], axis=-1)
    known = rests.stiffness_slopes is not None
    A_slopes = np.zeros((7, 7, len(x), k))
    if rests.stiffness_slopes is not None:
        given = _by_stretch(rests.stiffness_slopes[..., parameters.learned], scaling)
        for c, i in np.ndindex(len(x), k):
            A_slopes[:, :, c, i] = y_action.mean(y_action, given[:, :, c, i])
    factor = np.outer(MANDEL, MANDEL)
    C, C_slopes = A[:6, :6] * factor[:, :, None], A_slopes[:6, :6] * factor[:, :, None, None]
    solid = start.solid(theta, phi, phi_slopes) if parameters.isotropic else None
    level = 1.0 if solid is not None else float(np.exp(np.log(np.einsum("aan->n", C) / 6).mean()))
    S, S_slopes = _logarithm(C / level, C_slopes / level, solid)

    def by_x(slopes: Array) -> Array:
        turned: Array = np.einsum("okn,kcn->ocn", slopes, back)
        return turned

    stiffness = fit_functions(x, S, by_x(S_slopes) if known else None)
    A_tied, A_tied_slopes, m_tied, _ = tied(C, C_slopes, rests.porosity, phi_slopes, solid)
    coupling_slopes = by_x(A_slopes[6] - A_tied_slopes[6]) if known else None
    mean = np.concatenate([data.mean, (m - m_tied).reshape(63, k)])
    affine = np.concatenate([data.value[None], data.gradient])
    affine[7] += rests.porosity
    basis, conductivity = _conductivity(rests, start, scaling, x, by_x)
    return replace(
        start,
        stiffness=_symmetric(stiffness, group),
        level=level,
        affine=_beyond(x, affine, None, A),
        coupling=_beyond(x, A[6] - A_tied[6], coupling_slopes, A),
        mean=_beyond(x, mean, None, m),
        basis=basis,
        conductivity=conductivity,
    )


def _by_stretch(second: Array, scaling: Scaling) -> Array:
    """Return derivatives of ∂²w/∂y² (7, 7, l, k) from those of ∂²W/∂(H, p)² (k, 10, 10, l), where no stress acts."""
    k = len(second)
    ways = np.zeros((k, 7, 10))
    for a, (i, j) in enumerate(PLACES):
        ways[:, a, 3 * i + j] = ways[:, a, 3 * j + i] = scaling.stretch
    ways[:, 6, 9] = 1.0
    found = np.einsum("kai,kijl,kbj->ablk", ways, second, ways)
    by = scaling.variables
    slopes: Array = found / by[:, None, None] / by[:, None] / scaling.factor
    return slopes


def _logarithm(C: Array, C_slopes: Array, solid: tuple[Bounds, Bounds] | None) -> tuple[Array, Array]:
    """Return ln(N^-½ C N^-½) (36, k) and its slopes (36, l, k) from C (6, 6, k) and its slopes (6, 6, l, k)."""
    B, B_slopes = np.moveaxis(C, -1, 0), np.moveaxis(C_slopes, (2, 3), (1, 0))
    if solid is not None:
        root, root_slopes = normaliser(*solid)
        inverse = np.linalg.inv(root)
        B = inverse @ B @ inverse
        left = inverse[:, None] @ root_slopes @ B[:, None]
        B_slopes = inverse[:, None] @ B_slopes @ inverse[:, None] - left - left.swapaxes(-1, -2)
    values = np.linalg.eigvalsh(B)
    if (values[:, 0] <= SINGULAR * values[:, -1]).any():
        raise DataError(
            "the solid of an undeformed member bears no load in some direction; choose ranges of the parameters in "
            "which it is connected"
        )
    S, S_slopes = symmetric_logarithm(B, B_slopes)
    k = len(S)
    return S.reshape(k, 36).T, np.moveaxis(S_slopes, (0, 1), (3, 2)).reshape(36, -1, k)


def _symmetric(stiffness: Polynomial, group: PointGroup) -> Polynomial:
    """Return the polynomials of S with the symmetry of the group and of a matrix to the last bit."""
    action = on_variables(group).on(list(range(6)))
    matrices = stiffness.coefficients.T.reshape(-1, 6, 6)
    averaged = [action.mean(action, (matrix + matrix.T) / 2).ravel() for matrix in matrices]
    return Polynomial(stiffness.exponents, np.array(averaged).reshape(-1, 36).T.copy())


def _beyond(x: Array, values: Array, slopes: Array | None, whole: Array) -> Polynomial:
    """Return the polynomials of what is left of a quantity; without monomials where it is nothing beside the whole."""
    if np.abs(values).max() <= NOTHING * np.abs(whole).max():
        return Polynomial.zero(len(x), len(values))
    return fit_functions(x, values, slopes)


def _conductivity(
    rests: RestData, start: RestModel, scaling: Scaling, x: Array, by_x: Callable[[Array], Array]
) -> tuple[Array, Polynomial]:
    """Return the conducting directions B (3, r) and the polynomials of ln(Bᵀ K B) for a viscosity of 1."""
    found = rests.responses.conductivity
    if found is None or not np.isfinite(found).all():
        return start.basis, start.conductivity
    places, one, k = on_places(start.symmetry), on_one(start.symmetry), len(found)

    def symmetric(tensors: Array) -> Array:
        # A mesh breaks the symmetry a little; slopes of what is nothing by symmetry would decide the degree.
        rows = [places.mean(one, tensor.reshape(9, 1)).reshape(3, 3) for tensor in tensors.reshape(-1, 3, 3)]
        mean = np.array(rows).reshape(tensors.shape)
        found: Array = (mean + mean.swapaxes(-1, -2)) / 2
        return found

    K = symmetric(found) * scaling.viscosity[:, None, None]
    basis = conducting_basis(K.mean(axis=0))
    r = basis.shape[1]
    inside = basis.T @ K @ basis
    if r == 0 or np.linalg.eigvalsh(inside)[:, 0].min() <= 0:
        return start.basis, start.conductivity
    slopes = None if rests.responses.slopes is None else rests.responses.slopes.conductivity
    if slopes is None or not np.isfinite(slopes).all():
        logs, _ = symmetric_logarithm(inside, np.zeros((k, 0, r, r)))
        return basis, fit_functions(x, logs.reshape(k, -1).T, None)
    ways = np.moveaxis(slopes[..., start.parameters.learned], -1, 1) * scaling.viscosity[:, None, None, None]
    ways = basis.T @ symmetric(ways) @ basis
    logs, log_slopes = symmetric_logarithm(inside, ways)
    by_theta = np.moveaxis(log_slopes.reshape(k, -1, r * r), (0, 1), (2, 1))
    return basis, fit_functions(x, logs.reshape(k, -1).T, by_x(by_theta))


def fit_functions(x: Array, values: Array, slopes: Array | None) -> Polynomial:
    """Return polynomials of coordinates.

    Parameters
    ----------
    x : (l, k)
        Coordinates, about [−1, 1], of k points.
    values : (o, k)
        Values of o functions there.
    slopes : (o, l, k) or None
        Their derivatives by the coordinates; NaN where one is not known.
    """
    l, k = x.shape
    size = values.std(axis=1)
    size = np.maximum(size, SMALL * size.max(initial=0.0))
    size[size == 0] = 1.0
    values = values / size[:, None]
    known = slopes is not None and bool(np.isfinite(slopes).all()) and l > 0
    gradients = (
        slopes / size[:, None, None] if known and slopes is not None else np.zeros((len(values), 0, k))
    )
    rows_each = 1 + gradients.shape[1]
    errors: dict[int, float] = {}
    for degree in range(LARGEST_DEGREE + 1):
        exponents = exponents_up_to((1,) * l, 0, degree)
        if errors and len(exponents) * LEAST_EQUATIONS > k * rows_each * (1 - 1 / FOLDS):
            break
        squares = 0.0
        for test in held_out(k):
            found = _solve(x[:, ~test], values[:, ~test], gradients[:, :, ~test], exponents)
            squares += float(((found.evaluate(x[:, test]) - values[:, test]) ** 2).sum())
        errors[degree] = squares
        if l == 0:
            break
    best = min(errors, key=lambda degree: errors[degree])
    found = _solve(x, values, gradients, exponents_up_to((1,) * l, 0, best))
    return Polynomial(found.exponents, found.coefficients * size[:, None])


def _solve(x: Array, values: Array, gradients: Array, exponents: IntArray) -> Polynomial:
    value, slopes, _ = Polynomial.monomials(exponents).derivatives(x, second=False)
    rows = [value, *(slopes[:, a] for a in range(gradients.shape[1]))]
    right = [values, *(gradients[:, a] for a in range(gradients.shape[1]))]
    system, sides = np.concatenate(rows, axis=1).T, np.concatenate(right, axis=1)
    return Polynomial(exponents, least_squares(system, sides.T, EXACT_RIDGE).T.copy())
