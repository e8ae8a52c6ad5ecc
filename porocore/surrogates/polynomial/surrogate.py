"""Surrogate ``polynomial`` in numpy alone, and the committee of polynomials that disagree.

The members are least-squares polynomials of neighbouring degrees, each fitted to all but a fifth of the states (query
by committee, Seung, Opper & Sompolinsky 1992; Krogh & Vedelsby 1995). All of one degree share the equations of their
states, so that the whole committee costs one pass over the data and a few dozen small linear systems.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.echo import cut, echo
from porocore.errors import ConfigurationError
from porocore.interfaces.surrogate import OnProgress, TrainingProgress, TrainingSet
from porocore.states import Array, IntArray, MacroState
from porocore.surrogates.error_estimate.fit import with_family_error, with_potential_error
from porocore.surrogates.family.fit import Weights, family_model
from porocore.surrogates.model import PotentialModel
from porocore.surrogates.polynomial.family_committee import family_committee
from porocore.surrogates.polynomial.fit import (
    EQUATIONS_PER_TERM,
    RIDGE,
    held_out,
    polynomial_model,
    terms_for,
)
from porocore.surrogates.polynomial.judgement import Committee, PolynomialJudgement, Target
from porocore.surrogates.polynomial.monomials import Terms, plain
from porocore.surrogates.portable import ModelSurrogate
from porocore.surrogates.potential import PotentialData, variables
from porocore.surrogates.stretch import LogStretch


class PolynomialSurrogate(ModelSurrogate):
    """Polynomial W(ln U, p), fitted to W and its first derivatives in milliseconds.

    It has the symmetry of the cell: in a problem of up to three variables by coefficients that are the same, in more
    because the variables are combined to terms that the cell's operations leave alone.

    Parameters
    ----------
    model
        ``potential``, the only one.
    degree : int, 2 to 12
        Largest weight of a monomial, which leaves two equations for each coefficient; null: the one with the smallest
        cross-validated error, and at most 4 in up to three variables: what is finer is not continued beyond the sampled
        states, whose hull is no box.
    """

    backend = "polynomial"
    models = ("potential",)
    learns_parameters = True

    def __init__(self, *, model: str | None = None, degree: int | None = None, **unknown: Any) -> None:
        if unknown:
            raise ConfigurationError(
                f"surrogate.options.{cut(min(unknown))}: the polynomial surrogate has no such option; "
                "its option is degree"
            )
        if degree is not None and (
            isinstance(degree, bool) or not isinstance(degree, int) or not 2 <= degree <= 12
        ):
            raise ConfigurationError(
                f"surrogate.options.degree: expected a whole number from 2 to 12, got {echo(degree)}"
            )
        super().__init__(model=model, degree=degree)
        self.degree = degree

    def train(
        self, data: TrainingSet, seed: int, checkpoint: Path | None, on_progress: OnProgress | None
    ) -> tuple[PotentialModel, dict[str, float]]:
        """Fit to the stable states of ``data``; nothing is random, and nothing takes long enough to be resumed."""
        if data.inputs.parameters:
            return self._train_family(data, on_progress)
        model, found = polynomial_model(data, self.degree)
        errors = {"cross-validated slopes of W": found.errors[found.degree]} if found.errors else {}
        if on_progress is not None:
            loss = found.errors.get(found.degree, float("nan")) ** 2
            on_progress(TrainingProgress(1, 1, loss))
        self.settings = {"degree": found.degree}
        return with_potential_error(model, data), errors

    def _train_family(
        self, data: TrainingSet, on_progress: OnProgress | None
    ) -> tuple[PotentialModel, dict[str, float]]:
        model, found, known = family_model(data, Weights(), self.degree)
        if on_progress is not None:
            on_progress(TrainingProgress(1, 1, found.error**2))
        self.settings = {"degree": found.degree}
        errors = {"cross-validated slopes of W": found.error} if np.isfinite(found.error) else {}
        return with_family_error(model, known, data.tolerance), errors


#: Weight of values over gradients of <∇u¹>.
GRADIENT_TOLERANCE = 5.0
#: Largest degree and number of coefficients of a member.
HIGHEST_DEGREE, MOST_TERMS = 8, 160


@dataclass(frozen=True, eq=False)
class StateBasis:
    """Monomials of terms of ln U and p.

    Attributes
    ----------
    terms
        The terms.
    """

    terms: Terms

    def monomials(self, lowest: int, highest: int) -> IntArray:
        """Return the exponents of the monomials of these weights."""
        return self.terms.monomials(lowest, highest)

    def design(self, exponents: IntArray, at: Array) -> Array:
        """Return values and gradients by the seven variables."""
        return self.terms.design(exponents, at)

    def at(self, states: MacroState) -> tuple[Array, Array | float]:
        """Return the seven variables (7, n); what is learned is the response itself."""
        return variables(LogStretch.from_gradient(states.grad_u), states.p), 1.0


def committee(data: TrainingSet, responses: tuple[str, ...]) -> Committee:
    """Return the committee of the stable states of ``data``, for a closure that needs ``responses``.

    With too few states for two members, the disagreement is zero. Of a cell with parameters the members are functions
    of these too.

    Raises
    ------
    DataError
        A response is missing, fewer than two states are stable, or a family lacks its undeformed members.
    """
    if data.inputs.parameters:
        return family_committee(data, responses)
    return _fitted(_target(PotentialData.from_training_set(data), responses))


def judge(data: TrainingSet, responses: tuple[str, ...], candidates: MacroState) -> PolynomialJudgement:
    """Return the judgement of the ``candidates`` by a committee that is fitted to ``data``."""
    return committee(data, responses).judge(candidates)


def _target(data: PotentialData, responses: tuple[str, ...]) -> Target:
    return _potential(data) if "stress" in responses else _mean_gradient(data)


def _potential(data: PotentialData) -> Target:
    """Return W beyond second order; disagreements are those of stress and fluid volume."""
    terms = terms_for(data)
    value, gradients = data.remainder
    rows = data.scales.copy()
    if terms.name == "plain":
        rows[1:][[a for a in range(7) if a not in terms.variables]] = np.inf
    ranges = np.ptp(data.gradient, axis=1)
    spread = np.full((1, 8), np.inf)
    spread[0, 1:7] = ranges[:6].max() or np.inf
    spread[0, 7] = ranges[6] or np.inf
    right = np.concatenate([value[None], gradients])[None]
    return Target(StateBasis(terms), 3, data.y, rows, right, spread)


def _mean_gradient(data: PotentialData) -> Target:
    """Return <∇u¹>_s in the frame of the stretch, beyond first order; disagreements are those of its values."""
    value, gradients = data.mean_grad_remainder
    learned = np.flatnonzero(np.abs(value).max(axis=1) > 1e-12)
    value, gradients = value[learned], gradients[learned]
    rows = np.full(8, np.inf)
    # One divisor for all quantities, so that they share their equations.
    rows[0] = value.std(axis=1).max(initial=0.0) or 1.0
    active = list(data.active)
    # The gradients of <∇u¹> jump where the pore wall begins to touch itself, so they count for less.
    spread_of_gradients = gradients.std(axis=(0, 2))[active] + 1e-3 * np.abs(gradients).max(initial=1e-300)
    rows[1:][active] = GRADIENT_TOLERANCE * spread_of_gradients
    spread = np.full((len(learned), 8), np.inf)
    spread[:, 0] = np.ptp(data.mean_grad, axis=1).max() or np.inf
    right = np.concatenate([value[:, None], gradients], axis=1)
    return Target(StateBasis(plain(data.active)), 2, data.y, rows, right, spread)


def _fitted(target: Target) -> Committee:
    n = target.known.shape[1]
    folds = held_out(n)
    counted = np.flatnonzero(np.isfinite(target.rows))
    divisors = target.rows[counted]
    # A degree is judged by what is asked for, as disagreements are.
    asked = np.isfinite(target.spread).any(axis=0)[counted]
    exponents, sizes = _monomials(target, n - int(np.ceil(n / len(folds))), len(counted))
    if not sizes:
        return Committee(target, exponents[:0], (), target.lowest - 1, np.empty((0, 0)))
    design = target.basis.design(exponents, target.known)[:, counted] / divisors[:, None]
    right = target.right[:, counted] / divisors[:, None]
    length = np.sqrt((design**2).sum(axis=(1, 2)))
    length[length == 0] = 1.0
    design /= length[:, None, None]
    grams, moments = [], []
    for fold in folds:
        A = design[:, :, fold].reshape(len(exponents), -1)
        grams.append(A @ A.T)
        moments.append(A @ right[:, :, fold].reshape(len(right), -1).T)
    whole, moment = sum(grams), sum(moments)
    errors: dict[int, float] = {}
    fits: dict[int, list[Array]] = {}
    for degree, K in sizes.items():
        fits[degree], squares = [], 0.0
        for fold, own, own_moment in zip(folds, grams, moments, strict=True):
            left = (whole - own)[:K, :K] + RIDGE * np.eye(K)
            found = np.linalg.solve(left, (moment - own_moment)[:K])
            wrong = np.einsum("ko,kcn->ocn", found, design[:K, :, fold]) - right[:, :, fold]
            squares += float((wrong[:, asked] ** 2).sum())
            coefficients = np.zeros((len(right), len(exponents)))
            coefficients[:, :K] = found.T
            fits[degree].append(coefficients / length)
        errors[degree] = squares
    best = min(errors, key=lambda degree: errors[degree])
    members = [c for degree in fits if abs(degree - best) <= 1 for c in fits[degree]]
    K = sizes[best]
    scale = length[:K, None] * length[:K]
    covariance = np.linalg.inv(whole[:K, :K] + RIDGE * np.eye(K)) / scale
    return Committee(target, exponents, tuple(members), best, covariance)


def _monomials(target: Target, states: int, equations: int) -> tuple[IntArray, dict[int, int]]:
    """Return the monomials of all degrees that so many states determine, and their number up to each degree."""
    exponents, sizes = target.basis.monomials(target.lowest, target.lowest), {}
    for degree in range(target.lowest, HIGHEST_DEGREE + 1):
        candidates = target.basis.monomials(target.lowest, degree)
        if len(candidates) > MOST_TERMS or len(candidates) * EQUATIONS_PER_TERM > states * equations:
            break
        exponents, sizes[degree] = candidates, len(candidates)
    return exponents, sizes
