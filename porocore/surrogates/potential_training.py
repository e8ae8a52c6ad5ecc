"""Training of a potential whose third and higher orders are a network; the network's inputs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from porocore.core.tensors import CUBIC, PointGroup
from porocore.errors import ConfigurationError
from porocore.interfaces.surrogate import OnProgress, TrainingSet
from porocore.surrogates.model import PotentialModel
from porocore.surrogates.network.network import Evaluator, Network
from porocore.surrogates.network.options import PotentialOptions
from porocore.surrogates.network.separable import SeparableNetwork
from porocore.surrogates.network.sobolev import Autodiff, SobolevProblem, train
from porocore.surrogates.polynomial.fit import (
    ANCHOR_DEGREE,
    fit_potential,
    potential_model,
    remainder,
    terms_for,
)
from porocore.surrogates.polynomial.monomials import Terms, invariant, plain
from porocore.surrogates.potential import PotentialData
from porocore.surrogates.symmetry import stabiliser


def coordinates_for(
    terms: Terms, group: PointGroup, active: tuple[int, ...], options: PotentialOptions
) -> Terms:
    """Return the inputs of a network: combinations of the sampled variables with the symmetry of the cell.

    Parameters
    ----------
    terms
        Those of polynomials for the same data.
    group, active
        Symmetry of the cell, and the variables that states move.
    options
        Their ``symmetry`` may ask for the variables as they are.

    Raises
    ------
    ConfigurationError
        Cubic symmetry is asked for and the cell has none.
    """
    if options.symmetry == "cubic" and group != CUBIC:
        raise ConfigurationError(
            f"surrogate.options.symmetry: this cell is not cubic, its group is {group.name}; choose auto or none"
        )
    variables = plain(active)
    if options.symmetry == "none":
        return variables
    if terms.name == "plain":
        terms = invariant(stabiliser(group, active), active)
    found = terms.subset(tuple(k for k in range(len(terms.weights)) if k not in terms.once))
    return found if variables.rows_of(found) is None else variables


def train_potential(
    training: TrainingSet,
    options: PotentialOptions,
    seed: int,
    autodiff: Autodiff,
    make_evaluator: Callable[[Network], Evaluator],
    on_progress: OnProgress | None = None,
) -> tuple[PotentialModel, dict[str, float]]:
    """Return the model, and the remaining errors of ∂W/∂y on the training states as shares of their ranges.

    Raises
    ------
    DataError
        A response is missing, or too few states are stable.
    ConfigurationError
        Cubic symmetry is asked for and the cell has none.
    """
    data = PotentialData.from_training_set(training)
    terms, polynomial = terms_for(data), None
    coordinates = coordinates_for(terms, data.rest.symmetry, data.active, options)
    # A network of the sampled variables cannot describe stresses across them.
    anchor = terms if options.anchor == "polynomial" else terms.across()
    if options.anchor == "polynomial" or terms.once:
        polynomial = fit_potential(data, anchor, highest=ANCHOR_DEGREE).polynomial
    value, gradient = remainder(data, terms, polynomial)
    problem = SobolevProblem.from_remainder(data, value, gradient, coordinates, gradients=options.derivatives)
    network = train(
        problem,
        autodiff,
        hidden=options.hidden,
        activation=options.activation,
        seed=seed,
        iterations=options.iterations,
        on_progress=on_progress,
    )
    part = SeparableNetwork(make_evaluator(problem.unscaled(network)), problem.terms)
    model = potential_model(training, data, terms, polynomial, network=part)
    active = list(data.active)
    wrong = model.potential(data.y)[1][active] - data.gradient[active]
    spread = np.ptp(data.gradient[active], axis=1)
    share = np.sqrt((wrong**2).mean(axis=1)) / np.where(spread > 0, spread, 1.0)
    return model, {"slopes of W on the training states": float(share.max())}
