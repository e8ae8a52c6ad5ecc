"""Committee of fitted polynomials: what its members disagree about at candidates, and the worth of solving each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from porocore.states import Array, IntArray, MacroState


class Basis(Protocol):
    """Monomials of variables, c − 1 of them, in which the members of a committee are written."""

    def monomials(self, lowest: int, highest: int) -> IntArray:
        """Return the exponents (K, k) of the monomials from one degree to another."""

    def design(self, exponents: IntArray, at: Array) -> Array:
        """Return values and gradients (K, c, n) of monomials at n points of the variables."""

    def at(self, states: MacroState) -> tuple[Array, Array | float]:
        """Return the variables at n states, and the factor (n,) from what is learned to the response."""


@dataclass(frozen=True, eq=False)
class Target:
    """Target of the members: o quantities, each with its value and its gradient by c − 1 variables.

    Attributes
    ----------
    basis, lowest
        Monomials in which the members are written, and the least degree of these.
    known : (v, n)
        Variables at the n states that are known.
    rows : (c,)
        Divisors of the value and of the gradients; infinite where one is not learned.
    right : (o, c, n)
        Value and gradients at these states, not divided.
    spread : (o, c)
        Ranges by which disagreements are divided; infinite where one does not matter.
    """

    basis: Basis
    lowest: int
    known: Array
    rows: Array
    right: Array
    spread: Array


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
        at, amount = self.target.basis.at(states)
        design = self.target.basis.design(self.exponents, at)
        spread, learned = self.target.spread, np.isfinite(self.target.rows)
        counted = np.isfinite(spread).any(axis=0)
        answers = np.stack([np.einsum("ok,kcm->ocm", c, design[:, counted]) for c in self.members])
        disagreement: Array = (answers.std(axis=0) / spread[:, counted, None]).max(axis=(0, 1)) * amount
        goal = design[:K, counted] / spread.min(axis=0)[counted, None] * amount
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
