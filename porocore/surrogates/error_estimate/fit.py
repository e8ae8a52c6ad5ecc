"""Fit of an error estimate, of the potential and the mean-gradient model: cross-validation, safe box.

Coefficients have a normal prior whose width falls by a factor with each degree. This factor, the noise and the common
scale are those under which states that were left out of a fit are most likely (cross-validation; Rasmussen & Williams
2006, ch. 5).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.linalg import cho_solve, cholesky, solve_triangular

from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, IntArray
from porocore.surrogates.error_estimate.estimate import ErrorEstimate
from porocore.surrogates.family.fit import FamilyData, terms_of
from porocore.surrogates.family.joint import design, joint_exponents
from porocore.surrogates.mean_gradient import AnchoredModel, ScaledData
from porocore.surrogates.model import PotentialModel
from porocore.surrogates.polynomial.fit import held_out, terms_for
from porocore.surrogates.polynomial.monomials import VARIABLES, Polynomial, Terms, exponents_up_to
from porocore.surrogates.potential import PotentialData

#: Widths of the prior from one degree to the next, and standard deviations of the rest, that are tried.
DECAYS, NUGGETS = (0.3, 0.1, 0.03, 0.01), (1e-4, 1e-3, 1e-2, 1e-1)
#: Polynomials besides the mean; monomials and weight at most.
DRAWS, MOST_MONOMIALS, HIGHEST = 6, 400, 8
#: States at which the safe box is looked for, and the share of the tolerance that the estimate stays below in it.
PROBES, SAFE = 2048, 0.5
#: A variable that was not sampled is free in the safe box: another rule flags it.
FREE = 1e3


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations that n solved states give for o functions.

    Attributes
    ----------
    rows : (K, c, n)
        Quantities c of each of K monomials at the states, such as its value and its derivatives.
    right : (o, c, n)
        The same quantities of the functions.
    degrees : (K,)
        Weights of the monomials.
    judged : (c,) bool
        Quantities by which the fit is calibrated.
    """

    rows: Array
    right: Array
    degrees: IntArray
    judged: npt.NDArray[np.bool_]


def draw(equations: Equations, seed: int = 0) -> tuple[Array, float]:
    """Return the mean and :data:`DRAWS` draws of the coefficients, (1 + draws, o, K), and the nugget."""
    rows, right = equations.rows, equations.right
    K, _, n = rows.shape
    size = np.sqrt((rows**2).mean(axis=(1, 2)))
    size[size == 0] = 1.0
    scaled = rows / size[:, None, None]
    steps = equations.degrees - equations.degrees.min()
    folds = held_out(n)
    parts = [_normal(scaled[:, :, fold], right[:, :, fold]) for fold in folds]
    gram, moment = sum(part[0] for part in parts), sum(part[1] for part in parts)
    best, likelihood = (DECAYS[0], NUGGETS[0], 1.0), -np.inf
    for decay in DECAYS:
        prior = np.diag(decay ** (-2.0 * steps))
        for nugget in NUGGETS:
            left_out = [
                _left_out(scaled, equations, fold, (gram - A) / nugget**2 + prior, (moment - b) / nugget**2)
                for fold, (A, b) in zip(folds, parts, strict=True)
            ]
            squares = np.concatenate([square.ravel() for square, _ in left_out])
            variances = np.concatenate([np.broadcast_to(v, s.shape).ravel() for s, v in left_out]) + nugget**2
            variance = max(float((squares / variances).mean()), 1e-300)
            found = -float((np.log(variances) + np.log(variance)).mean())
            if found > likelihood:
                best, likelihood = (decay, nugget, variance), found
    decay, nugget, variance = best
    factor = cholesky(gram / nugget**2 + np.diag(decay ** (-2.0 * steps)), lower=True)
    mean = cho_solve((factor, True), moment / nugget**2)
    random = np.random.default_rng(seed).standard_normal((K, DRAWS * len(right)))
    scatter = np.sqrt(variance) * solve_triangular(factor, random, lower=True, trans="T")
    members = np.concatenate([mean[:, None], mean[:, None] + scatter.reshape(K, DRAWS, -1)], axis=1)
    coefficients = np.ascontiguousarray(np.moveaxis(members, 0, 2) / size)
    return coefficients, float(np.sqrt(variance) * nugget)


