"""Polynomials fitted to values and gradients, degree by cross-validation; the model put together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from porocore.core.inputs import SampledRange
from porocore.core.tensors import PointGroup
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, IntArray
from porocore.surrogates.family.joint import JointPolynomial
from porocore.surrogates.model import PotentialModel
from porocore.surrogates.network.separable import SeparableNetwork
from porocore.surrogates.polynomial.composition import composed
from porocore.surrogates.polynomial.monomials import Polynomial, Terms, invariant, plain
from porocore.surrogates.potential import PotentialData
from porocore.surrogates.symmetry import (
    Equivariance,
    acting_across,
    on_one,
    on_places,
    on_variables,
    stabiliser,
)
from porocore.surrogates.training_box import TrainingBox

#: Equations for each coefficient; with fewer, a bad fit need not show in its residual.
EQUATIONS_PER_TERM = 2
RIDGE = 1e-10
LARGEST_DEGREE = 12
FOLDS = 5


def held_out(n: int) -> list[npt.NDArray[np.bool_]]:
    """Return which of n states each fold of a cross-validation leaves out."""
    count = min(FOLDS, n)
    return [np.arange(n) % count == fold for fold in range(count)]


@dataclass(frozen=True, eq=False)
class RegressionData:
    """Data to be fitted, o quantities at n states.

    Attributes
    ----------
    y : (7, n)
        Variables.
    value : (o, n), gradients : (o, 7, n)
        Quantities and derivatives.
    value_scale : (o,), gradient_scale : (o, 7)
        Divisors of the errors; infinite for a derivative that is not fitted.
    """

    y: Array
    value: Array
    gradients: Array
    value_scale: Array
    gradient_scale: Array

    def subset(self, rows: IntArray) -> RegressionData:
        """Return the data of some states."""
        return RegressionData(
            self.y[:, rows],
            self.value[:, rows],
            self.gradients[:, :, rows],
            self.value_scale,
            self.gradient_scale,
        )

    @property
    def fitted(self) -> Array:
        """Derivatives that count, (7,) bool."""
        finite: Array = np.isfinite(self.gradient_scale).any(axis=0)
        return finite


@dataclass(frozen=True, eq=False)
class Fit:
    """Fitted polynomial in terms.

    Attributes
    ----------
    polynomial
        In the terms; o outputs.
    degree
        Largest weight of a monomial.
    errors
        Cross-validated error of each degree that was tried: root mean square of the scaled gradients' errors.
    """

    polynomial: Polynomial
    degree: int
    errors: dict[int, float]


def fit(
    samples: RegressionData,
    terms: Terms,
    lowest: int,
    *,
    degree: int | None = None,
    highest: int = LARGEST_DEGREE,
    tied: Equivariance | None = None,
) -> Fit:
    """Fit monomials of weight ``lowest`` … degree; without ``degree`` that of the smallest cross-validated error.

    With ``tied`` the polynomials have that symmetry exactly.

    No more monomials are tried than leave two equations for each. With too few equations for any, the
    polynomial is zero (degree ``lowest`` − 1).
    """
    n = samples.value.shape[1]
    equations = n * (1 + int(samples.fitted.sum()))
    degrees = [lowest - 1]
    for candidate in range(lowest, highest + 1):
        if len(terms.monomials(lowest, candidate)) * EQUATIONS_PER_TERM > equations:
            break
        degrees.append(candidate)
    if degree is not None:
        degrees = [degree] if degree in degrees else [degrees[-1]]
    errors: dict[int, float] = {}
    if len(degrees) > 1:
        for candidate in degrees:
            exponents = terms.monomials(lowest, candidate)
            if len(exponents) * EQUATIONS_PER_TERM > equations * (1 - 1 / FOLDS):
                break
            squares = 0.0
            for test in held_out(n):
                trained = _solve(samples.subset(np.flatnonzero(~test)), terms, exponents, tied)
                squares += _error(samples.subset(np.flatnonzero(test)), terms, trained)
            errors[candidate] = float(np.sqrt(squares / n))
        best = min(errors, key=lambda d: errors[d])
    else:
        best = degrees[0]
    return Fit(_solve(samples, terms, terms.monomials(lowest, best), tied), best, errors)


def _solve(
    samples: RegressionData, terms: Terms, exponents: IntArray, tied: Equivariance | None
) -> Polynomial:
    outputs = len(samples.value)
    if not len(exponents):
        return Polynomial(exponents, np.zeros((outputs, 0)))
    design = terms.design(exponents, samples.y)
    value, gradients = design[:, 0], design[:, 1:]
    equations = []
    for o in range(outputs):
        kept = np.isfinite(samples.gradient_scale[o])
        scale = samples.gradient_scale[o, kept][:, None]
        rows = np.concatenate(
            [value / samples.value_scale[o], (gradients[:, kept] / scale).reshape(len(exponents), -1)], axis=1
        ).T
        right = np.concatenate(
            [samples.value[o] / samples.value_scale[o], (samples.gradients[o, kept] / scale).ravel()]
        )
        equations.append((rows, right))
    return Polynomial(exponents, tied_least_squares(equations, exponents, tied))


def tied_least_squares(
    equations: list[tuple[Array, Array]], exponents: IntArray, tied: Equivariance | None
) -> Array:
    """Return the least-squares coefficients (o, K) of the monomials (K, v), with one system for each output.

    Parameters
    ----------
    equations
        Rows (m, K) and right-hand sides (m,).
    tied
        The symmetry that the polynomials have exactly; None: none.
    """
    if tied is None:
        return np.stack([least_squares(rows, right) for rows, right in equations])
    ties = tied.ties(exponents)
    coefficients = np.zeros((len(equations), len(exponents)))
    for together in tied.outputs.orbits():
        free = np.unique(ties.number[together])
        free = free[free >= 0]
        if not len(free):
            continue
        blocks = []
        for o in together:
            selection = np.zeros((len(exponents), len(free)))
            used = np.flatnonzero(ties.number[o] >= 0)
            selection[used, np.searchsorted(free, ties.number[o, used])] = ties.sign[o, used]
            blocks.append((equations[o][0] @ selection, selection))
        found = least_squares(
            np.concatenate([rows for rows, _ in blocks]),
            np.concatenate([equations[o][1] for o in together]),
        )
        for o, (_, selection) in zip(together, blocks, strict=True):
            coefficients[o] = selection @ found
    return coefficients


def least_squares(rows: Array, right: Array, ridge: float = RIDGE) -> Array:
    """Return the solution (K,) of equations (m, K), or (K, o) of several right-hand sides, columns of any size.

    A ridge, relative to the squares of the columns, keeps small what the equations do not tell.
    """
    size = np.sqrt((rows**2).sum(axis=0))
    size[size == 0] = 1.0
    # As further equations: columns that the samples do not move stay small.
    more = np.sqrt(ridge) * np.eye(len(size))
    nothing = np.zeros((len(size), *right.shape[1:]))
    solution = np.linalg.lstsq(
        np.concatenate([rows / size, more]), np.concatenate([right, nothing]), rcond=None
    )[0]
    found: Array = (solution.T / size).T
    return found


def _error(samples: RegressionData, terms: Terms, polynomial: Polynomial) -> float:
    """Return the sum over the states of the mean square of the scaled gradient errors."""
    t, J, _ = terms.polynomial.derivatives(samples.y, second=False)
    _, by_t, _ = polynomial.derivatives(t, second=False)
    wrong = np.einsum("otn,tan->oan", by_t, J) - samples.gradients
    counts = np.isfinite(samples.gradient_scale)
    scaled = np.where(counts[:, :, None], wrong / samples.gradient_scale[:, :, None], 0.0)
    return float((scaled**2).sum() / max(counts.sum(), 1))


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
    network: SeparableNetwork | None = None,
    refinement: Polynomial | None = None,
) -> PotentialModel:
    """Return the model of these parts of W, with <∇u¹>_s fitted and the range of the stable states."""

    def part(found: Polynomial | None) -> JointPolynomial | None:
        return JointPolynomial(terms, found) if found is not None and len(found.exponents) else None

    return PotentialModel(
        data.rest,
        part(polynomial),
        part(refinement),
        fit_mean_grad(data),
        data.active,
        sampled_range(training),
        TrainingBox.from_states(data.y, data.active, data.rest.symmetry),
        network,
    )


def sampled_range(training: TrainingSet) -> SampledRange:
    """Return the hull of the states from which a potential learns."""
    stable = np.flatnonzero(training.responses.stable)
    return SampledRange.around(training.inputs, training.inputs.gather(training.states[stable]))
