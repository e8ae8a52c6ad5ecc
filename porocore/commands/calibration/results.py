"""Results of a calibration (Calibration), and their files: calibration.json, curves.csv, samples.csv, report."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from porocore.commands.calibration.derived import METHOD, DerivedCell
from porocore.commands.calibration.entries import (
    direction_entries,
    precision_entries,
    product_entries,
    suggestion_entries,
    systematic_entry,
    unknown_entries,
)
from porocore.commands.calibration.fit import EvaluationRecord, FitQuality
from porocore.commands.calibration.infer import Inference
from porocore.commands.calibration.plan import CalibrationFolder, CalibrationPlan
from porocore.commands.calibration.posterior import Posterior
from porocore.commands.calibration.problem import Misfit
from porocore.core.console import duration
from porocore.core.files.plain_data import json_ready, write_csv, write_json
from porocore.states import Array
from porocore.study.run.folder import versions


@dataclass(frozen=True, eq=False)
class Calibration:
    """Results of a calibration.

    Attributes
    ----------
    path
        Folder of its files: ``calibration.json``, ``report.html``, ``curves.csv``, ``samples.csv``.
    plan
        Experiments with their curves, and unknowns.
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
    seconds
        Wall time of this call.
    warnings
        Sentences on what is to be doubted.
    """

    path: Path
    plan: CalibrationPlan
    inference: Inference
    quality: FitQuality
    posterior: Posterior | None
    derived: tuple[DerivedCell, ...]
    cell_solves: int
    seconds: float
    warnings: tuple[str, ...]

    @property
    def values(self) -> dict[str, float]:
        """Fitted values by the names of the unknowns, in their units."""
        return {
            one.name: float(value)
            for one, value in zip(self.inference.unknowns, self.inference.values, strict=True)
        }

    @property
    def intervals(self) -> dict[str, tuple[float | None, float | None]]:
        """95 % intervals by name, priors counted; None where the data set no end."""
        pairs = zip(self.inference.unknowns, self.inference.intervals, strict=True)
        return {one.name: found.values for one, found in pairs}

    @property
    def identifiable(self) -> dict[str, bool]:
        """Identifiability of each unknown by name, by the data without priors."""
        pairs = zip(self.inference.unknowns, self.inference.identifiable, strict=True)
        return {one.name: found for one, found in pairs}


def write_results(
    folder: CalibrationFolder,
    done: Calibration,
    misfit: Misfit,
    record: EvaluationRecord,
    truth: Array | None,
) -> None:
    """Write results, curves, evaluations and the report; ``truth`` are the values of made-up data.

    Raises
    ------
    RunFolderError
        A file cannot be written.
    """
    write_csv(folder.curves, CURVES, _curve_rows(done))
    names = [f"{one.name} [{one.unit or '-'}]" for one in misfit.unknowns]
    write_csv(folder.samples, [*names, "chi_square", "flagged"], _sample_rows(misfit, record))
    if done.posterior is not None:
        write_csv(folder.posterior, names, _thinned(done.posterior).tolist())
    _write_report(folder, done, misfit, len(record), truth)
    # Last, so that a folder with results has all of them.
    write_json(folder.results, json_ready(results_of(done)), indent=2, ensure_ascii=False)


#: Rows of ``posterior.csv`` at most.
MOST_DRAWS = 2000
#: Columns of ``curves.csv``.
CURVES = ("curve", "time", "time unit", "measured", "deviation", "fitted", "unit")


def results_of(done: Calibration) -> dict[str, Any]:
    """Return what ``calibration.json`` holds."""
    entries = {
        "unknowns": unknown_entries(done.inference),
        "fields": {
            each.name: {
                "along": each.along,
                "at": list(each.places),
                "unit": each.unit,
                "unknowns": [done.inference.unknowns[i].name for i in each.members],
            }
            for each in done.plan.fields
        },
        "derived": {"method": METHOD, "cells": [each.entries() for each in done.derived]},
        "directions": direction_entries(done.inference),
        "products": product_entries(done.inference),
        "misfit": done.quality.chi_square,
        "reduced_misfit": done.quality.reduced,
        "deviations_off": done.quality.deviations_off,
        "error_of_steps": systematic_entry(done.inference),
        "precision": precision_entries(done.inference),
        "suggestions": suggestion_entries(done.inference),
        "warnings": list(done.warnings),
        "cell_solves": done.cell_solves,
        "seconds": round(done.seconds, 2),
    }
    return entries if done.posterior is None else entries | {"posterior": done.posterior.entries()}


def _thinned(posterior: Posterior) -> Array:
    """Return some of the draws (n, k), picked at random, the same ones each time."""
    values = posterior.values
    count = min(len(values), MOST_DRAWS)
    return np.asarray(values[np.random.default_rng(0).choice(len(values), count, replace=False)])


def _curve_rows(done: Calibration) -> Iterator[list[Any]]:
    fitted, first = done.inference.best.prediction.values, 0
    for curve in done.plan.curves:
        assert curve.measured is not None
        columns = (
            curve.displayed_times,
            curve.measured,
            curve.deviations,
            fitted[first : first + len(curve)],
        )
        first += len(curve)
        for t, measured, deviation, value in np.stack(columns, axis=1).tolist():
            yield [curve.name, t, curve.time_unit or "-", measured, deviation, value, curve.unit or "-"]


def _sample_rows(misfit: Misfit, record: EvaluationRecord) -> Iterator[list[Any]]:
    data = misfit.data
    for values, found in record:
        if found is None:
            yield [*values.tolist(), "", ""]
        else:
            residuals = (found.values - data.values) / data.deviations
            yield [*values.tolist(), float(residuals @ residuals), int(found.flagged)]


def _error_text(inference: Inference) -> str:
    """Return how far the error of the steps moves the unknowns, in words."""
    error = inference.systematic
    if error is None:
        return "not known"
    return f"moves the unknowns by {error.size:.2g} standard deviations" + (
        ", which the intervals hold" if error.counted else ""
    )


def _write_report(
    folder: CalibrationFolder, done: Calibration, misfit: Misfit, evaluations: int, truth: Array | None
) -> None:
    from porocore.commands.calibration.contents import CalibrationContents, CurveAxes
    from porocore.commands.calibration.page import write_report  # matplotlib is slow to import

    quality = done.quality
    facts = (
        ("Values of all curves", str(len(misfit.data.values))),
        ("Reduced chi-square", f"{quality.reduced:.3g}"),
        ("Error of the steps in time", _error_text(done.inference)),
        ("Cell solves", str(done.cell_solves)),
        ("Runs of the experiments", str(evaluations)),
        ("Time of the last call", duration(done.seconds)),
    )
    axes = tuple(CurveAxes("", curve.unit, curve.time_unit) for curve in done.plan.curves)
    contents = CalibrationContents(
        done.plan.heading,
        misfit.data,
        done.inference,
        axes,
        truth,
        facts,
        done.warnings,
        fields=done.plan.fields,
        posterior=done.posterior,
        derived=done.derived,
        plan=done.plan,
        versions=versions(),
    )
    write_report(folder.path, contents)
