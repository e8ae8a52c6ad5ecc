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
from porocore.surrogates.mean_gradient import AnchoredModel, ScaledData
from porocore.surrogates.polynomial.fit import held_out, terms_for
from porocore.surrogates.polynomial.monomials import Polynomial, Terms, exponents_up_to
from porocore.surrogates.potential import PotentialData, PotentialModel

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
    weights: tuple[int, ...],
    lowest: int,
    terms: Terms | None = None,
    count: Callable[[IntArray], int] = len,
) -> IntArray:
    """Return exponents up to a weight that is at least one above the lowest.

    It is as high as :data:`MOST_MONOMIALS` and two coefficients for each of the ``equations`` allow; ``count`` says
    how many coefficients monomials have.
    """
    find = terms.monomials if terms is not None else lambda low, high: exponents_up_to(weights, low, high)
    found = find(lowest, lowest + 1)
    for highest in range(lowest + 2, HIGHEST + 1):
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
    exponents = monomials(len(data) * (1 + len(judged)), terms.weights, 3, terms)
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
        lambda y: model.beyond_rest(y, judged),
        terms=terms.polynomial,
        judged=judged,
        active=data.active,
    )
    return replace(model, estimate=found)


def with_mean_gradient_error(model: AnchoredModel, training: TrainingSet) -> AnchoredModel:
    """Return the model with an estimate of the errors of <∇u¹>; as it is where none is asked for or learned."""
    data = ScaledData.from_training_set(training)
    if training.tolerance is None or not data.components:
        return model
    # From rest on, where the network begins at second order.
    x, d = (data.x - data.rest).T, len(data.x.T)
    exponents = monomials(len(data.x) * (1 + d), (1,) * d, 2)
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
