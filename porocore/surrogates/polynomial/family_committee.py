"""Committee of polynomials for a cell with parameters: its members are functions of the state and of θ.

They are polynomials in y and the coordinates θ̂ for the remainder beyond rest, as those of the family's surrogate
(:mod:`porocore.surrogates.family.fit`), with its equations and its prior: one for each fifth of the states that
is left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, IntArray, MacroState
from porocore.surrogates.family.coordinates import Scaling
from porocore.surrogates.family.fit import (
    MEAN_WEIGHTS,
    FamilyData,
    JointData,
    SharedEquations,
    Weights,
    chosen_prior,
    equation_scales,
    symmetry_of,
    terms_of,
    turning,
)
from porocore.surrogates.family.joint import MonomialDerivatives, design, joint_exponents
from porocore.surrogates.family.rest import RestModel
from porocore.surrogates.polynomial.judgement import Committee, Target
from porocore.surrogates.polynomial.monomials import VARIABLES, Terms, plain
from porocore.surrogates.potential import variables
from porocore.surrogates.stretch import LogStretch

#: Degree in the coordinates beyond what the total degree leaves.
MORE = 1
#: Largest degree and number of coefficients of a member.
HIGHEST_DEGREE, MOST_TERMS = 8, 160
#: Pairs of variables by which there are second derivatives.
PAIRS = np.triu_indices(VARIABLES)


@dataclass(frozen=True, eq=False)
class FamilyBasis:
    """Monomials of terms of y and of the coordinates θ̂, l of them.

    Attributes
    ----------
    terms
        Those of y.
    rest
        Undeformed members, which give coordinates and scale of the parameters.
    potential
        True where the potential is learned, by its second derivatives too and as a share of the scale M(θ) of the
        member's stiffness; else ⟨∇u¹⟩.
    """

    terms: Terms
    rest: RestModel
    potential: bool

    @property
    def lowest(self) -> int:
        """Least degree of what is learned beyond rest."""
        return 3 if self.potential else 2

    def monomials(self, lowest: int, highest: int) -> IntArray:
        """Return the exponents of the monomials of these weights in the terms, of lower degrees in θ̂."""
        l = len(self.rest.parameters.learned)
        return joint_exponents(self.terms, l, lowest, highest, MORE if l else 0)

    def design(self, exponents: IntArray, at: Array) -> Array:
        """Return the monomials and their derivatives, stacked as by :func:`_stacked`."""
        y, x = at[:VARIABLES], at[VARIABLES:]
        return _stacked(design(self.terms, exponents, y, x, second=self.potential))

    def degrees(self, exponents: IntArray) -> tuple[IntArray, IntArray]:
        """Return the weight in the terms above the least of monomials (K,), and their degree in θ̂."""
        k = len(self.terms.weights)
        weight: IntArray = exponents[:, :k] @ np.array(self.terms.weights, dtype=np.int64)
        return weight - weight.min(), exponents[:, k:].sum(axis=1)

    def at(self, states: MacroState) -> tuple[Array, Array | float]:
        """Return y and θ̂ (7 + l, n) at n states, and M(θ) where it scales."""
        theta = states.parameters
        assert theta is not None
        scaling = Scaling.from_parameters(self.rest.parameters, theta)
        y = scaling.inner(variables(LogStretch.from_gradient(states.grad_u), states.p))
        at = self.rest.at(theta)
        return np.concatenate([y, at.x]), at.scale if self.potential else 1.0


def family_committee(data: TrainingSet, responses: tuple[str, ...]) -> Committee:
    """Return the committee of the stable states of a family, for a closure that needs ``responses``.

    Raises
    ------
    DataError
        Undeformed members or a response are missing, or fewer than two states are stable.
    """
    known = FamilyData.from_training_set(data)
    if "stress" in responses:
        return _potential(known)
    mean = data.responses.mean_grad[known.rows].reshape(len(known.rows), 9)
    return _mean_gradient(known, float(np.ptp(mean, axis=0).max()))


def _potential(data: FamilyData) -> Committee:
    """Return members for R, the potential beyond rest; they disagree about stress and fluid volume over E."""
    terms, joint = terms_of(data), data.potential
    basis = FamilyBasis(terms, data.rest, potential=True)
    tied = symmetry_of(terms, len(joint.x), data.rest.symmetry)
    target = _target(basis, joint, _divisors(joint, equation_scales(joint, Weights(), tied)))
    ranges = np.ptp(data.stress, axis=1)
    target.spread[0, 1:7] = ranges[:6].max() or np.inf
    target.spread[0, 7] = ranges[6] or np.inf
    return _fitted(basis, target)


def _mean_gradient(data: FamilyData, span: float) -> Committee:
    """Return members for <∇u¹>_s in the frame of the stretch beyond first order; they disagree about its values."""
    basis = FamilyBasis(plain(data.active), data.rest, potential=False)
    scales = equation_scales(data.mean, MEAN_WEIGHTS, turning(data))
    target = _target(basis, data.mean, _divisors(data.mean, scales))
    target.spread[:, 0] = span or np.inf
    return _fitted(basis, target)


def _target(basis: FamilyBasis, data: JointData, divisors: Array) -> Target:
    """Return the target of outputs with ``divisors`` (o, c), the largest of all outputs for each equation."""
    known = np.concatenate([data.y, data.x])
    learned = np.flatnonzero(np.isfinite(divisors).any(axis=1))
    finite = np.where(np.isfinite(divisors), divisors, 0.0)
    rows = finite.max(axis=0, initial=0.0)
    rows[rows == 0] = np.inf
    right = np.nan_to_num(_stacked(data))[learned]
    return Target(basis, basis.lowest, known, rows, right, np.full(right.shape[:2], np.inf))


def _divisors(data: JointData, scales: dict[str, Array]) -> Array:
    """Return the divisors of the equations of o outputs, (o, c); infinite where one is not known."""
    o, l = len(data.value), len(data.x)
    shapes = {"value": (o,), "by_y": (o, VARIABLES), "by_x": (o, l)}
    if data.by_yy is not None:
        shapes |= {"by_yy": (o, VARIABLES, VARIABLES), "by_yx": (o, VARIABLES, l)}
    parts = {kind: scales.get(kind, np.full(shape, np.inf))[..., None] for kind, shape in shapes.items()}
    return _stacked(JointData(data.y, data.x, **parts))[..., 0]


def _stacked(found: MonomialDerivatives | JointData) -> Array:
    """Return values (o, n) and derivatives one below the other, (o, c, n): by y, by θ̂, and second ones."""
    parts = [found.value[:, None], found.by_y, found.by_x]
    if found.by_yy is not None and found.by_yx is not None:
        parts += [found.by_yy[:, *PAIRS], found.by_yx.reshape(len(found.value), -1, found.value.shape[1])]
    return np.concatenate(parts, axis=1)


def _fitted(basis: FamilyBasis, target: Target) -> Committee:
    n = target.known.shape[1]
    counted = np.flatnonzero(np.isfinite(target.rows))
    exponents, degree = _monomials(target, n * len(counted))
    if n < 3 or not len(target.right) or not len(exponents):
        return Committee(target, exponents[:0], (), target.lowest - 1, np.empty((0, 0)))
    rows = np.moveaxis(basis.design(exponents, target.known)[:, counted] / target.rows[counted, None], 2, 0)
    right = target.right[:, counted] / target.rows[counted, None]
    judged = np.isfinite(target.spread).any(axis=0)[counted]
    weight, in_coordinates = basis.degrees(exponents)
    # All outputs share their equations, and the prior is that of the one which varies most.
    largest = int(np.abs(right).max(axis=(1, 2)).argmax())
    systems = [SharedEquations(rows.swapaxes(1, 2), each.T, judged, weight, in_coordinates) for each in right]
    prior, _ = chosen_prior([systems[largest]])
    penalties = np.diag(systems[largest].penalties(prior))
    size = systems[largest].size
    factors = [cho_factor(gram + penalties) for gram, _ in systems[largest].folds[0]]
    members = tuple(
        np.stack([cho_solve(factor, system.folds[0][fold][1]) / size for system in systems])
        for fold, factor in enumerate(factors)
    )
    whole = sum(gram for gram, _ in systems[largest].folds[0]) / (len(factors) - 1)
    covariance = np.linalg.inv(whole + penalties) / size / size[:, None]
    return Committee(target, exponents, members, degree, covariance)


def _monomials(target: Target, equations: int) -> tuple[IntArray, int]:
    """Return the monomials up to the largest degree that so many equations determine, and this degree."""
    exponents, found = target.basis.monomials(target.lowest, target.lowest)[:0], target.lowest - 1
    for degree in range(target.lowest, HIGHEST_DEGREE + 1):
        candidates = target.basis.monomials(target.lowest, degree)
        if len(candidates) > min(MOST_TERMS, equations):
            break
        exponents, found = candidates, degree
    return exponents, found
