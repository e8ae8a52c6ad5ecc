"""The inverse problem: unknowns and priors, curves that a model predicts, data, misfit with its exact slopes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import exp, log
from typing import Literal

import numpy as np

from porocore.states import Array, IntArray

Scale = Literal["linear", "log"]
#: A curve that the whole range of an unknown changes by fewer of its standard deviations does not depend on it.
UNMOVED = 1e-6
#: Values of all curves above which single evaluations are not kept whole in memory, nor as text in files.
MANY_VALUES = 5_000


@dataclass(frozen=True)
class NormalPrior:
    """Normal distribution of an unknown's coordinate before any data: of ln x where its scale is ``log``, else of x."""

    mean: float
    deviation: float


@dataclass(frozen=True)
class Unknown:
    """A number that is fitted, with its bounds.

    Attributes
    ----------
    name
        Name in the configuration and in all results.
    start, lower, upper
        First value, and the bounds of the search, which are no statement about the value.
    scale
        ``log``: the search and the intervals are in ln x; the number is positive.
    prior
        Knowledge from elsewhere; None: the data alone decide.
    unit
        Unit of the numbers here, empty for a dimensionless one.
    smoothing
        Standard deviation, before any data, of the difference of its coordinate from those of its neighbours; None: it
        has nothing to do with them.
    neighbours
        How many unknowns before it each of these stands.
    """

    name: str
    start: float
    lower: float
    upper: float
    scale: Scale = "linear"
    prior: NormalPrior | None = None
    unit: str = ""
    smoothing: float | None = None
    neighbours: tuple[int, ...] = (1,)

    @property
    def has_prior(self) -> bool:
        """True where it has a prior: one of its own, or one of its difference."""
        return self.prior is not None or self.smoothing is not None

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value: ln x, or x itself."""
        return log(value) if self.scale == "log" else value

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate."""
        return exp(coordinate) if self.scale == "log" else coordinate

    def value_slope(self, coordinate: float) -> float:
        """Return the derivative of the value by the coordinate."""
        return exp(coordinate) if self.scale == "log" else 1.0

    def text(self, value: float) -> str:
        """Return a value with its unit."""
        return f"{value:.4g} {self.unit}".rstrip()


def values_at(unknowns: Sequence[Unknown], coordinates: Iterable[float]) -> Array:
    """Return the values (k,) of unknowns at coordinates (k,)."""
    return np.array([one.value(float(x)) for one, x in zip(unknowns, coordinates, strict=True)])


def slopes_at(unknowns: Sequence[Unknown], coordinates: Iterable[float]) -> Array:
    """Return the derivatives (k,) of the values of unknowns by their coordinates, at coordinates (k,)."""
    return np.array([one.value_slope(float(x)) for one, x in zip(unknowns, coordinates, strict=True)])


def first_coordinates(unknowns: Sequence[Unknown]) -> Array:
    """Return the coordinates (k,) of the first values, at which every search begins."""
    return np.array([one.coordinate(one.start) for one in unknowns])


@dataclass(frozen=True, eq=False)
class CurvePrediction:
    """Predicted curves at the places of the data.

    Attributes
    ----------
    values : (m,)
        All curves, one after the other, as the data have them.
    slopes : (m, k)
        Exact derivatives by the values of the k unknowns.
    flagged
        Whether the surrogate left the states that it is trusted in.
    """

    values: Array
    slopes: Array
    flagged: bool = False


class CurveModel(ABC):
    """Model of experiments: values of the unknowns in, curves out."""

    #: The k unknowns, in the order of every array.
    unknowns: tuple[Unknown, ...]

    @abstractmethod
    def curves(self, values: Array) -> CurvePrediction:
        """Return the curves for values (k,) of the unknowns.

        Raises
        ------
        SolveError
            The experiment cannot be computed there.
        """


@dataclass(frozen=True, eq=False)
class CurveData:
    """Measured values of all curves, one after the other.

    Attributes
    ----------
    values, deviations : (m,)
        Measured values and their standard deviations, in the model's numbers.
    curve : (m,)
        Which of ``names`` each belongs to.
    times : (m,)
        Time of each.
    names
        Names of the curves.
    units, time_units
        Units of the values and of the times of each curve, for words; empty: they have none.
    films
        Names of those curves that are measured fields, for words.
    """

    values: Array
    deviations: Array
    curve: IntArray
    times: Array
    names: tuple[str, ...]
    units: tuple[str, ...] = ()
    time_units: tuple[str, ...] = ()
    films: frozenset[str] = frozenset()

    def rows(self, curve: int) -> IntArray:
        """Return the rows of a curve in the order of time."""
        rows = np.flatnonzero(self.curve == curve)
        return np.asarray(rows[np.argsort(self.times[rows], kind="stable")])


