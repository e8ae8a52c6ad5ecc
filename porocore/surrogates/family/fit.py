"""Fit of a family's potential to solved states, by least squares with values and derivatives.

Coefficients have a normal prior, whose width falls by one factor with each degree in y and by another one with each
degree in θ̂. The factors and the noise are those with the smallest cross-validated error, so that few states with many
equations each carry many monomials (Rasmussen & Williams 2006, ch. 5).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.sparse import csr_array

from porocore.core.inputs import SampledRange
from porocore.core.tensors import PointGroup
from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, IntArray
from porocore.surrogates.family.derivatives import PotentialSlopes
from porocore.surrogates.family.joint import JointPolynomial, design, joint_exponents, summed
from porocore.surrogates.family.rest import RestModel, fit_rest
from porocore.surrogates.model import PotentialModel
from porocore.surrogates.network.separable import SeparableNetwork
from porocore.surrogates.polynomial.fit import ANCHOR_DEGREE, MOST_PLAIN, SMALLEST_SLOPE, held_out
from porocore.surrogates.polynomial.monomials import VARIABLES, Polynomial, Terms, invariant, plain
from porocore.surrogates.potential import STILL
from porocore.surrogates.symmetry import (
    Action,
    Equivariance,
    acting_across,
    on_one,
    on_places,
    on_variables,
    stabiliser,
)
from porocore.surrogates.training_box import TrainingBox

#: Degree in the coordinates beyond what the total degree leaves.
MORE = 2
#: Largest degree, and number of coefficients at most; there are no more than equations.
LARGEST_DEGREE, MOST_COEFFICIENTS = 8, 650
#: Widths of the prior from one degree in y to the next, ratios of those in θ̂ to them, and noises that are tried.
DECAYS, RATIOS, NUGGETS = (0.4, 0.25, 0.15, 0.6), (1.0, 1.4, 0.7), (1e-4, 1e-6, 1e-3, 1e-2)
#: Derivatives that vary less than this share of the largest of their kind weigh no more.
SMALL = 1e-2
#: An output that stays below this share of the largest is not learned.
LEAST = 1e-6
#: Kinds of equations.
KINDS = ("value", "by_y", "by_x", "by_yy", "by_yx")


@dataclass(frozen=True, eq=False)
class JointData:
    """Data of o functions f(y, θ̂) at n states; NaN where something is not known.

    Attributes
    ----------
    y : (7, n), x : (l, n)
        Variables and coordinates.
    value : (o, n), by_y : (o, 7, n), by_x : (o, l, n)
        Values and first derivatives.
    by_yy : (o, 7, 7, n) or None, by_yx : (o, 7, l, n) or None
        Second derivatives.
    """

    y: Array
    x: Array
    value: Array
    by_y: Array
    by_x: Array
    by_yy: Array | None = None
    by_yx: Array | None = None


@dataclass(frozen=True)
class Weights:
    """Weights of the kinds of equations, each relative to the spread of its kind; 0 leaves one out."""

    value: float = 1.0
    by_y: float = 1.0
    by_x: float = 1.0
    by_yy: float = 0.3
    by_yx: float = 0.3


@dataclass(frozen=True, eq=False)
class JointFit:
    """Polynomials that were fitted, and their error.

    Attributes
    ----------
    polynomial
        In the k terms and l coordinates, o outputs.
    degree
        Largest weight in the terms.
    error
        Cross-validated root mean square of the scaled quantities that are judged; NaN where nothing was fitted.
    """

    polynomial: Polynomial
    degree: int
    error: float


@dataclass(frozen=True)
class Prior:
    """Prior of the coefficients: widths from one degree to the next in y, the ratio of those in θ̂, and the noise."""

    decay: float = DECAYS[0]
    ratio: float = RATIOS[0]
    nugget: float = NUGGETS[0]


@dataclass(frozen=True, eq=False)
class SharedEquations:
    """Equations of f free coefficients at n states, e for each state.

    Attributes
    ----------
    rows : (n, e, f), right : (n, e)
        Scaled equations.
    judged : (e,) bool
        Those whose error is cross-validated.
    weight, degree : (f,)
        Weight in the terms above the lowest, and degree in θ̂, of each coefficient.
    """

    rows: Array
    right: Array
    judged: npt.NDArray[np.bool_]
    weight: IntArray
    degree: IntArray

    def penalties(self, prior: Prior) -> Array:
        """Return what is added to the diagonal of the normal equations of columns of unit mean square (f,)."""
        widths = prior.decay**self.weight * (prior.decay * prior.ratio) ** self.degree
        penalties: Array = len(self.rows) * (prior.nugget / widths) ** 2
        return penalties

    @cached_property
    def size(self) -> Array:
        """Root mean squares of the columns (f,)."""
        size: Array = np.sqrt((self.rows**2).mean(axis=(0, 1)))
        size[size == 0] = 1.0
        return size

    @cached_property
    def folds(self) -> tuple[list[tuple[Array, Array]], list[tuple[Array, Array]]]:
        """Normal equations of the states that each fold keeps, and the judged equations of those that it leaves out."""
        scaled = self.rows / self.size
        folds = held_out(len(scaled))
        parts = [_normal(scaled[fold], self.right[fold]) for fold in folds]
        gram, moment = sum(part[0] for part in parts), sum(part[1] for part in parts)
        out = [(scaled[fold][:, self.judged], self.right[fold][:, self.judged]) for fold in folds]
        return [(gram - A, moment - b) for A, b in parts], out

    def squares(self, prior: Prior) -> float:
        """Return the sum of the squared errors at states that were left out of a fit; infinite where one fails."""
        penalties, found = np.diag(self.penalties(prior)), 0.0
        for (gram, moment), (rows, right) in zip(*self.folds, strict=True):
            try:
                solution = cho_solve(cho_factor(gram + penalties), moment)
            except LinAlgError:
                return np.inf
            found += float(((rows @ solution - right) ** 2).sum())
        return found

    def solve(self, prior: Prior) -> Array:
        """Return the coefficients (f,)."""
        f = self.rows.shape[-1]
        rows = np.concatenate(
            [(self.rows / self.size).reshape(-1, f), np.diag(np.sqrt(self.penalties(prior)))]
        )
        solution = np.linalg.lstsq(rows, np.concatenate([self.right.ravel(), np.zeros(f)]), rcond=None)[0]
        found: Array = solution / self.size
        return found


def _normal(rows: Array, right: Array) -> tuple[Array, Array]:
    A = rows.reshape(-1, rows.shape[-1])
    return A.T @ A, A.T @ right.ravel()


def fit_joint(
    data: JointData,
    terms: Terms,
    lowest: int,
    *,
    tied: Equivariance,
    weights: Weights,
    judged: str = "by_y",
    highest: int = LARGEST_DEGREE,
) -> JointFit:
    """Fit monomials whose weight in the terms is from ``lowest`` to a degree, as high as the equations allow.

    Parameters
    ----------
    tied
        The symmetry that the polynomials have exactly, in terms and coordinates.
    weights
        Weights of the kinds of equations.
    judged
        Kind of equations by whose error the prior is chosen.
    highest
        Largest degree.
    """
    l, o = len(data.x), len(data.value)
    scales = equation_scales(data, weights, tied)
    each = sum(int(np.isfinite(scale).sum()) for scale in scales.values())
    limit = min(each * data.y.shape[1], MOST_COEFFICIENTS)
    exponents = np.zeros((0, len(terms.weights) + l), dtype=np.int64)
    for degree in range(lowest, highest + 1):
        more = joint_exponents(terms, l, lowest, degree, MORE if l else 0)
        if tied.ties(more).count > limit:
            break
        exponents = more
    systems = _systems(data, terms, exponents, scales, judged, tied) if len(exponents) else []
    if not systems:
        return JointFit(Polynomial.zero(len(terms.weights) + l, o), lowest - 1, np.nan)
    prior, squares = chosen_prior([system for _, system in systems])
    ties = tied.ties(exponents)
    free = np.zeros(ties.count)
    for numbers, system in systems:
        free[numbers] = system.solve(prior)
    coefficients = ties.coefficients(free)
    used = coefficients.any(axis=0)
    count = sum(system.right[:, system.judged].size for _, system in systems)
    found = int((exponents[:, : len(terms.weights)] @ np.array(terms.weights)).max())
    polynomial = Polynomial(exponents[used], coefficients[:, used])
    return JointFit(polynomial, found, float(np.sqrt(squares / count)))


def chosen_prior(systems: list[SharedEquations]) -> tuple[Prior, float]:
    """Return the prior with the smallest cross-validated error, one number after the other, and its squares."""
    best, least = Prior(), sum(system.squares(Prior()) for system in systems)
    for name, values in (("decay", DECAYS), ("ratio", RATIOS), ("nugget", NUGGETS), ("decay", DECAYS)):
        for value in values:
            tried = replace(best, **{name: value})
            if tried != best:
                squares = sum(system.squares(tried) for system in systems)
                if squares < least:
                    best, least = tried, squares
    return best, least


def equation_scales(data: JointData, weights: Weights, tied: Equivariance) -> dict[str, Array]:
    """Return divisors of each kind of equation, (o, …); infinite where one is not known or does not count."""
    size = np.abs(data.value).max(axis=1)
    learned = size > LEAST * size.max(initial=0.0)
    found = {}
    for kind in KINDS:
        values, weight = getattr(data, kind), getattr(weights, kind)
        if values is None or weight == 0 or not values.size:
            continue
        known = np.isfinite(values).all(axis=-1)
        spread = np.where(known, np.nan_to_num(values).std(axis=-1), 0.0)
        for together in tied.outputs.orbits():
            # Outputs that the symmetry exchanges weigh the same.
            spread[together] = spread[together].max(axis=0)
            known[together] &= learned[together].any()
        spread = np.maximum(spread, SMALL * spread.max())
        if kind == "by_yy":
            # Both orders of a mixed derivative are one equation.
            known = known & np.triu(np.ones((VARIABLES, VARIABLES), dtype=bool))
        found[kind] = np.where(known & (spread > 0), spread / weight, np.inf)
    return found


def _systems(
    data: JointData,
    terms: Terms,
    exponents: IntArray,
    scales: dict[str, Array],
    judged: str,
    tied: Equivariance,
) -> list[tuple[IntArray, SharedEquations]]:
    """Return the equations of outputs that share coefficients, with the numbers of these."""
    second = "by_yy" in scales or "by_yx" in scales
    columns = design(terms, exponents, data.y, data.x, second=second)
    k = len(terms.weights)
    weight = exponents[:, :k] @ np.array(terms.weights, dtype=np.int64)
    weight -= weight.min()
    degree = exponents[:, k:].sum(axis=1)
    ties = tied.ties(exponents)
    found = []
    for together in tied.outputs.orbits():
        numbers = np.unique(ties.number[together])
        numbers = numbers[numbers >= 0]
        if not len(numbers):
            continue
        rows, right, judges = [], [], []
        of_weight, of_degree = np.zeros((2, len(numbers)), dtype=np.int64)
        for o in together:
            used = np.flatnonzero(ties.number[o] >= 0)
            place = np.searchsorted(numbers, ties.number[o, used])
            of_weight[place], of_degree[place] = weight[used], degree[used]
            selection = csr_array((ties.sign[o, used], (place, used)), (len(numbers), len(exponents)))
            for kind, scale in scales.items():
                values = getattr(columns, kind)
                for at in np.argwhere(np.isfinite(scale[o])):
                    column = values[(slice(None), *at)]
                    if column.any():
                        rows.append((selection @ column).T / scale[(o, *at)])
                        right.append(getattr(data, kind)[(o, *at)] / scale[(o, *at)])
                        judges.append(kind == judged)
        system = np.stack(rows, axis=1), np.stack(right, axis=1), np.array(judges)
        found.append((numbers, SharedEquations(*system, of_weight, of_degree)))
    return found


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
) -> tuple[PotentialModel, JointFit, FamilyData]:
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
) -> PotentialModel:
    """Return the model of these parts of R, with ⟨∇u¹⟩ fitted and the range of the stable states."""
    return PotentialModel(
        data.rest,
        JointPolynomial(terms, coarse) if len(coarse.exponents) else None,
        fine,
        fit_mean(data).polynomial,
        data.active,
        SampledRange.around(training.inputs, training.inputs.gather(training.states[data.rows])),
        TrainingBox.from_states(data.potential.y, data.active, data.rest.symmetry),
        network=network,
    )
