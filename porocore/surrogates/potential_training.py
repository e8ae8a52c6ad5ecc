"""A potential whose third and higher orders are a network, trained by a library's automatic differentiation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from porocore.errors import ConfigurationError
from porocore.interfaces.surrogate import TrainingProgress, TrainingSet
from porocore.surrogates.network import Evaluator, Network
from porocore.surrogates.options import PotentialOptions
from porocore.surrogates.polynomial import (
    ANCHOR_DEGREE,
    fit_mean_grad,
    fit_potential,
    remainder,
    sampled_range,
    terms_for,
)
from porocore.surrogates.potential import NetworkPart, PotentialModel
from porocore.surrogates.potential_data import PotentialData
from porocore.surrogates.reach import Reach
from porocore.surrogates.sobolev import Autodiff, SobolevProblem, train
from porocore.surrogates.terms import cubic, plain


def train_potential(
    training: TrainingSet,
    options: PotentialOptions,
    seed: int,
    autodiff: Autodiff,
    make_evaluator: Callable[[Network], Evaluator],
    on_progress: Callable[[TrainingProgress], None] | None = None,
) -> tuple[PotentialModel, dict[str, float]]:
    """The model, and the errors of ∂W/∂y that are left on the training states, as shares of their ranges.

    Raises
    ------
    DataError
        A response is missing, or too few states are stable.
    ConfigurationError
        Cubic symmetry is asked for and the cell has none.
    """
    data = PotentialData.of(training)
    if options.symmetry == "cubic" and not data.rest.cubic:
        raise ConfigurationError(
            "surrogate.options.symmetry: this cell is not cubic at rest; choose auto or none"
        )
    coordinates = {"auto": terms_for(data), "none": plain(data.active), "cubic": cubic()}[options.symmetry]
    if coordinates.name == "plain":
        coordinates = plain(data.active)
    terms, polynomial = terms_for(data), None
    if options.anchor == "polynomial":
        polynomial = fit_potential(data, terms, highest=ANCHOR_DEGREE).polynomial
    value, gradient = remainder(data, terms, polynomial)
    problem = SobolevProblem.of(data, value, gradient, coordinates, slopes=options.derivatives)
    network = train(
        problem,
        autodiff,
        hidden=options.hidden,
        activation=options.activation,
        seed=seed,
        iterations=options.iterations,
        on_progress=on_progress,
    )
    part = NetworkPart(make_evaluator(problem.unscaled(network)), problem.terms)
    reach = Reach.of(data.y, data.active, cubic=coordinates.name == "cubic")
    model = PotentialModel(
        data.rest, terms, polynomial, part, fit_mean_grad(data), data.active, sampled_range(training), reach
    )
    active = list(data.active)
    wrong = model.potential(data.y)[1][active] - data.gradient[active]
    spread = np.ptp(data.gradient[active], axis=1)
    share = np.sqrt((wrong**2).mean(axis=1)) / np.where(spread > 0, spread, 1.0)
    return model, {"slopes of W on the training states": float(share.max())}
