"""Measured curve (ObservedCurve): times, values, standard deviations and units; its data as a fit takes them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from porocore.calibration.observations.series import MeasuredSeries
from porocore.calibration.problem import CurveData
from porocore.core.units.quantities import pretty
from porocore.errors import ConfigurationError
from porocore.states import Array


@dataclass(frozen=True)
class DataFile:
    """File of a measured curve, as a report names it.

    Attributes
    ----------
    name
        As the configuration names it.
    rows
        Rows of data in it.
    size
        In bytes.
    sha256
        Hash of its bytes.
    """

    name: str
    rows: int
    size: int
    sha256: str

    @classmethod
    def of(cls, path: Path, name: str, rows: int) -> DataFile:
        """Return the record of a file that was read."""
        content = path.read_bytes()
        return cls(name, rows, len(content), hashlib.sha256(content).hexdigest())


@dataclass(frozen=True, eq=False)
class ObservedCurve:
    """A curve that was measured in one experiment, or will be.

    Attributes
    ----------
    name
        Name of the experiment and of the observation, such as ``confined: settlement``.
    series
        What was measured.
    times : (m,)
        Ascending, in the dimensionless times of the study.
    unit, time_unit
        Of the numbers in files; empty for dimensionless ones.
    factor, time_factor
        A dimensionless result, or time, of the study times it is in these units.
    weights : (m,)
        How often each value counts.
    measured : (m,)
        Values in ``unit``; None: there are none yet.
    spread
        Standard deviation of every value, or of each (m,), in ``unit``; None: it is ``share`` of the largest value.
    share
        Share of the largest value in size.
    notes
        What was done to the rows of the file, in words.
    file
        Where it was read; None: it is made up.
    """

    name: str
    series: MeasuredSeries
    times: Array
    unit: str
    time_unit: str
    factor: float
    time_factor: float
    weights: Array
    measured: Array | None = None
    spread: float | Array | None = None
    share: float | None = None
    notes: tuple[str, ...] = ()
    file: DataFile | None = None

    def __len__(self) -> int:
        return len(self.times)

    @property
    def deviations(self) -> Array:
        """Standard deviations (m,) in :attr:`unit`, weights included.

        Raises
        ------
        ConfigurationError
            They are a share of values that are all zero.
        """
        plain = self.spread
        if plain is None:
            assert self.measured is not None
            assert self.share is not None
            plain = self.share * float(np.abs(self.measured).max())
            if plain == 0:
                raise ConfigurationError(
                    f"{self.name}: a share of the largest value is no standard deviation, since all values are 0; "
                    "give 'deviation:'"
                )
        return np.asarray(plain / np.sqrt(self.weights))

    @property
    def displayed_times(self) -> Array:
        """Times (m,) in :attr:`time_unit`."""
        return np.asarray(self.times * self.time_factor)

    @property
    def outline(self) -> str:
        """Number of values, first and last time, least and largest value, with units."""
        times = f"from {_span(self.displayed_times[0], self.displayed_times[-1], self.time_unit)}"
        if self.measured is None:
            return f"{len(self)} times {times}; no values yet"
        values = _span(self.measured.min(), self.measured.max(), self.unit)
        return f"{len(self)} values {times}; they are {values}"

    def made_up(self, exact: Array, seed: Sequence[int]) -> ObservedCurve:
        """Return the curve with exact values (m,) and normal noise of its standard deviation."""
        known = replace(self, measured=exact)
        noise = np.random.default_rng(seed).standard_normal(len(exact))
        return replace(
            known,
            measured=exact + noise * known.deviations,
            spread=known.deviations,
            weights=np.ones(len(exact)),
            file=None,
        )


def _span(first: float, last: float, unit: str) -> str:
    return f"{first:.5g} to {last:.5g} {pretty(unit)}".rstrip()


def curve_data(curves: Sequence[ObservedCurve]) -> CurveData:
    """Return all curves one after the other, times in the units of the curves."""
    values = [curve.measured for curve in curves if curve.measured is not None]
    assert len(values) == len(curves)
    return CurveData(
        np.concatenate(values),
        np.concatenate([curve.deviations for curve in curves]),
        np.repeat(np.arange(len(curves)), [len(curve) for curve in curves]).astype(np.int64),
        np.concatenate([curve.displayed_times for curve in curves]),
        tuple(curve.name for curve in curves),
        tuple(curve.time_unit for curve in curves),
    )
