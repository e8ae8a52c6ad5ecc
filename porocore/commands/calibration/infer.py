"""Inference from a fit (infer): precision, non-identifiable directions, intervals, further data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from porocore.commands.calibration.directions import (
    IdentifiableProduct,
    NonIdentifiableDirection,
    direction_words,
    identifiable_product,
    non_identifiable_directions,
    significant,
)
from porocore.commands.calibration.minimum import LinearPrecision, Minimum, Objective, minimise
from porocore.commands.calibration.problem import MANY_VALUES, Fitted, Misfit, Unknown, values_at
from porocore.commands.calibration.profiles import (
    LowerPoint,
    ParameterPlane,
    ProfileInterval,
    confidence_interval,
    parameter_plane,
)
from porocore.commands.calibration.suggestions import (
    FurtherData,
    IdentifiabilityRule,
    Suggestion,
    SystematicError,
    ranked,
    repeated_parts,
)
from porocore.core.echo import joined
from porocore.errors import ConfigurationError
from porocore.states import Array

T = TypeVar("T")
#: Times that the profiles start again because they have met a lower point.
MOST_RESTARTS = 3
#: Rays of the region of two unknowns.
RAYS = 8
#: Fewer rays are no region.
LEAST_RAYS = 3


@dataclass(frozen=True, eq=False)
class Inference:
    """Statements of the data about the unknowns.

    Attributes
    ----------
    unknowns
        The k unknowns, in the order of all members.
    best
        The best point; another than that of the fit where the profiles have met a lower sum of squares.
    data_best
        The best point of the data without priors.
    moved
        True where ``best`` is not the point of the fit.
    limits : (k,)
        Largest moves of the coordinates by the rule of identifiability.
    with_priors, without_priors
        Precision to first order at ``best``.
    directions
        Non-identifiable directions, the least identifiable first.
    intervals, data_intervals
        95 % intervals with and without priors.
    suggestions
        Further data, the most helpful first.
    plane
        Plane of the two unknowns that the data determine least, without priors; None: not asked for, or one unknown.
    evaluations
        Number of points that were asked for.
    points
        Those that could be computed, priors included.
    rule
        Of identifiability.
    products
        Identifiable products of powers of two unknowns, of exact directions.
    systematic
        Known error of the predicted curves; None: none is known.
    """

    unknowns: tuple[Unknown, ...]
    best: Fitted
    data_best: Fitted
    moved: bool
    limits: Array
    with_priors: LinearPrecision
    without_priors: LinearPrecision
    directions: tuple[NonIdentifiableDirection, ...]
    intervals: tuple[ProfileInterval, ...]
    data_intervals: tuple[ProfileInterval, ...]
    suggestions: tuple[Suggestion, ...]
    plane: ParameterPlane | None
    evaluations: int
    points: tuple[Fitted, ...]
    rule: IdentifiabilityRule
    products: tuple[IdentifiableProduct, ...] = ()
    systematic: SystematicError | None = None

    @property
    def words(self) -> tuple[str, ...]:
        """Non-identifiable directions in words."""
        at = self.best.coordinates
        return tuple(direction_words(each, self.unknowns, self.limits, at) for each in self.directions)

    @property
    def identifiable(self) -> tuple[bool, ...]:
        """True where the interval without priors is narrow enough by the rule, for each unknown."""
        rows = zip(self.unknowns, self.values, self.data_intervals, strict=True)
        return tuple(self.rule.holds(one, float(value), *interval.values) for one, value, interval in rows)

    @property
    def values(self) -> Array:
        """Values (k,) of the unknowns at the best point."""
        return values_at(self.unknowns, self.best.coordinates)

    def by_name(self, each: Iterable[T]) -> dict[str, T]:
        """Return something of each unknown by its name."""
        return {one.name: of for one, of in zip(self.unknowns, each, strict=True)}

    @property
    def correlations(self) -> Array:
        """Correlations (k, k) to first order by the data without priors; NaN where they mean nothing.

        They have no meaning between an unknown of a non-identifiable direction and one outside it: the uncertainty of
        the direction dominates that of the first.
        """
        found = self.without_priors.correlations
        moved = np.zeros((len(self.directions), len(self.unknowns)), dtype=bool)
        for row, each in zip(moved, self.directions, strict=True):
            row[list(significant(each.direction, self.limits))] = True
        for row in moved:
            found[np.ix_(row, ~row)] = found[np.ix_(~row, row)] = np.nan
        return found

    def with_error(self, errors: Array, counts: bool = True) -> Inference:
        """Return the statements for curves of which an error is known, which the intervals hold unless it is small.

        Parameters
        ----------
        errors : (m,)
            Predicted less exact values, over the standard deviations of the data.
        counts
            Whether the data have no such error themselves.
        """
        jacobian = self.best.jacobian
        found = SystematicError.at_best(errors, jacobian, self.limits)
        if not counts or found.is_small:
            return replace(self, systematic=found)
        alone = SystematicError.at_best(errors, jacobian[: len(errors)], self.limits)
        intervals = _widened(self.unknowns, self.intervals, found)
        by_data = intervals
        if self.data_intervals is not self.intervals:
            by_data = _widened(self.unknowns, self.data_intervals, alone)
        return replace(
            self,
            systematic=replace(found, counted=True),
            intervals=intervals,
            data_intervals=by_data,
            products=tuple(
                each.moved(self.unknowns, self.data_best.coordinates, alone.shift) for each in self.products
            ),
        )


def _widened(
    unknowns: Sequence[Unknown], intervals: Sequence[ProfileInterval], error: SystematicError
) -> tuple[ProfileInterval, ...]:
    rows = zip(unknowns, intervals, error.shift, strict=True)
    return tuple(interval.widened(one, float(shift)) for one, interval, shift in rows)


def infer(
    misfit: Misfit,
    best: Fitted,
    *,
    rule: IdentifiabilityRule | None = None,
    further: Sequence[FurtherData] = (),
    rays: int = RAYS,
    tell: Callable[[str], None] = lambda text: None,
    dependence: Callable[[Array], Array] | None = None,
) -> Inference:
    """Return what the data say about the unknowns, from the best point of a fit.

    Parameters
    ----------
    misfit
        Of model and data.
    best
        Where the sum of squares is least.
    rule
        Of identifiability; None: ± 10 %, ± 0.04 for a Poisson's ratio.
    further
        Measurements that could be made, ranked beside denser parts of the measured curves.
    rays
        Of the region of the two least determined unknowns; 0: no plane.
    tell
        Called with what is computed next.
    dependence
        Returns, at coordinates (k,), the derivatives (r, k) by them of all that the model knows of the unknowns,
        whatever is measured; None: it is not known.

    Raises
    ------
    ConfigurationError
        No curve depends on any unknown.
    SolveError
        The experiment cannot be computed at ``best``.
    """
    rule = rule or IdentifiabilityRule()
    unknowns = tuple(misfit.unknowns)
    _require_moved(misfit, best)
    objective = Objective(misfit, rule.limits(unknowns, best.coordinates), tell=tell)
    objective.add(best)
    found, intervals = _intervals(objective, best.coordinates)
    alone, data_found, data_intervals = objective.without_priors(), found, intervals
    if any(one.has_prior for one in unknowns):
        data_found, data_intervals = _intervals(alone, found.fitted.coordinates)
    # Of very many data the objective keeps less than the whole point.
    many = len(misfit.data.values) > MANY_VALUES
    fitted = misfit.at(found.fitted.coordinates) if many else found.fitted
    limits, jacobian = rule.limits(unknowns, fitted.coordinates), fitted.of_data.jacobian
    known = None if dependence is None else dependence(fitted.coordinates)
    directions = non_identifiable_directions(jacobian, limits, known)
    products = [identifiable_product(alone, data_found, each, limits) for each in directions if each.exact]
    return Inference(
        unknowns=unknowns,
        best=fitted,
        data_best=data_found.fitted,
        moved=not np.array_equal(fitted.coordinates, best.coordinates),
        limits=limits,
        with_priors=LinearPrecision.from_jacobian(fitted.jacobian),
        without_priors=LinearPrecision.from_jacobian(jacobian),
        directions=directions,
        intervals=intervals,
        data_intervals=data_intervals,
        suggestions=ranked(jacobian, limits, [*further, *repeated_parts(misfit, fitted)]),
        plane=_plane(alone, data_found, data_intervals, rays),
        evaluations=objective.evaluations,
        points=objective.points,
        rule=rule,
        products=tuple(each for each in products if each is not None),
    )


def _require_moved(misfit: Misfit, best: Fitted) -> None:
    """Refuse data of which nothing depends on any unknown."""
    unmoved = misfit.unmoved(best)
    if len(unmoved) == len(misfit.data.names):
        raise ConfigurationError(
            f"expected a curve that {joined(one.name for one in misfit.unknowns)} can change, but "
            f"{joined(unmoved)} would be the same for all values between the bounds, such as a displacement that "
            "the study prescribes; fit another quantity, or other unknowns"
        )


def _intervals(objective: Objective, start: Array) -> tuple[Minimum, tuple[ProfileInterval, ...]]:
    """Return the minimum next to a point, and all intervals about it; again from a lower point that a profile meets."""
    everything = np.arange(len(start))
    for _ in range(MOST_RESTARTS):
        best = minimise(objective, start, everything)
        try:
            return best, tuple(confidence_interval(objective, best, i) for i in everything)
        except LowerPoint as lower:
            start = lower.fitted.coordinates
    best = minimise(objective, start, everything)
    return best, tuple(confidence_interval(objective, best, i, strict=False) for i in everything)


def _plane(
    objective: Objective,
    best: Minimum,
    intervals: Sequence[ProfileInterval],
    rays: int,
) -> ParameterPlane | None:
    """Return the plane of the two unknowns that have the widest distributions, in limits.

    Where an interval of one of them is open, their region is a valley without ends, in which the paths of the profiles
    say all; it has then no rays.
    """
    if rays < LEAST_RAYS or len(intervals) < 2:
        return None
    widths = LinearPrecision.from_jacobian(best.fitted.jacobian * objective.scale).spread
    first, second = sorted(int(i) for i in np.argsort(-widths, kind="stable")[:2])
    is_open = any(end is None for i in (first, second) for end in intervals[i].values)
    return parameter_plane(objective, best, (first, second), 0 if is_open else rays)
