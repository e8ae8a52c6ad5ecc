"""Training of a family's potential whose higher orders are a polynomial of low degree and a network."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from porocore.interfaces.surrogate import OnProgress, TrainingSet
from porocore.states import Array
from porocore.surrogates.family.fit import FamilyData, assembled, symmetry_of, terms_of
from porocore.surrogates.family.joint import design
from porocore.surrogates.family.model import FamilyModel
from porocore.surrogates.family.regression import JointData, Weights, equation_scales, fit_joint
from porocore.surrogates.network.family_problem import FamilyProblem, Layout
from porocore.surrogates.network.network import Evaluator, Network
from porocore.surrogates.network.options import PotentialOptions
from porocore.surrogates.network.separable import SeparableNetwork
from porocore.surrogates.network.sobolev import Autodiff, minimised
from porocore.surrogates.polynomial.fit import ANCHOR_DEGREE
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.polynomial.terms import Terms
from porocore.surrogates.potential.training import coordinates_for

#: Weights where values alone are learned.
VALUES = Weights(by_y=0.0, by_x=0.0, by_yy=0.0, by_yx=0.0)


def train_family(
    training: TrainingSet,
    options: PotentialOptions,
    seed: int,
    autodiff: Autodiff,
    make_evaluator: Callable[[Network], Evaluator],
    on_progress: OnProgress | None = None,
) -> tuple[FamilyModel, FamilyData, dict[str, float]]:
    """Return the model, the data, and the remaining errors of ∂W/∂y on the training states as shares of their ranges.

    Raises
    ------
    DataError
        Undeformed members, a response or a derivative are missing, or too few states are stable.
    ConfigurationError
        Cubic symmetry is asked for and the cell has none.
    """
    data = FamilyData.from_training_set(training)
    terms, group, joint = terms_of(data), data.rest.symmetry, data.potential
    coordinates, l = coordinates_for(terms, group, data.active, options), len(joint.x)
    # A network of the sampled variables cannot describe stresses across them.
    anchor = terms if options.anchor == "polynomial" else terms.across()
    polynomial = Polynomial.zero(len(terms.weights) + l, 1)
    if options.anchor == "polynomial" or terms.once:
        tied = symmetry_of(anchor, l, group)
        polynomial = fit_joint(
            joint, anchor, 3, tied=tied, weights=Weights(), highest=ANCHOR_DEGREE
        ).polynomial
    divisors = equation_scales(
        joint, Weights() if options.derivatives else VALUES, symmetry_of(terms, l, group)
    )
    problem = FamilyProblem.from_data(_beyond(joint, terms, polynomial), divisors, coordinates, data.active)
    layout = Layout.from_widths(len(problem.terms.weights), l, options.hidden, options.activation)
    start = layout.first_weights(seed)
    function = autodiff.compile(problem.loss(autodiff.xp, layout), problem.constants(start))
    theta = minimised(function, start, options.iterations, on_progress)
    network, factors = problem.networks(theta, layout)
    part = SeparableNetwork(make_evaluator(network), factors, problem.terms)
    model = assembled(training, data, terms, polynomial, network=part)
    return model, data, {"slopes of W on the training states": _error(model, data)}


def _beyond(data: JointData, terms: Terms, polynomial: Polynomial) -> JointData:
    """Return what a polynomial leaves of one function and its derivatives."""
    if not len(polynomial.exponents):
        return data
    columns = design(terms, polynomial.exponents, data.y, data.x, second=True)
    c = polynomial.coefficients[0]

    def left(kind: str) -> Array:
        found: Array = getattr(data, kind) - np.tensordot(c, getattr(columns, kind), 1)[None]
        return found

    return JointData(data.y, data.x, *(left(kind) for kind in ("value", "by_y", "by_x", "by_yy", "by_yx")))


def _error(model: FamilyModel, data: FamilyData) -> float:
    """Return the largest root mean square error of ∂R/∂y, as a share of the range of ∂w/∂y."""
    active = list(data.active)
    found = model.beyond_rest(data.potential.y, data.potential.x)[1]
    wrong = (found - data.potential.by_y[0]) * data.scale
    spread = np.ptp(data.stress[active], axis=1)
    share = np.sqrt((wrong[active] ** 2).mean(axis=1)) / np.where(spread > 0, spread, 1.0)
    return float(share.max())
