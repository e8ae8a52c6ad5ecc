"""Fit of the unknowns (fit): search from several starts, record of its evaluations (RecordedModel), quality."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from porocore.commands.calibration.problem import (
    MANY_VALUES,
    CurveData,
    CurveModel,
    CurvePrediction,
    Fitted,
    Misfit,
    Unknown,
)
from porocore.commands.calibration.settings import FitSettings
from porocore.core.console import Console, Task
from porocore.core.files.atomic import atomic_path
from porocore.core.files.reading import complete, read_text
from porocore.errors import RunFolderError, SolveError
from porocore.states import Array

FORMAT = "porocore-evaluations"
#: Size of a record that is read [bytes].
LARGEST = 1 << 30


class RecordedModel(CurveModel):
    """Model whose evaluations are kept in a file of JSON lines, each when it is made, and not made again.

    An evaluation of very many values has a file of its own beside it, with slopes of single precision.

    Parameters
    ----------
    unknowns
        Of the model.
    model
        Returns the model; called where curves are asked for that the file does not have.
    path
        The file, made where there is none. A last line that is incomplete is removed.
    identity
        Hash of all that the curves depend on beside the values of the unknowns.

    Raises
    ------
    RunFolderError
        The file is of another model, damaged, or cannot be written.
    """

    def __init__(
        self, unknowns: Sequence[Unknown], model: Callable[[], CurveModel], path: Path, identity: str
    ) -> None:
        self.unknowns, self.path, self.identity = tuple(unknowns), path, identity
        self._model = model
        self._known: dict[tuple[float, ...], dict[str, Any]] = {}
        try:
            text = read_text(path, LARGEST) if path.exists() else ""
            whole = text[: text.rfind("\n") + 1]
            if whole != text:
                path.write_text(whole, encoding="utf-8", newline="\n")
            self._read(whole.splitlines())
        except OSError as error:
            raise self._unusable(f"cannot be used: {error.strerror or error}") from None
        if not whole:
            self._append({"format": FORMAT, "identity": identity})

    def __len__(self) -> int:
        return len(self._known)

    def __iter__(self) -> Iterator[tuple[Array, CurvePrediction | None]]:
        """Yield values (k,) and curves of every evaluation, None where there were none, in the order they were made."""
        for values, line in self._known.items():
            yield np.array(values), None if "failed" in line else self._prediction(line)

    def curves(self, values: Array) -> CurvePrediction:
        """Return the curves; see :class:`~porocore.commands.calibration.problem.CurveModel`.

        Raises
        ------
        SolveError
            They cannot be computed there.
        RunFolderError
            The file cannot be written.
        """
        key = tuple(values.tolist())
        if (line := self._known.get(key)) is not None:
            if "failed" in line:
                raise SolveError(line["failed"])
            return self._prediction(line)
        try:
            found = self._model().curves(values)
        except SolveError as error:
            self._keep(key, {"failed": str(error)})
            raise
        if len(found.values) > MANY_VALUES:
            self._keep(key, {"file": self._file_of(found), "flagged": found.flagged})
            # What a call that goes on with the files reads.
            return self._prediction(self._known[key])
        outcome = {"values": found.values.tolist(), "slopes": found.slopes.tolist(), "flagged": found.flagged}
        self._keep(key, outcome)
        return found

    def _file_of(self, found: CurvePrediction) -> str:
        """Write values and slopes into a file of their own, and return its name."""
        path = self.path.with_name(f"{self.path.stem}-{len(self._known) + 1}.npz")
        try:
            with atomic_path(path) as made, made.open("wb") as file:
                np.savez(file, values=found.values, slopes=found.slopes.astype(np.float32))
        except OSError as error:
            raise RunFolderError(f"{path} cannot be written: {error.strerror or error}") from None
        return path.name

    def _prediction(self, line: dict[str, Any]) -> CurvePrediction:
        if "file" not in line:
            return _prediction(line)
        path = self.path.with_name(line["file"])
        try:
            with np.load(path, allow_pickle=False) as file:
                values, slopes = file["values"], file["slopes"].astype(float)
        except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as error:
            raise RunFolderError(f"{path} cannot be read: {error}; start again in another --out") from None
        return CurvePrediction(values, slopes, bool(line["flagged"]))

    def _keep(self, key: tuple[float, ...], outcome: dict[str, Any]) -> None:
        line = {"unknowns": list(key), **outcome}
        self._append(line)
        self._known[key] = line

    def _read(self, lines: list[str]) -> None:
        if not lines:
            return
        with complete(self.path, "record of evaluations", "start again"):
            head, *rest = (json.loads(line) for line in lines)
            if (head["format"], head["identity"]) != (FORMAT, self.identity):
                raise self._unusable(
                    "holds evaluations of another calibration; choose another --out, or undo the change of the "
                    "configuration, data or version"
                )
            self._known = {tuple(line["unknowns"]): line for line in rest}

    def _append(self, line: dict[str, Any]) -> None:
        try:
            with self.path.open("a", encoding="utf-8", newline="\n") as file:
                file.write(json.dumps(line) + "\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise self._unusable(f"cannot be written: {error.strerror or error}") from None

    def _unusable(self, why: str) -> RunFolderError:
        return RunFolderError(f"{self.path} {why}")


def _prediction(line: dict[str, Any]) -> CurvePrediction:
    values = np.array(line["values"], dtype=float)
    slopes = np.array(line["slopes"], dtype=float).reshape(len(values), len(line["unknowns"]))
    return CurvePrediction(values, slopes, bool(line["flagged"]))


#: Data are not explained where the reduced chi-square is above this, and so large a one comes by chance less often.
LARGE, CHANCE = 2.0, 1e-6
#: Standard deviations are too large where the reduced chi-square is below this, with so many degrees of freedom.
SMALL, ENOUGH = 0.1, 10
#: So near to a bound, as a share of the distance of both, an unknown lies at it.
CLOSE = 1e-6


@dataclass(frozen=True)
class FitQuality:
    """Quality of the best point: chi-square and the distances of each curve.

    Attributes
    ----------
    chi_square
        Sum of the squares of (predicted − measured)/deviation.
    freedom
        Number of values less that of unknowns, 1 at least.
    deviations_off
        Root mean square of (predicted − measured)/deviation of each curve, by its name.
    chance
        Probability of a chi-square at least as large, if the model is right and the standard deviations are.
    films
        Names of the curves that are measured fields.
    """

    chi_square: float
    freedom: int
    deviations_off: dict[str, float]
    chance: float
    films: frozenset[str] = frozenset()

    @classmethod
    def of_fit(cls, misfit: Misfit, best: Fitted) -> FitQuality:
        """Return the quality of a point."""
        from scipy.stats import chi2

        data: CurveData = misfit.data
        residuals: Array = best.residuals[: len(data.values)]
        freedom = max(1, len(residuals) - len(misfit.unknowns))
        off = {
            name: float(np.sqrt(np.mean(residuals[data.curve == k] ** 2)))
            for k, name in enumerate(data.names)
        }
        total = float(residuals @ residuals)
        return cls(total, freedom, off, float(chi2.sf(total, freedom)), data.films)

    @property
    def reduced(self) -> float:
        """Chi-square by the degrees of freedom, about 1 where the model explains the data."""
        return self.chi_square / self.freedom

    @property
    def explains(self) -> bool:
        """False where the data are farther from every prediction than their standard deviations allow."""
        return self.reduced <= LARGE or self.chance >= CHANCE

    @property
    def complaint(self) -> str:
        """One sentence where the data are not explained, or too well; empty where neither is so."""
        if self.reduced < SMALL and self.freedom >= ENOUGH:
            keys = "'deviation:'"
            keys += ", 'deviation_share:'" * bool(self.deviations_off.keys() - self.films)
            keys += ", 'pressure_deviation:'" * bool(self.films)
            return (
                f"the standard deviations are too large: the reduced chi-square is {self.reduced:.3g}, expected about "
                f"1, so that all intervals are too wide. Multiply {keys} or the deviations in the file by its root, "
                f"{np.sqrt(self.reduced):.2g}, which makes them the scatter that was found, and "
                "check their units"
            )
        if self.explains:
            return ""
        name, off = max(self.deviations_off.items(), key=lambda each: each[1])
        kind, columns = "curve", "units, signs and zero of its columns ('offset:' is subtracted)"
        if name in self.films:
            kind = "film"
            columns = (
                "units and signs of its columns, its first image (displacements are since t = 0), 'camera:'"
            )
        return (
            f"no values of the unknowns explain the data: the reduced chi-square is {self.reduced:.3g}, expected about "
            f"1; the {kind} '{name}' is off by {off:.3g} standard deviations (root mean square). Check its clock (at "
            "t = 0 the load of the study begins; an unknown 'of: time_shift' moves the data), "
            f"{columns}, the standard deviations, the bounds, and what the study leaves out"
        )


def at_bounds(misfit: Misfit, coordinates: Array, *, explained: bool) -> list[str]:
    """Return a sentence for each unknown that lies at a bound of the search, at coordinates (k,).

    Wider bounds are proposed where the data are ``explained``; a wrong unit drives an unknown to a bound too.
    """
    lower, upper = misfit.bounds
    advice = "" if explained else "check the units and signs of the data first; where they are right, "
    return [
        f"the fitted {one.name} lies at the bound of the search, {one.text(one.value(float(bound)))}; {advice}widen "
        "the bounds"
        for one, x, low, high in zip(misfit.unknowns, coordinates, lower, upper, strict=True)
        for bound in (low, high)
        if abs(x - bound) < CLOSE * (high - low)
    ]


#: A fitted value so many times the start value, or so small a part of it, is hardly that of the same material.
DISTANT = 100.0


def far_from_start(misfit: Misfit, coordinates: Array) -> list[str]:
    """Return a sentence for each unknown on a log scale that lies far from its start value, at coordinates (k,)."""
    found = []
    for one, x in zip(misfit.unknowns, coordinates, strict=True):
        ratio = one.value(float(x)) / one.start if one.scale == "log" else 1.0
        if not 1 / DISTANT < ratio < DISTANT:
            found.append(
                f"the fitted {one.name}, {one.text(one.value(float(x)))}, is {ratio:.2g} times its start value, "
                f"{one.text(one.start)}; check the units of the data and of the study"
            )
    return found


#: Tolerance of the searches beside the first, until one is better by more than this share of a variance.
ROUGH, ALIKE = 1e-4, 1e-2
#: A search ends where so many steps together lower the sum of squares by less than this: along a direction that is
#: not identifiable it would creep on to a bound, to no effect on any statement.
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
    end
        Where it ended; None: the start could not be computed.
    converged
        Whether it ended by its tolerance or for lack of gain, and not by the number of evaluations.
    evaluations
        Evaluations of the misfit.
    failure
        Why there is no end.
    """

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
        return Search(None, False, 1, str(error))
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
        return Search(steps.last, True, evaluations)
    return Search(misfit.at(np.asarray(found.x, dtype=float)), found.status > 0, evaluations)