def _normal(rows: Array, right: Array) -> tuple[Array, Array]:
    """Return the matrix (K, K) and the right-hand sides (K, o) of the normal equations."""
    A = rows.reshape(len(rows), -1)
    return A @ A.T, A @ right.reshape(len(right), -1).T


def _left_out(
    scaled: Array, equations: Equations, test: npt.NDArray[np.bool_], matrix: Array, moment: Array
) -> tuple[Array, Array]:
    """Return squared errors (o, …) at the states left out, and the variances (…) that were expected of them."""
    factor = cholesky(matrix, lower=True)
    there = scaled[:, equations.judged][:, :, test].reshape(len(scaled), -1)
    known = equations.right[:, equations.judged][:, :, test].reshape(len(equations.right), -1)
    wrong = known - cho_solve((factor, True), moment).T @ there
    half = solve_triangular(factor, there, lower=True)
    return wrong**2, (half**2).sum(axis=0)


def monomials(
    equations: int,
    find: Callable[[int, int], IntArray],
    lowest: int,
    *,
    least: int | None = None,
    count: Callable[[IntArray], int] = len,
) -> IntArray:
    """Return exponents from a weight on, up to one as high as the equations allow.

    Parameters
    ----------
    equations
        Number of equations, for each of which there are two coefficients at most, and no more than
        :data:`MOST_MONOMIALS` in all.
    find
        Lowest and highest weight → exponents.
    lowest, least
        Lowest weight; the highest one is never below ``least``, the next if None.
    count
        Returns how many coefficients monomials have.
    """
    least = lowest + 1 if least is None else least
    found = find(lowest, least)
    for highest in range(least + 1, HIGHEST + 1):
        more = find(lowest, highest)
        if count(more) > min(MOST_MONOMIALS, 2 * equations):
            break
        found = more
    return found


def estimate(
    polynomials: Polynomial,
    nugget: float,
    tolerance: float,
    spread: Array,
    y: Array,
    quantities: Callable[[Array], Array],
    *,
    terms: Polynomial | None = None,
    judged: tuple[int, ...] = (),
    active: tuple[int, ...] | None = None,
) -> ErrorEstimate:
    """Return an estimate with its safe box: the largest one in which no probe has an error near the tolerance.

    Parameters
    ----------
    polynomials, nugget, tolerance, spread, terms, judged
        Attributes of the estimate.
    y : (v, n)
        Variables of the training states.
    quantities
        Variables (v, m) → the surrogate's judged quantities (c, m).
    active
        Variables that were sampled, about whose middle the box lies; None: all.
    """
    v = len(y)
    sampled = list(range(v) if active is None else active)
    low, high = y[sampled].min(axis=1), y[sampled].max(axis=1)
    probes, radius = _probes(low, high)
    points, safe = np.zeros((v, PROBES)), np.tile([[-FREE], [FREE]], v)
    points[sampled] = probes
    found = ErrorEstimate(tolerance, polynomials, terms, judged, spread, nugget, safe)
    near = radius[~(found.error(points, quantities(points)) <= SAFE * tolerance)]
    share = float(near.min(initial=1.0))
    # Without a single good probe around it, it is empty.
    share = share if (radius < share).sum() >= 10 else -1.0
    middle, half = (low + high) / 2, (high - low) / 2
    safe[:, sampled] = middle - share * half, middle + share * half
    return found


def _probes(low: Array, high: Array) -> tuple[Array, Array]:
    """Return points (v, n) of a box, from its middle to its corners, and how far out they are, 0 to 1 (n,)."""
    from scipy.stats import qmc  # slow to import

    v = len(low)
    cloud = 2 * qmc.Sobol(v + 2, seed=0).random(PROBES).T - 1
    # In many variables a box is mostly its corners, but hardly a point of an even cloud lies there.
    sides = np.where(np.abs(cloud[:v]) > cloud[v], np.sign(cloud[:v]), cloud[:v])
    radius = np.sqrt((cloud[v + 1] + 1) / 2)
    surface = sides / np.abs(sides).max(axis=0)
    return (low + high)[:, None] / 2 + radius * surface * (high - low)[:, None] / 2, radius


