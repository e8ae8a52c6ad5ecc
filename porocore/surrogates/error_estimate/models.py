"""Error estimates of the two kinds of model, from their training states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array
from porocore.surrogates.error_estimate.fit import Equations, draw, estimate, monomials, probes, safe_box
from porocore.surrogates.mean_gradient.data import ScaledData
from porocore.surrogates.mean_gradient.model import AnchoredModel
from porocore.surrogates.polynomial.fit import terms_for
from porocore.surrogates.polynomial.monomials import IntArray, Polynomial
from porocore.surrogates.polynomial.terms import VARIABLES, Terms
from porocore.surrogates.potential.data import PotentialData
from porocore.surrogates.potential.model import PotentialModel

#: Weight of values over gradients of <∇u¹>, which jump where the pore wall begins to touch itself.
GRADIENT_TOLERANCE = 5.0
#: A variable that was not sampled is free in the safe box: another rule flags it.
FREE = 1e3


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
    rows = _gradient_rows(terms, exponents, data.y)[:, (0, *(a + 1 for a in judged))]
    value, gradients = data.remainder
    right = np.concatenate([value[None], gradients[list(judged)]])[None]
    by = np.append(data.scales[0], spread[list(judged)])[:, None]
    coefficients, nugget = draw(
        Equations(rows / by, right / by, exponents @ np.array(terms.weights), np.arange(len(by)) > 0)
    )
    found = estimate(
        coefficients,
        exponents,
        nugget,
        tolerance=training.tolerance,
        terms=terms.polynomial,
        judged=judged,
        spread=spread[list(judged)],
        safe=np.zeros((2, VARIABLES)),
    )
    active = list(data.active)
    low, high = data.y[active].min(axis=1), data.y[active].max(axis=1)
    points, radius = probes(low, high)
    y = np.zeros((VARIABLES, len(radius)))
    y[active] = points
    safe = np.tile([[-FREE], [FREE]], VARIABLES)
    safe[:, active] = safe_box(
        low, high, radius, found.error(y, model.beyond_rest(y, judged)), found.tolerance
    )
    return replace(model, estimate=replace(found, safe=safe))


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
    rows, _ = _at(exponents, x)
    rows = rows[:, None]
    tangent = training.responses.tangent
    if tangent is not None and tangent.mean_grad_grad_u is not None and tangent.mean_grad_p is not None:
        n = len(data.x)
        gradients = np.concatenate(
            [tangent.mean_grad_grad_u.reshape(n, 9, 9), tangent.mean_grad_p.reshape(n, 9, 1)], axis=2
        )
        gradients = (gradients - data.linear)[:, data.components][:, :, training.inputs.columns]
        gradients *= model.scaling.half / spread / GRADIENT_TOLERANCE
        rows = np.concatenate([rows, _at(exponents, x)[1] / GRADIENT_TOLERANCE], axis=1)
        right = np.concatenate([right, gradients.transpose(1, 2, 0)], axis=1)
    coefficients, nugget = draw(Equations(rows, right, exponents.sum(axis=1), np.arange(rows.shape[1]) == 0))
    found = estimate(
        coefficients * spread,
        exponents,
        nugget,
        tolerance=training.tolerance,
        terms=None,
        judged=(),
        spread=np.full(len(data.components), spread),
        safe=np.zeros((2, d)),
    )
    low, high = x.min(axis=1), x.max(axis=1)
    points, radius = probes(low, high)
    error = found.error(points, model.beyond_linear(points.T + data.rest))
    return replace(model, estimate=replace(found, safe=safe_box(low, high, radius, error, found.tolerance)))


def _at(exponents: IntArray, t: Array) -> tuple[Array, Array]:
    """Return values (K, n) and gradients (K, k, n) of monomials at t (k, n)."""
    value, gradients, _ = Polynomial(exponents, np.eye(len(exponents))).derivatives(t, second=False)
    return value, gradients


def _gradient_rows(terms: Terms, exponents: IntArray, y: Array) -> Array:
    """Return values and gradients by the seven variables of monomials in terms, (K, 1 + 7, n)."""
    t, J, _ = terms.polynomial.derivatives(y, second=False)
    value, by_t = _at(exponents, t)
    return np.concatenate([value[:, None], np.einsum("ktn,tan->kan", by_t, J)], axis=1)
