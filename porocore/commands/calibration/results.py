"""Results of a calibration (Calibration), and the entries of its files."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from porocore.commands.calibration.clouds import CAMERA_PARTS, FilmComponent, PointCloud
from porocore.commands.calibration.derived import METHOD, DerivedCell
from porocore.commands.calibration.fit import FitQuality, RecordedModel
from porocore.commands.calibration.infer import Inference
from porocore.commands.calibration.observations import by_curve
from porocore.commands.calibration.plan import CalibrationPlan, FittedField, occurrences
from porocore.commands.calibration.posterior import Posterior
from porocore.commands.calibration.problem import CurveData, values_at
from porocore.core.files.plain_data import write_csv
from porocore.core.units import ResultUnits, pretty
from porocore.states import Array


@dataclass(frozen=True, eq=False)
class CameraPlace:
    """Place of a camera in the body: x = offset + R x', u = R u'.

    Attributes
    ----------
    offset : (3,)
        Origin of its axes, in ``unit``.
    unit
        Of lengths; empty: none.
    rotation : (3,)
        Rotation vector of R in degrees.
    """

    offset: Array
    unit: str
    rotation: Array

    def entries(self) -> dict[str, Any]:
        """Return what ``calibration.json`` holds."""
        return {"offset": self.offset.tolist(), "unit": self.unit, "rotation": self.rotation.tolist()}


@dataclass(frozen=True, eq=False)
class Calibration:
    """Results of a calibration.

    Attributes
    ----------
    path
        Folder of its files: ``calibration.json``, ``report.html``, ``curves.csv``, ``samples.csv``; ``points.csv`` of
        films.
    plan
        Experiments with their curves, and unknowns.
    data
        All measured values, one after the other.
    inference
        Values, intervals and directions.
    quality
        How well the data are explained.
    posterior
        Draws from the posterior distribution; None: not asked for.
    derived
        Aggregate modulus, permeability and other physical numbers of each fitted undeformed cell, with intervals.
    cell_solves
        Cells that the families were learned from, held-out ones included.
    runs
        Runs of the experiments.
    seconds
        Wall time of this call.
    warnings
        Sentences on what is to be doubted.
    truth : (k,)
        Values of the unknowns with which the data were made up; None: they were measured.
    """

    path: Path
    plan: CalibrationPlan
    data: CurveData
    inference: Inference
    quality: FitQuality
    posterior: Posterior | None = None
    derived: tuple[DerivedCell, ...] = ()
    cell_solves: int = 0
    runs: int = 0
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()
    truth: Array | None = None

    @property
    def values(self) -> dict[str, float]:
        """Fitted values by the names of the unknowns, in their units."""
        return self.inference.by_name(self.inference.values.tolist())

    @property
    def has_films(self) -> bool:
        """True with measured fields, whose values are in ``points.csv``."""
        return any(isinstance(curve.series, FilmComponent) for curve in self.plan.curves)

    @property
    def cameras(self) -> dict[str, CameraPlace]:
        """Fitted places of cameras of which parts are unknown, by the names of the films."""
        parts, clouds, lengths = dict[str, Array](), dict[str, PointCloud](), dict[str, ResultUnits]()
        for experiment in self.plan.experiments:
            for curve in experiment.curves:
                if isinstance(curve.series, FilmComponent):
                    clouds[curve.series.cloud.name] = curve.series.cloud
            for each in occurrences(self.plan.unknowns, experiment):
                if each.number.kind == "camera":
                    name, part = map(str, each.number.path)
                    at = parts.setdefault(name, np.zeros(len(CAMERA_PARTS)))
                    at[CAMERA_PARTS.index(part)] += each.value(self.inference.values)
                    lengths[name] = experiment.config.result_units
        found = {}
        for name, at in parts.items():
            offset, turn = clouds[name].camera_place(at)
            units = lengths[name]
            found[name] = CameraPlace(
                offset * units.factor("displacement"), units.name("displacement") if units.given else "", turn
            )
        return found

    @property
    def intervals(self) -> dict[str, tuple[float | None, float | None]]:
        """95 % intervals by name, priors counted; None where the data set no end."""
        return self.inference.by_name(found.values for found in self.inference.intervals)

    @property
    def identifiable(self) -> dict[str, bool]:
        """Identifiability of each unknown by name, by the data without priors."""
        return self.inference.by_name(self.inference.identifiable)


#: Rows of ``posterior.csv`` at most.
MOST_DRAWS = 2000


def write_tables(done: Calibration, model: RecordedModel) -> None:
    """Write ``curves.csv``, ``samples.csv`` with all evaluations, and ``points.csv``, ``posterior.csv`` if due.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    """
    columns = ("curve", "time", "time unit", "measured", "deviation", "fitted", "unit")
    write_csv(done.path / "curves.csv", columns, _curve_rows(done))
    if done.has_films:
        write_csv(done.path / "points.csv", POINT_COLUMNS, _point_rows(done))
    names = [f"{one.name} [{one.unit or '-'}]" for one in done.inference.unknowns]
    samples = _sample_rows(done.data, model)
    write_csv(done.path / "samples.csv", [*names, "chi_square", "flagged"], samples)
    if done.posterior is not None:
        write_csv(done.path / "posterior.csv", names, _thinned(done.posterior).tolist())


def _thinned(posterior: Posterior) -> Array:
    """Return some of the draws (n, k), picked at random, the same ones each time."""
    values = posterior.values
    count = min(len(values), MOST_DRAWS)
    return np.asarray(values[np.random.default_rng(0).choice(len(values), count, replace=False)])


def _curve_rows(done: Calibration) -> Iterator[list[Any]]:
    curves = done.plan.curves
    for curve, fitted in zip(curves, by_curve(done.inference.best.prediction.values, curves), strict=True):
        assert curve.measured is not None
        if isinstance(curve.series, FilmComponent):
            continue
        columns = curve.displayed_times, curve.measured, curve.deviations, fitted
        for t, measured, deviation, value in np.stack(columns, axis=1).tolist():
            yield [curve.name, t, curve.time_unit or "-", measured, deviation, value, curve.unit or "-"]


#: Columns of ``points.csv``.
POINT_COLUMNS = (
    *(
        "field",
        "x",
        "y",
        "z",
        "unit of places",
        "time",
        "time unit",
        "measured",
        "deviation",
        "fitted",
        "unit",
    ),
)


def _point_rows(done: Calibration) -> Iterator[list[Any]]:
    """Yield the values of measured fields with their places in the axes of the body, as far as these are known."""
    fitted = iter(by_curve(done.inference.best.prediction.values, done.plan.curves))
    for experiment in done.plan.experiments:
        units = experiment.config.result_units
        length = units.name("displacement") if units.given else "-"
        for curve, values in zip(experiment.curves, fitted, strict=False):
            if not isinstance(curve.series, FilmComponent):
                continue
            assert curve.measured is not None
            places = curve.series.places * units.factor("displacement")
            columns = (curve.displayed_times, curve.measured, curve.deviations, values)
            time, unit = pretty(curve.time_unit) or "-", pretty(curve.unit) or "-"
            rows = np.column_stack([places, *columns]).tolist()
            for x, y, z, t, measured, deviation, value in rows:
                yield [curve.name, x, y, z, length, t, time, measured, deviation, value, unit]


def _sample_rows(data: CurveData, model: RecordedModel) -> Iterator[list[Any]]:
    for values, found in model:
        if found is None:
            yield [*values.tolist(), "", ""]
        else:
            residuals = (found.values - data.values) / data.deviations
            yield [*values.tolist(), float(residuals @ residuals), int(found.flagged)]


def results_of(done: Calibration) -> dict[str, Any]:
    """Return what ``calibration.json`` holds; numbers that are not finite become None there."""
    entries = {
        "unknowns": unknown_entries(done.inference),
        "fields": {
            each.name: {
                **_places_entry(each),
                "unit": each.unit,
                "unknowns": [done.inference.unknowns[i].name for i in each.members],
            }
            for each in done.plan.fields
        },
        "cameras": {name: each.entries() for name, each in done.cameras.items()},
        "derived": {"method": METHOD, "cells": [each.entries() for each in done.derived]},
        "directions": direction_entries(done.inference),
        "products": {
            each.name: {"value": each.value, "unit": each.unit, "interval95": each.interval}
            for each in done.inference.products
        },
        "misfit": done.quality.chi_square,
        "reduced_misfit": done.quality.reduced,
        "deviations_off": done.quality.deviations_off,
        "error_of_steps": systematic_entry(done.inference),
        "precision": precision_entries(done.inference),
        "suggestions": suggestion_entries(done.inference),
        "warnings": done.warnings,
        "cell_solves": done.cell_solves,
        "seconds": round(done.seconds, 2),
    }
    return entries if done.posterior is None else entries | {"posterior": done.posterior.entries()}


def _places_entry(field: FittedField) -> dict[str, Any]:
    """Return axis and coordinates of a profile, or the coordinates of a grid by its axes."""
    if len(field.lines) > 1:
        return {"grid": dict(field.lines)}
    ((axis, places),) = field.lines.items()
    return {"along": axis, "at": places}


def unknown_entries(inference: Inference) -> dict[str, dict[str, Any]]:
    """Return value, unit, intervals and identifiability of each unknown, by its name.

    ``interval95`` counts the priors, ``interval95_without_prior`` does not; an end that the data do not set is None,
    and ``open_ends`` has the reason. ``deviation`` is that of ln x where the scale is ``log``, to first order. It is
    ``identifiable`` if the ends without priors lie within ``resolution`` of the value.
    """
    return {
        one.name: {
            "value": float(inference.values[i]),
            "unit": one.unit,
            "scale": one.scale,
            "interval95": inference.intervals[i].values,
            "interval95_without_prior": inference.data_intervals[i].values,
            "open_ends": inference.data_intervals[i].open_ends,
            "deviation": inference.with_priors.deviations[i],
            "deviation_without_prior": inference.without_priors.deviations[i],
            "identifiable": inference.identifiable[i],
            "resolution": inference.rule.distance(one, float(inference.values[i])),
        }
        for i, one in enumerate(inference.unknowns)
    }


def direction_entries(inference: Inference) -> list[dict[str, Any]]:
    """Return the non-identifiable directions in words and numbers, by the names of the unknowns.

    ``direction`` is a unit vector over the coordinates, which are ln x where the scale is ``log``; ``deviation`` is the
    standard deviation along it, infinite where the data do not depend on it. ``step`` changes no measured value by more
    than ``largest_change`` of its standard deviations. The model does not depend on one that is ``exact``.
    """
    return [
        {
            "words": words,
            "direction": inference.by_name(each.direction.tolist()),
            "deviation": each.deviation,
            "step": inference.by_name(each.step.tolist()),
            "largest_change": each.change,
            "exact": each.exact,
        }
        for words, each in zip(inference.words, inference.directions, strict=True)
    ]


def precision_entries(inference: Inference) -> dict[str, Any]:
    """Return singular values without priors, and correlations without and with them; NaN where they mean nothing."""

    def correlations(found: Array) -> dict[str, dict[str, float]]:
        return inference.by_name(inference.by_name(row) for row in found.tolist())

    alone = inference.correlations
    with_priors = (
        inference.with_priors.correlations if any(u.has_prior for u in inference.unknowns) else alone
    )
    return {
        "singular_values": inference.without_priors.singular_values,
        "correlations": correlations(with_priors),
        "correlations_without_priors": correlations(alone),
    }


def systematic_entry(inference: Inference) -> dict[str, Any] | None:
    """Return the known error of the curves and how it moves the best values, by the names; None: none is known.

    ``largest_error`` is that of a value in its standard deviations; ``shift`` is what exact curves would add to the
    values, ``shift_in_deviations`` the same to first order in standard deviations of each unknown. The intervals hold
    the values of exact curves where it is ``counted``.
    """
    found = inference.systematic
    if found is None:
        return None
    moved = values_at(inference.unknowns, inference.best.coordinates + found.shift)
    return {
        "largest_error": np.abs(found.errors).max(),
        "shift": inference.by_name((moved - inference.values).tolist()),
        "shift_in_deviations": inference.by_name(found.deviations.tolist()),
        "largest_shift_in_deviations": found.size,
        "counted": found.counted,
    }


def suggestion_entries(inference: Inference) -> list[dict[str, Any]]:
    """Return further data that help, the best first; a gain of the smallest singular value may be infinite.

    ``unseen`` directions are then still non-identifiable.
    """
    return [
        {"data": each.name, "gain": each.gain, "least": each.least, "unseen": each.non_identifiable}
        for each in inference.suggestions
        if each.helps
    ]
