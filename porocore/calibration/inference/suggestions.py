"""Further data (FurtherData): parts of the curves and other tests, ranked by what they make seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from porocore.calibration.inference.directions import unseen_count
from porocore.calibration.problem import CurveModel, Fitted, Misfit
from porocore.states import Array

#: Share of the largest singular value below which two of them are not told apart.
RESOLUTION = 1e-6
#: A gain of the least singular value below this is none.
LEAST_GAIN = 1.05


@dataclass(frozen=True, eq=False)
class FurtherData:
    """Measurement that could be made.

    Attributes
    ----------
    name
        In words.
    rows : (n, k)
        Derivatives of its values, over their standard deviations, by the coordinates at the best point.
    """

    name: str
    rows: Array


@dataclass(frozen=True, eq=False)
class Suggestion:
    """Gain of further data.

    Attributes
    ----------
    name
        Of the data.
    singular_values : (k,)
        Of the data with the further ones, largest first; the coordinates are measured in their limits.
    before : (k,)
        The same without them.
    unseen, unseen_before
        Numbers of directions that are not seen with and without them.
    """

    name: str
    singular_values: Array
    before: Array
    unseen: int
    unseen_before: int

    @property
    def least(self) -> float:
        """Smallest singular value with the further data."""
        return float(self.singular_values[-1])

    @property
    def gain(self) -> float:
        """Factor by which the smallest singular value grows; infinite where it was zero to round-off."""
        floor = RESOLUTION * float(self.singular_values[0])
        if self.before[-1] < floor:
            return float("inf") if self.least > floor else 1.0
        return self.least / float(self.before[-1])

    @property
    def helps(self) -> bool:
        """True where the gain is worth a word, or fewer directions stay unseen."""
        return self.gain > LEAST_GAIN or self.separates

    @property
    def separates(self) -> bool:
        """True where fewer directions stay unseen."""
        return self.unseen < self.unseen_before


def ranked(jacobian: Array, limits: Array, further: Sequence[FurtherData]) -> tuple[Suggestion, ...]:
    """Return the gains of further data, the best first.

    They are ordered by the smallest singular value; where several directions are not seen and it stays zero, by the
    next larger one.

    Parameters
    ----------
    jacobian : (m, k)
        Derivatives of the measured values, over their standard deviations, by the coordinates; without priors.
    limits : (k,)
        Of the coordinates, by the rule of identifiability.
    further
        Data to be ranked.
    """
    before, unseen = _singular_values(jacobian * limits), unseen_count(jacobian, limits)
    found = []
    for each in further:
        rows = np.vstack([jacobian, each.rows])
        values = _singular_values(rows * limits)
        found.append(Suggestion(each.name, values, before, unseen_count(rows, limits), unseen))
    largest = max((float(each.singular_values[0]) for each in found), default=1.0)

    def key(suggestion: Suggestion) -> list[float]:
        values = np.maximum(suggestion.singular_values[::-1], RESOLUTION * largest)
        return [-round(float(value), 3) for value in np.log(values)]

    return tuple(sorted(found, key=key))


def _singular_values(rows: Array) -> Array:
    """Return k singular values, also of fewer rows than columns."""
    k = rows.shape[1]
    padded = np.vstack([rows, np.zeros((max(k - len(rows), 0), k))])
    return np.asarray(np.linalg.svd(padded, compute_uv=False))


def repeated_parts(misfit: Misfit, best: Fitted, parts: int = 4, times: int = 10) -> Iterator[FurtherData]:
    """Yield parts of each measured curve, as many values each, measured so many times as densely."""
    data = misfit.data
    for c, name in enumerate(data.names):
        rows = np.flatnonzero(data.curve == c)
        rows = rows[np.argsort(data.times[rows], kind="stable")]
        for part in np.array_split(rows, min(parts, len(rows))):
            first, last = data.times[part[0]], data.times[part[-1]]
            more = np.sqrt(times - 1) * best.jacobian[part]
            unit = f" {data.time_units[c]}".rstrip() if data.time_units else ""
            words = f"{times} times as many values of {name} from {first:.3g} to {last:.3g}{unit}"
            yield FurtherData(words, more)


def experiment(name: str, model: CurveModel, coordinates: Array, deviations: Array) -> FurtherData:
    """Return the data of a further experiment that has the same unknowns.

    Parameters
    ----------
    name
        In words.
    model
        Predicts its curves.
    coordinates : (k,)
        Best point.
    deviations : (n,)
        Expected standard deviations of its values.

    Raises
    ------
    SolveError
        The experiment cannot be computed there.
    """
    pairs = list(zip(model.unknowns, coordinates, strict=True))
    slopes = model.curves(np.array([one.value(float(x)) for one, x in pairs])).slopes
    scale = np.array([one.value_slope(float(x)) for one, x in pairs])
    return FurtherData(name, slopes * scale / deviations[:, None])
