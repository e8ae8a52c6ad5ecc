"""Search of the unknowns (fit): bounded trust-region least squares from several starts, with exact slopes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.calibration.config.settings import FitSettings
from porocore.calibration.problem import Fitted, Misfit
from porocore.core.console import Console, Task
from porocore.errors import SolveError
from porocore.states import Array

#: Tolerance of the searches beside the first, until one is better by more than this share of a variance.
ROUGH, ALIKE = 1e-4, 1e-2
#: A search ends where so many steps together lower the sum of squares by less than this: along a direction that the
#: data do not see it would creep on to a bound, to no effect on any statement.
CREEPING, GAIN = 5, 0.02
#: Evaluations after which half of what was left of a search is taken to be done, for the time left: Gauss–Newton steps
#: seldom need all that they are allowed.
HALF = 5
#: Other starts lie this share of the bounds' distance away from them.
AWAY = 0.1


@dataclass(frozen=True, eq=False)
class Search:
    """End of the search from one start.

    Attributes
    ----------
    start : (k,)
        Coordinates where it began.
    end
        Where it ended; None: the start could not be computed.
    converged
        Whether it ended by its tolerance or for lack of gain, and not by the number of evaluations.
    evaluations
        Evaluations of the misfit.
    failure
        Why there is no end.
    """

    start: Array
    end: Fitted | None
    converged: bool
    evaluations: int
    failure: str = ""


@dataclass(frozen=True, eq=False)
class CalibrationFit:
    """Best point of all searches.

    Attributes
    ----------
    best
        The one with the smallest misfit.
    searches
        All of them.
    """

    best: Fitted
    searches: tuple[Search, ...]

    @property
    def converged(self) -> bool:
        """True where the search that found the best point ended by its tolerance."""
        return any(each.converged and each.end is self.best for each in self.searches)


def starting_points(misfit: Misfit, count: int) -> list[Array]:
    """Return coordinates of the starts: that of the unknowns, then points spread over the bounds."""
    from scipy.stats import qmc

    lower, upper = misfit.bounds
    low, high = lower + AWAY * (upper - lower), upper - AWAY * (upper - lower)
    spread = qmc.Halton(len(lower), scramble=False).random(count)[1:]
    return [misfit.start, *(low + (high - low) * point for point in spread)]


def fit(
    misfit: Misfit, settings: FitSettings, console: Console, first: Sequence[Array] | None = None
) -> CalibrationFit:
    """Search the unknowns that fit the data best, within their bounds.

    Each search is scipy's trust-region method for bounded least squares with the exact Jacobian. A step to where the
    experiment cannot be computed is shortened.

    Parameters
    ----------
    misfit
        Residuals and their slopes.
    settings
        Number of starts, most evaluations, tolerance.
    console
        Shows the progress.
    first
        Coordinates of the starts; by default :func:`starting_points`.

    Raises
    ------
    SolveError
        The experiment can be computed at none of the starts.
    """
    starts = starting_points(misfit, settings.starts) if first is None else first
    searches: list[Search] = []
    with console.task("fit", "searches") as task:
        for done, start in enumerate(starts):
            show = _progress(task, done, len(starts))
            searches.append(_from_start(misfit, start, settings, searches, show))
        task.update(len(starts), len(starts), detail="")
    ends = [each.end for each in searches if each.end is not None]
    if not ends:
        raise SolveError(
            f"the experiments can be computed at none of the {len(starts)} starts; {searches[0].failure}"
        )
    for failed in (each for each in searches if each.end is None):
        console.warn(f"fit: no search from one of the starts: {failed.failure}")
    return CalibrationFit(min(ends, key=lambda end: end.cost), tuple(searches))


def _progress(task: Task, done: int, count: int) -> Callable[[int, float], None]:
    def show(evaluations: int, cost: float) -> None:
        reached = done + 1 - 2 ** (-evaluations / HALF)
        detail = f"evaluation {evaluations}, sum of squares {2 * cost:.5g}"
        task.update(done, count, detail=detail, work=(reached, count - reached))

    return show


def _from_start(
    misfit: Misfit,
    start: Array,
    settings: FitSettings,
    before: Sequence[Search],
    show: Callable[[int, float], None],
) -> Search:
    """Return the search from one start; roughly where it ends no better than one ``before``."""
    if not any(each.end is not None for each in before):
        return _search(misfit, start, settings, settings.tolerance, show)
    least = min(each.end.cost for each in before if each.end is not None)
    rough = _search(misfit, start, settings, max(settings.tolerance, ROUGH), show)
    if rough.end is None or rough.end.cost > least - ALIKE:
        return rough
    return _search(misfit, rough.end.coordinates, settings, settings.tolerance, show)


class _Creeping(Exception):
    """Steps no longer lower the sum of squares by anything that counts."""


class _Steps:
    """Points at which a search takes the Jacobian, one for each step."""

    def __init__(self, misfit: Misfit) -> None:
        self.misfit, self.costs = misfit, list[float]()
        self.last: Fitted | None = None

    def jacobian(self, x: Array) -> Array:
        """Return the Jacobian; raise :class:`_Creeping` where the last steps have gained nothing."""
        self.last = self.misfit.at(x)
        self.costs.append(self.last.cost)
        if len(self.costs) > CREEPING and 2 * (self.costs[-1 - CREEPING] - self.costs[-1]) < GAIN:
            raise _Creeping
        return self.last.jacobian


def _search(
    misfit: Misfit,
    start: Array,
    settings: FitSettings,
    tolerance: float,
    show: Callable[[int, float], None],
) -> Search:
    from scipy.optimize import least_squares

    lower, upper = misfit.bounds
    evaluations, least = 0, np.inf

    def residuals(x: Array) -> Array:
        nonlocal evaluations, least
        evaluations += 1
        try:
            found = misfit.at(x)
        except SolveError:
            # scipy shortens a step to numbers that are not finite.
            return np.full(size, np.nan)
        least = min(least, found.cost)
        show(evaluations, least)
        return found.residuals

    inside = np.clip(start, lower + 1e-6 * (upper - lower), upper - 1e-6 * (upper - lower))
    try:
        size = len(misfit.at(inside).residuals)
    except SolveError as error:
        return Search(start, None, False, 1, str(error))
    steps = _Steps(misfit)
    try:
        found: Any = least_squares(
            residuals,
            inside,
            jac=steps.jacobian,
            bounds=(lower, upper),
            method="trf",
            x_scale="jac",
            ftol=tolerance,
            xtol=tolerance,
            gtol=tolerance,
            max_nfev=settings.evaluations,
        )
    except _Creeping:
        return Search(start, steps.last, True, evaluations)
    return Search(start, misfit.at(np.asarray(found.x, dtype=float)), found.status > 0, evaluations)