#: Weight of values over gradients of <∇u¹>, which jump where the pore wall begins to touch itself.
GRADIENT_TOLERANCE = 5.0


def with_potential_error(model: PotentialModel, training: TrainingSet) -> PotentialModel:
    """Return the model with an estimate of the errors of stress and fluid volume; as it is where none is asked for."""
    if training.tolerance is None:
        return model
    data = PotentialData.from_training_set(training)
    terms = terms_for(data)
    judged = tuple(int(a) for a in np.flatnonzero(terms.polynomial.exponents.any(axis=0)))
    exponents = monomials(len(data) * (1 + len(judged)), terms.monomials, 3)
    ranges = np.ptp(data.gradient, axis=1)
    spread = np.append(np.full(6, ranges[:6].max()), ranges[6])
    spread[spread == 0] = 1.0
    rows = terms.design(exponents, data.y)[:, (0, *(a + 1 for a in judged))]
    value, gradients = data.remainder
    right = np.concatenate([value[None], gradients[list(judged)]])[None]
    by = np.append(data.scales[0], spread[list(judged)])[:, None]
    coefficients, nugget = draw(
        Equations(rows / by, right / by, exponents @ np.array(terms.weights), np.arange(len(by)) > 0)
    )
    found = estimate(
        Polynomial(exponents, coefficients.reshape(-1, len(exponents))),
        nugget,
        training.tolerance,
        spread[list(judged)],
        data.y,
        lambda y: model.beyond_rest(y, data.rest.values.x)[1][list(judged)],
        terms=terms.polynomial,
        judged=judged,
        active=data.active,
    )
    return replace(model, estimate=found)


def with_family_error(model: PotentialModel, data: FamilyData, tolerance: float | None) -> PotentialModel:
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
    exponents = monomials(
        n * (1 + len(judged) + l), lambda low, high: joint_exponents(terms, l, low, high, 1), 3, least=3
    )
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


def with_mean_gradient_error(model: AnchoredModel, training: TrainingSet) -> AnchoredModel:
    """Return the model with an estimate of the errors of <∇u¹>; as it is where none is asked for or learned."""
    data = ScaledData.from_training_set(training)
    if training.tolerance is None or not data.components:
        return model
    # From rest on, where the network begins at second order.
    x, d = (data.x - data.rest).T, len(data.x.T)
    exponents = monomials(len(data.x) * (1 + d), lambda low, high: exponents_up_to((1,) * d, low, high), 2)
    spread = float(np.ptp(training.responses.mean_grad.reshape(-1, 9), axis=0).max()) or 1.0
    scale = data.output_scale[:, None] / spread
    right = (data.target.T * scale)[:, None]
    values, slopes, _ = Polynomial.monomials(exponents).derivatives(x, second=False)
    rows = values[:, None]
    tangent = training.responses.tangent
    if tangent is not None and tangent.mean_grad_grad_u is not None and tangent.mean_grad_p is not None:
        n = len(data.x)
        gradients = np.concatenate(
            [tangent.mean_grad_grad_u.reshape(n, 9, 9), tangent.mean_grad_p.reshape(n, 9, 1)], axis=2
        )
        gradients = (gradients - data.linear)[:, data.components][:, :, training.inputs.columns]
        gradients *= model.scaling.half / spread / GRADIENT_TOLERANCE
        rows = np.concatenate([rows, slopes / GRADIENT_TOLERANCE], axis=1)
        right = np.concatenate([right, gradients.transpose(1, 2, 0)], axis=1)
    coefficients, nugget = draw(Equations(rows, right, exponents.sum(axis=1), np.arange(rows.shape[1]) == 0))
    found = estimate(
        Polynomial(exponents, (coefficients * spread).reshape(-1, len(exponents))),
        nugget,
        training.tolerance,
        np.full(len(data.components), spread),
        x,
        lambda away: model.beyond_linear(away.T + data.rest),
    )
    return replace(model, estimate=found)
