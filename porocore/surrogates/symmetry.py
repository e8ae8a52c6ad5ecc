"""Action of a point group on variables and predictions; ties between polynomial coefficients.

A signed permutation Q of the axes takes L to Q L Qᵀ, so it permutes the components of L and changes some of their
signs; the same holds of the places of a tensor that is predicted. Nothing but permutations and signs is needed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from porocore.core.tensors import PointGroup
from porocore.states import Array, IntArray
from porocore.surrogates.stretch import COMPONENT, PLACES


@dataclass(frozen=True, eq=False)
class Action:
    """Signed permutations of k numbers, one for each of g operations.

    Attributes
    ----------
    to : (g, k)
        The place to which each goes.
    sign : (g, k)
        The sign that it gets there, 1 or −1.
    """

    to: IntArray
    sign: IntArray

    def on(self, places: list[int]) -> Action:
        """Return the same action on some of the numbers, among which they must stay."""
        number = np.full(self.to.shape[1], -1)
        number[places] = np.arange(len(places))
        return Action(number[self.to[:, places]], self.sign[:, places])

    def orbits(self) -> list[list[int]]:
        """Return the sets of numbers that operations exchange."""
        return [
            rows
            for rows in (np.flatnonzero(self.to.min(axis=0) == k).tolist() for k in range(self.to.shape[1]))
            if rows
        ]

    def mean(self, other: Action, matrix: Array) -> Array:
        """Return the part of a matrix (k, l), l numbers of ``other`` → k of this, that no operation changes."""
        found, vanishes = np.zeros_like(matrix), np.zeros(matrix.shape, dtype=bool)
        rows, columns = np.arange(matrix.shape[0])[:, None], np.arange(matrix.shape[1])
        for to, sign, to_other, sign_other in zip(self.to, self.sign, other.to, other.sign, strict=True):
            signs = sign[:, None] * sign_other
            found[np.ix_(to, to_other)] += signs * matrix
            # Sums of what cancels would leave round-off, and cost the short ways of laws with many zeros.
            vanishes |= (to[:, None] == rows) & (to_other == columns) & (signs < 0)
        found[vanishes] = 0.0
        return found / len(self.to)


def _action(group: PointGroup, places: list[tuple[int, int]], number: IntArray) -> Action:
    to, sign = [], []
    for Q in group.matrices:
        axis = np.abs(Q).argmax(axis=0)
        factor = Q[axis, np.arange(3)]
        to.append([number[axis[i], axis[j]] for i, j in places])
        sign.append([factor[i] * factor[j] for i, j in places])
    return Action(np.array(to, dtype=np.int64), np.array(sign, dtype=np.int64))


@lru_cache(maxsize=64)
def on_variables(group: PointGroup) -> Action:
    """Return the action on y: six components of L, and p, which stays."""
    L = _action(group, list(PLACES), np.asarray(COMPONENT))
    g = len(group)
    return Action(
        np.column_stack([L.to, np.full(g, 6)]), np.column_stack([L.sign, np.ones(g, dtype=np.int64)])
    )


@lru_cache(maxsize=64)
def on_places(group: PointGroup) -> Action:
    """Return the action on the nine places of a tensor, row by row."""
    return _action(group, [divmod(k, 3) for k in range(9)], np.arange(9).reshape(3, 3))


@lru_cache(maxsize=64)
def on_triangle(group: PointGroup) -> Action:
    """Return the action on the upper triangle of a symmetric tensor, row by row."""
    return _action(
        group,
        [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)],
        np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]]),
    )


def on_one(group: PointGroup) -> Action:
    """Return the action on a scalar."""
    ones = np.ones((len(group), 1), dtype=np.int64)
    return Action(0 * ones, ones)


def stabiliser(group: PointGroup, active: tuple[int, ...]) -> PointGroup:
    """Return the operations that take the variables ``active`` to each other and to no others."""
    to = on_variables(group).to
    keeps = [set(row[list(active)].tolist()) == set(active) for row in to]
    return PointGroup(tuple(Q for Q, keep in zip(group.rotations, keeps, strict=True) if keep))


def acting_across(group: PointGroup, active: tuple[int, ...]) -> tuple[int, ...]:
    """Return the variables besides ``active`` along which the group allows a gradient where these alone move.

    There is none where an operation that leaves the active ones as they are changes a variable's sign.
    """
    action = on_variables(group)
    stays = action.to == np.arange(7)
    fixes = (stays & (action.sign == 1))[:, list(active)].all(axis=1)
    mirrored = (stays & (action.sign == -1))[fixes].any(axis=0)
    return tuple(a for a in range(7) if a not in active and not mirrored[a])


@dataclass(frozen=True, eq=False)
class Ties:
    """Coefficients of equivariant polynomials that are equal but for a sign.

    Attributes
    ----------
    number : (o, K)
        Index of the free number of each output and monomial; −1 where the coefficient vanishes.
    sign : (o, K)
        Its sign.
    count
        Number of free numbers.
    """

    number: IntArray
    sign: IntArray
    count: int

    @classmethod
    def from_actions(cls, exponents: IntArray, variables: Action, outputs: Action) -> Ties:
        """Return the ties of f with f(ρ(Q) y) = σ(Q) f(y), for monomials (K, v) closed under the operations."""
        K, o = len(exponents), outputs.to.shape[1]
        base = int(exponents.max(initial=0)) + 1
        if base ** exponents.shape[1] > 2**62:
            raise ValueError("too many variables of too high a degree")
        powers = base ** np.arange(exponents.shape[1], dtype=np.int64)
        code = exponents @ powers
        order = np.argsort(code)
        image = np.empty((len(variables.to), o * K), dtype=np.int64)
        sign = np.empty_like(image)
        for row, (to, factor, out_to, out_factor) in enumerate(
            zip(variables.to, variables.sign, outputs.to, outputs.sign, strict=True)
        ):
            moved = np.empty_like(exponents)
            moved[:, to] = exponents
            there = order[np.searchsorted(code, moved @ powers, sorter=order)]
            odd = np.where(exponents % 2 == 1, factor, 1).prod(axis=1)
            image[row] = (out_to[:, None] * K + there).ravel()
            sign[row] = (out_factor[:, None] * odd).ravel()
        first = image.min(axis=0)
        vanishes = ((image == np.arange(o * K)) & (sign == -1)).any(axis=0)
        vanishes |= vanishes[first]
        relative = np.take_along_axis(sign, image.argmin(axis=0)[None], axis=0)[0]
        kept, number = np.unique(first[~vanishes], return_inverse=True)
        found = np.full(o * K, -1)
        found[~vanishes] = number.reshape(-1)
        return cls(found.reshape(o, K), relative.reshape(o, K), len(kept))

    def coefficients(self, free: Array) -> Array:
        """Return the coefficients (o, K) for free numbers."""
        spread: Array = np.where(self.number < 0, 0.0, self.sign * np.append(free, 0.0)[self.number])
        return spread


@dataclass(frozen=True, eq=False)
class Equivariance:
    """Equivariance of polynomials f: f(ρ(Q) y) = σ(Q) f(y) for the operations Q of a group.

    Attributes
    ----------
    variables
        ρ, on the variables of the polynomials.
    outputs
        σ, on their values.
    """

    variables: Action
    outputs: Action

    def ties(self, exponents: IntArray) -> Ties:
        """Return the ties of the coefficients of monomials (K, v)."""
        return Ties.from_actions(exponents, self.variables, self.outputs)
