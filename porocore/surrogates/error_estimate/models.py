"""Error estimates of the potential and of the mean-gradient model, from training states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.interfaces.surrogate import TrainingSet
from porocore.surrogates.error_estimate.fit import Equations, draw, estimate, monomials
from porocore.surrogates.mean_gradient.data import ScaledData
from porocore.surrogates.mean_gradient.model import AnchoredModel
from porocore.surrogates.polynomial.fit import terms_for
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.potential.data import PotentialData
from porocore.surrogates.potential.model import PotentialModel

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
