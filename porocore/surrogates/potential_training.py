"""A potential whose third and higher orders are a network, trained by a library's automatic differentiation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from porocore.errors import ConfigurationError
from porocore.interfaces.surrogate import TrainingProgress, TrainingSet
from porocore.surrogates.composition import Composed
from porocore.surrogates.network import Evaluator, Network
from porocore.surrogates.options import PotentialOptions
from porocore.surrogates.polynomial import fit_mean_grad, fit_potential, sampled_range, terms_for
from porocore.surrogates.potential import PotentialModel
from porocore.surrogates.potential_data import PotentialData
from porocore.surrogates.sobolev import Autodiff, SobolevProblem, train
from porocore.surrogates.terms import cubic, plain

#: A polynomial anchor leaves what is beyond this weight to the network.
ANCHOR_DEGREE = 4


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
    value, gradient = data.remainder
    terms = polynomial = None
    if options.anchor == "polynomial":
        terms = terms_for(data)
        polynomial = fit_potential(data, terms, ANCHOR_DEGREE).polynomial
        anchor_value, anchor_gradient, _ = Composed(terms, polynomial)(data.y)
        value, gradient = value - anchor_value[0], gradient - anchor_gradient[0]
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
    part = replace(problem.part, network=make_evaluator(network))
    model = PotentialModel(
        data.rest, terms, polynomial, part, fit_mean_grad(data), data.active, sampled_range(training)
    )
    active = list(data.active)
    wrong = model.potential(data.y)[1][active] - data.gradient[active]
    spread = np.ptp(data.gradient[active], axis=1)
    share = np.sqrt((wrong**2).mean(axis=1)) / np.where(spread > 0, spread, 1.0)
    return model, {"slopes of W on the training states": float(share.max())}