@dataclass(frozen=True, eq=False)
class Fitted:
    """Residuals of one evaluation.

    Attributes
    ----------
    coordinates : (k,)
        Where it was made.
    prediction
        The curves.
    residuals : (m + priors,)
        (predicted − measured)/deviation, then (coordinate − mean)/deviation of each prior, then (coordinate −
        coordinate of a neighbour)/deviation of each that is smoothed.
    jacobian : (m + priors, k)
        Their derivatives by the coordinates.
    priors
        Number of rows that priors have, the last ones.
    """

    coordinates: Array
    prediction: CurvePrediction
    residuals: Array
    jacobian: Array
    priors: int = 0

    @property
    def of_data(self) -> Fitted:
        """The same without priors."""
        rows = len(self.residuals) - self.priors
        return replace(self, residuals=self.residuals[:rows], jacobian=self.jacobian[:rows], priors=0)

    @property
    def reduced(self) -> Fitted:
        """The same with at most k + 1 rows of data, turned in the space of the data, and without its curves.

        Sums of squares, gradients and linear steps are those of the rows themselves: [J r] = Q R has them in R.
        """
        data = self.of_data
        both = np.column_stack([data.jacobian, data.residuals])
        if len(both) <= both.shape[1]:
            return self
        factor = np.linalg.qr(both, mode="r")
        rows = np.concatenate([factor, np.column_stack([self.jacobian, self.residuals])[len(both) :]])
        nothing = CurvePrediction(np.zeros(0), np.zeros((0, rows.shape[1] - 1)), self.prediction.flagged)
        return replace(self, prediction=nothing, residuals=rows[:, -1], jacobian=rows[:, :-1])

    @property
    def cost(self) -> float:
        """Half the sum of the squares, the negative logarithm of the posterior density up to a constant."""
        return 0.5 * float(self.residuals @ self.residuals)


class Misfit:
    """Weighted residuals of a model against data, as functions of the coordinates of the unknowns.

    Parameters
    ----------
    model
        Predicts the curves.
    data
        As many values as the model predicts.
    """

    def __init__(self, model: CurveModel, data: CurveData) -> None:
        self.model, self.data = model, data
        self._last: Fitted | None = None

    @property
    def unknowns(self) -> Sequence[Unknown]:
        """The model's unknowns."""
        return self.model.unknowns

    @property
    def start(self) -> Array:
        """Coordinates of the first values, (k,)."""
        return first_coordinates(self.unknowns)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Coordinates of lower and upper bounds, each (k,)."""
        lower = np.array([one.coordinate(one.lower) for one in self.unknowns])
        return lower, np.array([one.coordinate(one.upper) for one in self.unknowns])

    def values(self, coordinates: Array) -> Array:
        """Return the values (k,) of the unknowns at coordinates (k,)."""
        return values_at(self.unknowns, coordinates)

    def at(self, coordinates: Array) -> Fitted:
        """Return residuals and Jacobian at coordinates (k,); the last evaluation is kept.

        Raises
        ------
        SolveError
            The experiment cannot be computed there.
        """
        if self._last is None or not np.array_equal(self._last.coordinates, coordinates):
            self._last = self._evaluated(np.array(coordinates, dtype=float))
        return self._last

    def unmoved(self, fitted: Fitted) -> list[str]:
        """Return the names of the curves that no unknown changes, to first order, by more than round-off."""
        lower, upper = self.bounds
        moves = np.abs(fitted.jacobian[: len(self.data.values)] * (upper - lower)).max(axis=1)
        largest = [moves[self.data.curve == c].max(initial=0.0) for c in range(len(self.data.names))]
        return [name for name, move in zip(self.data.names, largest, strict=True) if move < UNMOVED]

    def _evaluated(self, x: Array) -> Fitted:
        prediction = self.model.curves(self.values(x))
        residuals = (prediction.values - self.data.values) / self.data.deviations
        jacobian = prediction.slopes * slopes_at(self.unknowns, x) / self.data.deviations[:, None]
        offsets, rows = self._priors
        return Fitted(
            x,
            prediction,
            np.concatenate([residuals, rows @ x - offsets]),
            np.concatenate([jacobian, rows]),
            len(rows),
        )

    @cached_property
    def _priors(self) -> tuple[Array, Array]:
        """Offsets (priors,) and rows (priors, k) of the residuals of all priors, linear in the coordinates."""
        unit = np.eye(len(self.unknowns))
        known = [(unit[i], one.prior) for i, one in enumerate(self.unknowns) if one.prior is not None]
        offsets = [prior.mean / prior.deviation for _, prior in known]
        rows = [row / prior.deviation for row, prior in known]
        for i, one in enumerate(self.unknowns):
            for before in one.neighbours if one.smoothing is not None else ():
                rows.append((unit[i] - unit[i - before]) / one.smoothing)
                offsets.append(0.0)
        return np.array(offsets), np.reshape(rows, (-1, len(unit)))
