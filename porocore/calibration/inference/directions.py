"""Directions over the unknowns that the data do not see (UnseenDirection), and the criterion for them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from porocore.calibration.inference.precision import ROUND_OFF, LinearPrecision
from porocore.states import Array

#: A move that changes what a model knows of its unknowns by less than this share is exact: round-off.
EXACT = 1e-12
#: The step of a direction moves no unknown further than so many limits of the rule.
MOST_LIMITS = 4.0


@dataclass(frozen=True, eq=False)
class UnseenDirection:
    """Combination of unknowns that the data do not see.

    Attributes
    ----------
    direction : (k,)
        Unit vector over the coordinates.
    deviation
        Standard deviation along it by the data alone; infinite where they do not see it at all.
    step : (k,)
        A move of the coordinates along it: one standard deviation, or less where that is far.
    change
        Largest change of a measured value by the step to first order, in standard deviations of that value.
    exact
        True where the model knows nothing of a move along it, so that no measurement of any such test sees it.
    """

    direction: Array
    deviation: float
    step: Array
    change: float
    exact: bool = False


def exact_directions(dependence: Array, limits: Array) -> Array:
    """Return the directions (n, k), in limits, along which a model knows nothing of its unknowns.

    Parameters
    ----------
    dependence : (r, k)
        Derivatives, by the coordinates, of all that the model knows of them.
    limits : (k,)
        Of the coordinates.
    """
    rows = dependence * limits
    sizes = np.linalg.norm(rows, axis=1)
    rows = rows[sizes > 0] / sizes[sizes > 0, None]
    if not len(rows):
        return np.eye(len(limits))
    _, values, right = np.linalg.svd(rows)
    rank = int((values > EXACT * values[0]).sum())
    return _sparse(right[rank:])


def unseen_directions(
    jacobian: Array, limits: Array, dependence: Array | None = None
) -> tuple[UnseenDirection, ...]:
    """Return the directions that weighted data do not see, the least seen one first.

    The coordinates are measured in their limits: a step by one is what makes an unknown not identifiable. In these
    units the singular vectors of the Jacobian are independent, with deviations 1/s. A direction is unseen where one
    standard deviation along it moves some unknown beyond its limit. Where several are unseen, any combination is; the
    ones with the fewest unknowns are taken as long as they are unseen too.

    Parameters
    ----------
    jacobian : (m, k)
        Derivatives of the measured values, over their standard deviations, by the coordinates; without priors.
    limits : (k,)
        Of the coordinates, by the rule of identifiability.
    dependence : (r, k)
        Derivatives, by the coordinates, of all that the model knows of the unknowns; exact directions are told apart
        from the others and come first. None: it is not known.
    """
    k = len(limits)
    exact = np.zeros((0, k)) if dependence is None else exact_directions(dependence, limits)
    # The others are sought among what is left.
    rest = np.linalg.svd(exact)[2][len(exact) :] if len(exact) else np.eye(k)
    precision = LinearPrecision.from_jacobian(jacobian * limits @ rest.T)
    others = precision.directions @ rest
    unseen = others[np.abs(others).max(axis=1, initial=0.0) > precision.singular_values]
    sparse = _sparse(unseen)
    if all(_is_unseen(jacobian * limits, each) for each in sparse):
        unseen = sparse
    largest = float(precision.singular_values.max(initial=0.0))
    order = np.argsort(np.linalg.norm(jacobian @ (unseen * limits).T, axis=0), kind="stable")
    found = [_direction(jacobian, limits, each, largest, exact=True) for each in exact]
    return (*found, *(_direction(jacobian, limits, unseen[i], largest) for i in order))


def _beyond_limits(precision: LinearPrecision) -> npt.NDArray[np.bool_]:
    """Return True for singular vectors, in limits, along which one deviation moves an unknown beyond its limit."""
    return np.asarray(np.abs(precision.directions).max(axis=1) > precision.singular_values)


def unseen_count(jacobian: Array, limits: Array) -> int:
    """Return the number of directions that weighted data do not see; see :func:`unseen_directions`."""
    return int(_beyond_limits(LinearPrecision.from_jacobian(jacobian * limits)).sum())


def _is_unseen(scaled: Array, direction: Array) -> bool:
    return float(np.abs(direction).max()) > float(np.linalg.norm(scaled @ direction))


def _sparse(directions: Array) -> Array:
    """Return unit directions (n, k) of the same span, each zero at the pivots of all others."""
    from scipy.linalg import qr

    if len(directions) < 2:
        return directions
    _, _, order = qr(directions, mode="economic", pivoting=True)
    made = np.linalg.solve(directions[:, order[: len(directions)]], directions)
    made[np.abs(made) < 1e-12] = 0.0
    return np.asarray(made / np.linalg.norm(made, axis=1, keepdims=True))


def _direction(
    jacobian: Array, limits: Array, scaled: Array, largest: float, exact: bool = False
) -> UnseenDirection:
    """Return the direction of a unit vector in limits; ``largest`` is the largest singular value there."""
    moves = np.abs(scaled)
    # The first unknown that counts goes up.
    scaled = scaled * np.sign(scaled[int((moves > moves.max() / 10).argmax())])
    seen = float(np.linalg.norm(jacobian @ (scaled * limits)))
    deviation = np.inf if exact or seen <= ROUND_OFF * largest else 1 / seen
    step = scaled * limits * min(deviation, MOST_LIMITS / float(np.abs(scaled).max()))
    length = float(np.linalg.norm(scaled * limits))
    change = float(np.abs(jacobian @ step).max(initial=0.0))
    return UnseenDirection(scaled * limits / length, deviation * length, step, change, exact)


def significant(direction: Array, limits: Array, share: float = 0.02) -> Iterator[int]:
    """Yield the unknowns that a direction moves, in limits, by more than a share of its largest move."""
    moves = np.abs(direction) / limits
    yield from (int(i) for i in np.flatnonzero(moves > share * moves.max()))
