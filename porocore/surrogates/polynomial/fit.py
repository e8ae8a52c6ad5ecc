"""Fit of the polynomials of a potential and of <∇u¹>_s; the potential model put together."""

from __future__ import annotations

import numpy as np

from porocore.core.inputs.sampled_range import SampledRange
from porocore.core.tensors.point_group import PointGroup
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, IntArray
from porocore.surrogates.polynomial.composition import composed
from porocore.surrogates.polynomial.least_squares import LARGEST_DEGREE, Fit, RegressionData, fit
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.polynomial.terms import Terms, invariant, plain
from porocore.surrogates.potential.data import PotentialData
from porocore.surrogates.potential.model import NetworkPart, PotentialModel
from porocore.surrogates.potential.training_box import TrainingBox
from porocore.surrogates.symmetry import (
    Equivariance,
    acting_across,
    on_one,
    on_places,
    on_variables,
    stabiliser,
)

#: More variables than this are combined by the cell's symmetry, where it has one.
MOST_PLAIN = 3
#: Terms of higher weight are not continued beyond the sampled states.
ANCHOR_DEGREE = 4
#: A stress across the directions that were sampled is learned where W₂ misses it by more than this [E].
SMALLEST_SLOPE = 1e-9
#: A component of <∇u¹>_s whose remainder stays below this share of the largest one is not learned.
SMALLEST_SHARE = 1e-6


def terms_for(data: PotentialData) -> Terms:
    """Return the variables of a problem with few, else combinations that the operations of the cell leave unchanged.

    Variables that no state moves are there too, to first order, where something acts along them: a shear stress of a
    cell without mirrors, say. Without them it would be lost.
    """
    group = data.rest.symmetry
    if len(data.active) > MOST_PLAIN and len(group) > 1:
        return invariant(group, data.active)
    _, gradients = data.remainder
    to = on_variables(stabiliser(group, data.active)).to
    acting = [a for a in acting_across(group, data.active) if np.abs(gradients[a]).max() > SMALLEST_SLOPE]
    return plain(data.active, tuple(sorted({int(b) for a in acting for b in to[:, a]})))


def tied(terms: Terms, group: PointGroup) -> Equivariance | None:
    """Return the symmetry of a potential in plain terms; None for invariant terms, which have it by themselves."""
    if terms.name != "plain":
        return None
    own = stabiliser(group, terms.active)
    return Equivariance(on_variables(own).on(list(terms.variables)), on_one(own)) if len(own) > 1 else None


def fit_potential(
    data: PotentialData,
    terms: Terms,
    *,
    degree: int | None = None,
    beyond: Polynomial | None = None,
    highest: int = LARGEST_DEGREE,
) -> Fit:
    """Fit the remainder of W₂, and of a polynomial ``beyond`` it, from third order on."""
    value, gradient = remainder(data, terms, beyond)
    scale = data.scales[1:].copy()
    _, gradients, _ = terms.polynomial.derivatives(data.y, second=False)
    scale[~gradients.any(axis=(0, 2))] = np.inf
    samples = RegressionData(data.y, value[None], gradient[None], data.scales[:1], scale[None])
    return fit(samples, terms, 3, degree=degree, highest=highest, tied=tied(terms, data.rest.symmetry))


def remainder(data: PotentialData, terms: Terms, polynomial: Polynomial | None) -> tuple[Array, Array]:
    """Return what W₂ and a polynomial in terms leave of W (n,) and of ∂W/∂y (7, n)."""
    value, gradient = data.remainder
    if polynomial is None:
        return value, gradient
    fitted, gradients, _ = composed(terms, polynomial, data.y)
    return value - fitted[0], gradient - gradients[0]


def fit_mean_grad(data: PotentialData) -> Polynomial:
    """Fit the remainder of the linear limit of Rᵀ<∇u¹>_s, from second order on (9 outputs)."""
    value, gradients = data.mean_grad_remainder
    largest = np.abs(value).max(axis=1)
    action = on_places(stabiliser(data.rest.symmetry, data.active))
    learned = np.unique(action.to[:, largest > max(SMALLEST_SHARE * largest.max(), 1e-12)])
    still = [a for a in range(7) if a not in data.active]
    scale = np.maximum(gradients.std(axis=2), 1e-3 * np.abs(gradients).max())
    scale[:, still] = np.inf
    if not len(learned):
        return Polynomial.zero(len(data.active), 9)
    size = value.std(axis=1) + 1e-300
    for together in action.orbits():
        # Components that the symmetry of the cell exchanges weigh the same.
        size[together], scale[together] = size[together].max(), scale[together].max(axis=0)
    samples = RegressionData(data.y, value[learned], gradients[learned], size[learned], scale[learned])
    part = fit(samples, plain(data.active), 2, tied=_turning(data, learned)).polynomial
    coefficients = np.zeros((9, len(part.exponents)))
    coefficients[learned] = part.coefficients
    return Polynomial(part.exponents, coefficients)


def _turning(data: PotentialData, places: IntArray) -> Equivariance | None:
    """Return the symmetry of <∇u¹>_s, which turns with the cell."""
    group = stabiliser(data.rest.symmetry, data.active)
    if len(group) == 1:
        return None
    return Equivariance(
        on_variables(group).on(list(data.active)), on_places(group).on([int(k) for k in places])
    )


def polynomial_model(training: TrainingSet, degree: int | None = None) -> tuple[PotentialModel, Fit]:
    """Return a potential without a network, and its fit.

    Raises
    ------
    DataError
        A response is missing, or too few states are stable.
    """
    data = PotentialData.from_training_set(training)
    terms = terms_for(data)
    # The stable states of few variables fill no box: in its empty corners a high degree would be worse than none.
    highest = LARGEST_DEGREE if degree is not None or len(data.active) > MOST_PLAIN else ANCHOR_DEGREE
    found = fit_potential(data, terms, degree=degree, highest=highest)
    coarse, refinement = found, None
    if found.degree > ANCHOR_DEGREE:
        # Together they span what was found, but only the first part is continued beyond the sampled states.
        coarse = fit_potential(data, terms, degree=ANCHOR_DEGREE)
        refinement = fit_potential(data, terms, degree=found.degree, beyond=coarse.polynomial).polynomial
    return potential_model(training, data, terms, coarse.polynomial, refinement=refinement), found


def potential_model(
    training: TrainingSet,
    data: PotentialData,
    terms: Terms,
    polynomial: Polynomial | None,
    *,
    network: NetworkPart | None = None,
    refinement: Polynomial | None = None,
) -> PotentialModel:
    """Return the model of these parts of W, with <∇u¹>_s fitted and the range of the stable states."""
    return PotentialModel(
        data.rest,
        terms,
        polynomial,
        network,
        fit_mean_grad(data),
        data.active,
        sampled_range(training),
        TrainingBox.from_states(data.y, data.active, data.rest.symmetry),
        refinement,
    )


def sampled_range(training: TrainingSet) -> SampledRange:
    """Return the hull of the states from which a potential learns."""
    stable = np.flatnonzero(training.responses.stable)
    return SampledRange.around(training.inputs, training.inputs.gather(training.states[stable]))
