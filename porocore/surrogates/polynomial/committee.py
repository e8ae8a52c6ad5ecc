"""Committee of polynomials: its disagreement at candidates, and the worth of solving each.

The members are least-squares polynomials of neighbouring degrees, each fitted to all but a fifth of the states (query
by committee, Seung, Opper & Sompolinsky 1992; Krogh & Vedelsby 1995). All of one degree share the equations of their
states, so that the whole committee costs one pass over the data and a few dozen small linear systems.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.interfaces.surrogate import TrainingSet
from porocore.states import Array, IntArray, MacroState
from porocore.surrogates.polynomial.fit import terms_for
from porocore.surrogates.polynomial.least_squares import EQUATIONS_PER_TERM, RIDGE, held_out
from porocore.surrogates.polynomial.terms import Terms, plain
from porocore.surrogates.potential.data import PotentialData, variables
from porocore.surrogates.stretch.log_stretch import LogStretch

#: Weight of values over gradients of <∇u¹>.
GRADIENT_TOLERANCE = 5.0
#: Largest degree and number of coefficients of a member.
HIGHEST_DEGREE, MOST_TERMS = 8, 160


@dataclass(frozen=True, eq=False)
class Target:
    """Target of the members: o quantities, each with its value and its gradient by the variables.

    Attributes
    ----------
    terms, lowest
        Monomials of which terms, from which weight on.
    rows : (1 + 7,)
        Divisors of the value and of the seven gradients; infinite where one is not learned.
    right : (o, 1 + 7, n)
        Value and gradients at the n states, not divided.
    spread : (o, 1 + 7)
        Ranges by which disagreements are divided; infinite where one does not matter.
    """

    terms: Terms
    lowest: int
    rows: Array
    right: Array
    spread: Array


def potential_target(data: PotentialData) -> Target:
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
    return Target(terms, 3, rows, np.concatenate([value[None], gradients])[None], spread)


def mean_gradient_target(data: PotentialData) -> Target:
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
    return Target(plain(data.active), 2, rows, right, spread)


@dataclass(frozen=True, eq=False)
class Committee:
    """Fitted members of one target.

    Attributes
    ----------
    target
        Target of the fits.
    exponents : (K, k)
        Monomials, ascending in weight.
    members
        Coefficients (o, K) of each, zero for monomials beyond its degree.
    degree
        Degree with the smallest cross-validated error.
    covariance : (K', K')
        Covariance of the coefficients up to this degree, for equations with errors of variance one.
    """

    target: Target
    exponents: IntArray
    members: tuple[Array, ...]
    degree: int
    covariance: Array

    def judge(self, states: MacroState) -> PolynomialJudgement:
        """Return the judgement of m candidates."""
        m, K = len(states), len(self.covariance)
        if len(self.members) < 2:
            return PolynomialJudgement(np.zeros(m), *(np.zeros((1, 1, m)) for _ in range(3)))
        y = variables(LogStretch.from_gradient(states.grad_u), states.p)
        design = self.target.terms.design(self.exponents, y)
        spread, learned = self.target.spread, np.isfinite(self.target.rows)
        counted = np.isfinite(spread).any(axis=0)
        answers = np.stack([np.einsum("ok,kcm->ocm", c, design[:, counted]) for c in self.members])
        disagreement: Array = (answers.std(axis=0) / spread[:, counted, None]).max(axis=(0, 1))
        goal = design[:K, counted] / spread.min(axis=0)[counted, None]
        goal = (goal * disagreement).reshape(K, -1)
        rows = design[:K, learned] / self.target.rows[learned, None]
        known = np.einsum("kl,lcm->kcm", self.covariance, rows)
        return PolynomialJudgement(disagreement, rows, known, np.einsum("kl,lcm->kcm", goal @ goal.T, known))


class PolynomialJudgement:
    """Disagreement of the members at m candidates, and the value of solving each of them.

    The value of a candidate is the expected reduction of the variance of the fit at all candidates together, each
    weighted by the square of the disagreement there: Bayesian linear regression, as in I-optimal designs.

    Attributes
    ----------
    disagreement : (m,)
        Standard deviation among the members, the worst quantity's, as a share of its range.
    """

    def __init__(self, disagreement: Array, rows: Array, known: Array, goal: Array) -> None:
        self.disagreement = disagreement
        # Equations of each candidate (K, c, m); the covariance of the coefficients times these; and the weights of the
        # goal times that.
        self._rows, self._known, self._goal = rows, known, goal

    def worth(self) -> Array:
        """Return the value of each candidate, (m,), after those that were taken."""
        taken = _each(self._known, self._goal)
        worth: Array = np.trace(np.linalg.solve(self._own(slice(None)), taken), axis1=1, axis2=2)
        return worth

    def take(self, candidate: int) -> None:
        """Count the candidate as solved."""
        own = self._own(slice(candidate, candidate + 1))[0]
        known, goal = self._known[:, :, candidate].copy(), self._goal[:, :, candidate].copy()
        # As products of matrices: einsum would take ten times as long.
        shared = np.linalg.solve(own, known.T @ self._rows.reshape(len(known), -1))
        self._known -= (known @ shared).reshape(self._known.shape)
        self._goal -= (goal @ shared).reshape(self._goal.shape)

    def _own(self, which: slice) -> Array:
        rows, known = self._rows[:, :, which], self._known[:, :, which]
        return _each(rows, known) + np.eye(rows.shape[1])


def _each(a: Array, b: Array) -> Array:
    """Return Σ_k a_kcm b_kdm for each candidate, (m, c, d); as matrix products, several times as fast as einsum."""
    product: Array = np.ascontiguousarray(a.transpose(2, 1, 0)) @ np.ascontiguousarray(b.transpose(2, 0, 1))
    return product


def committee(data: TrainingSet, responses: tuple[str, ...]) -> Committee:
    """Return the committee of the stable states of ``data``, for a closure that needs ``responses``.

    With too few states for two members, the disagreement is zero.

    Raises
    ------
    DataError
        A response is missing, or fewer than two states are stable.
    """
    known = PotentialData.from_training_set(data)
    target = potential_target(known) if "stress" in responses else mean_gradient_target(known)
    return _fitted(target, known.y)


def judge(data: TrainingSet, responses: tuple[str, ...], candidates: MacroState) -> PolynomialJudgement:
    """Return the judgement of the ``candidates`` by a committee that is fitted to ``data``."""
    return committee(data, responses).judge(candidates)


def _fitted(target: Target, y: Array) -> Committee:
    n = y.shape[1]
    folds = held_out(n)
    counted = np.flatnonzero(np.isfinite(target.rows))
    divisors = target.rows[counted]
    # A degree is judged by what is asked for, as disagreements are.
    asked = np.isfinite(target.spread).any(axis=0)[counted]
    exponents, sizes = _monomials(target, n - int(np.ceil(n / len(folds))), len(counted))
    if not sizes:
        return Committee(target, exponents[:0], (), target.lowest - 1, np.empty((0, 0)))
    design = target.terms.design(exponents, y)[:, counted] / divisors[:, None]
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
    exponents, sizes = target.terms.monomials(target.lowest, target.lowest), {}
    for degree in range(target.lowest, HIGHEST_DEGREE + 1):
        candidates = target.terms.monomials(target.lowest, degree)
        if len(candidates) > MOST_TERMS or len(candidates) * EQUATIONS_PER_TERM > states * equations:
            break
        exponents, sizes[degree] = candidates, len(candidates)
    return exponents, sizes
