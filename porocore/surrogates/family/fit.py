"""Fit of a family's potential to solved states: data beyond rest, polynomials, the model put together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.core.inputs.sampled_range import SampledRange
from porocore.core.tensors.point_group import PointGroup
from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, IntArray
from porocore.surrogates.family.derivatives import PotentialSlopes
from porocore.surrogates.family.joint import JointPolynomial, summed
from porocore.surrogates.family.model import FamilyModel
from porocore.surrogates.family.regression import LARGEST_DEGREE, JointData, JointFit, Weights, fit_joint
from porocore.surrogates.family.rest import RestModel
from porocore.surrogates.family.rest_fit import fit_rest
from porocore.surrogates.network.separable import SeparableNetwork
from porocore.surrogates.polynomial.fit import ANCHOR_DEGREE, MOST_PLAIN, SMALLEST_SLOPE
from porocore.surrogates.polynomial.monomials import Polynomial
from porocore.surrogates.polynomial.terms import Terms, invariant, plain
from porocore.surrogates.potential.data import STILL
from porocore.surrogates.potential.training_box import TrainingBox
from porocore.surrogates.symmetry import (
    Action,
    Equivariance,
    acting_across,
    on_one,
    on_places,
    on_variables,
    stabiliser,
)

#: Largest degree of ⟨∇u¹⟩.
MEAN_DEGREE = 6
#: Weights of ⟨∇u¹⟩, whose gradients jump where the pore wall begins to touch itself.
MEAN_WEIGHTS = Weights(by_y=0.5, by_x=0.5)


@dataclass(frozen=True, eq=False)
class FamilyData:
    """Solved states of a family beyond rest.

    Attributes
    ----------
    rest
        Undeformed members.
    potential
        R = (w − W₂)/M with its derivatives by y and θ̂, one output.
    mean
        Rᵀ⟨∇u¹⟩ beyond its linear limit, 9 outputs.
    active
        Variables that were sampled.
    stress : (7, n), scale : (n,)
        ∂w/∂y, whose ranges weigh errors, and M.
    rows : (n,)
        Rows of the training set.
    """

    rest: RestModel
    potential: JointData
    mean: JointData
    active: tuple[int, ...]
    stress: Array
    scale: Array
    rows: IntArray

    @classmethod
    def from_training_set(cls, data: TrainingSet) -> FamilyData:
        """Return the data of the stable states.

        Raises
        ------
        DataError
            Something is missing, or fewer than two states are stable.
        """
        if data.rests is None:
            raise DataError(
                f"the cell has the parameters {', '.join(data.inputs.parameters)}, and the training set has no "
                "undeformed members (rests); sample again"
            )
        rest = fit_rest(data.rests, data.inputs, data.symmetry)
        kept = np.flatnonzero(data.responses.stable)
        if len(kept) < 2:
            raise DataError(f"expected at least two stable training states, got {len(kept)}; sample more")
        states, responses = data.states[kept], data.responses[kept]
        data.inputs.require_parameters(states)
        assert states.parameters is not None
        solved = PotentialSlopes.from_states(states, responses, rest.parameters)
        at = rest.at(states.parameters, slopes=True)
        s = at.slopes
        assert s is not None
        y, M = solved.y, at.scale
        back = np.moveaxis(np.linalg.inv(np.moveaxis(s.x, -1, 0)), 0, -1)
        linear, linear_slopes = np.einsum("abn,bn->an", at.matrix, y), np.einsum("abln,bn->aln", s.matrix, y)
        value = (solved.value - at.value - ((at.gradient + linear / 2) * y).sum(axis=0)) / M
        gradient = (solved.gradient - at.gradient - linear) / M
        by_theta = solved.by_theta - s.value - ((s.gradient + linear_slopes / 2) * y[:, None]).sum(axis=0)
        by_theta = (by_theta - s.scale * value) / M
        mixed = (solved.gradient_by_theta - s.gradient - linear_slopes - s.scale * gradient[:, None]) / M
        potential = JointData(
            y,
            at.x,
            value[None],
            gradient[None],
            np.einsum("kn,kcn->cn", by_theta, back)[None],
            ((solved.hessian - at.matrix) / M)[None],
            np.einsum("akn,kcn->acn", mixed, back)[None],
        )
        mean_slopes = solved.mean_by_theta - s.mean_value - np.einsum("oaln,an->oln", s.mean, y)
        mean = JointData(
            y,
            at.x,
            solved.mean - at.mean_value - np.einsum("oan,an->on", at.mean, y),
            solved.mean_gradient - at.mean,
            np.einsum("okn,kcn->ocn", mean_slopes, back),
        )
        active = tuple(int(a) for a in np.flatnonzero(np.abs(y).max(axis=1) > STILL))
        return cls(rest, potential, mean, active, solved.gradient, M, kept)


def terms_of(data: FamilyData) -> Terms:
    """Return the variables of a problem with few, else combinations that the cell's operations leave unchanged.

    Variables that no state moves are there too, to first order, where something acts along them.
    """
    group = data.rest.symmetry
    if len(data.active) > MOST_PLAIN and len(group) > 1:
        return invariant(group, data.active)
    gradients, to = data.potential.by_y[0], on_variables(stabiliser(group, data.active)).to
    acting = [a for a in acting_across(group, data.active) if np.abs(gradients[a]).max() > SMALLEST_SLOPE]
    return plain(data.active, tuple(sorted({int(b) for a in acting for b in to[:, a]})))


def symmetry_of(terms: Terms, l: int, group: PointGroup) -> Equivariance:
    """Return the symmetry of a potential in terms and l coordinates, which no operation changes."""
    if terms.name != "plain":
        trivial = Action(
            np.arange(len(terms.weights))[None], np.ones((1, len(terms.weights)), dtype=np.int64)
        )
        return Equivariance(
            beside(trivial, l), Action(np.zeros((1, 1), dtype=np.int64), np.ones((1, 1), dtype=np.int64))
        )
    own = stabiliser(group, terms.active)
    return Equivariance(beside(on_variables(own).on(list(terms.variables)), l), on_one(own))


def beside(action: Action, l: int) -> Action:
    """Return an action on l numbers more, which stay."""
    g, v = action.to.shape
    stay = np.tile(np.arange(v, v + l), (g, 1))
    return Action(
        np.concatenate([action.to, stay], axis=1), np.concatenate([action.sign, np.ones_like(stay)], axis=1)
    )


def fit_mean(data: FamilyData, weights: Weights = MEAN_WEIGHTS) -> JointFit:
    """Fit Rᵀ⟨∇u¹⟩ beyond its linear limit, from second order on; it turns with the cell."""
    tied = turning(data)
    return fit_joint(
        data.mean, plain(data.active), 2, tied=tied, weights=weights, judged="value", highest=MEAN_DEGREE
    )


def turning(data: FamilyData) -> Equivariance:
    """Return the symmetry of Rᵀ⟨∇u¹⟩, in the variables that were sampled and the coordinates."""
    group = stabiliser(data.rest.symmetry, data.active)
    return Equivariance(beside(on_variables(group).on(list(data.active)), len(data.mean.x)), on_places(group))


def family_model(
    training: TrainingSet, weights: Weights, degree: int | None = None
) -> tuple[FamilyModel, JointFit, FamilyData]:
    """Return the model of a training set, the fit of its potential, and the data.

    Raises
    ------
    DataError
        Undeformed members, a response or a derivative are missing, or too few states are stable.
    """
    data = FamilyData.from_training_set(training)
    terms, l = terms_of(data), len(data.potential.x)
    tied = symmetry_of(terms, l, data.rest.symmetry)

    def fitted(highest: int) -> JointFit:
        return fit_joint(data.potential, terms, 3, tied=tied, weights=weights, highest=highest)

    found = fitted(LARGEST_DEGREE if degree is None else degree)
    coarse, fine = found, None
    if found.degree > ANCHOR_DEGREE:
        # Together they are what was found, but only the first part is continued beyond the sampled states.
        coarse = fitted(ANCHOR_DEGREE)
        fine = JointPolynomial(terms, summed(found.polynomial, coarse.polynomial, -1.0))
    return assembled(training, data, terms, coarse.polynomial, fine=fine), found, data


def assembled(
    training: TrainingSet,
    data: FamilyData,
    terms: Terms,
    coarse: Polynomial,
    *,
    fine: JointPolynomial | None = None,
    network: SeparableNetwork | None = None,
) -> FamilyModel:
    """Return the model of these parts of R, with ⟨∇u¹⟩ fitted and the range of the stable states."""
    return FamilyModel(
        data.rest,
        JointPolynomial(terms, coarse) if len(coarse.exponents) else None,
        fine,
        fit_mean(data).polynomial,
        data.active,
        SampledRange.around(training.inputs, training.inputs.gather(training.states[data.rows])),
        TrainingBox.from_states(data.potential.y, data.active, data.rest.symmetry),
        network=network,
    )
