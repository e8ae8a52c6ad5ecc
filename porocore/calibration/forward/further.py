"""Measurements that were not made: other quantities of each test, and the same test under a larger load."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from porocore.calibration.forward.experiment import ExperimentModel
from porocore.calibration.inference.suggestions import FurtherData
from porocore.calibration.observations.series import MeasuredSeries
from porocore.calibration.plan import CalibrationPlan, Experiment, PlannedUnknown
from porocore.calibration.problem import CurvePrediction
from porocore.core.parallel.calls import CallProcesses, Tell, results_of
from porocore.errors import SolveError
from porocore.states import Array

#: Factors of a larger load, tried in this order until the surrogate is trusted in the body.
LOADS = (10.0, 3.0, 1.5)
#: Size of a curve, a share of the largest one of its test, below which there is nothing to be measured.
NOTHING = 1e-6


def further_data(
    models: Sequence[ExperimentModel],
    plan: CalibrationPlan,
    values: Array,
    processes: CallProcesses | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> list[FurtherData]:
    """Return data of measurements that were not made, to be ranked beside those that were.

    Each test is computed once with all quantities, and once under a larger load if the surrogate is trusted there. The
    standard deviations are the same share of the largest value as those of the measured curves; where all of these are
    zero there is no such share, and nothing is proposed.

    Parameters
    ----------
    models
        Of all experiments.
    plan
        Has the measured curves.
    values : (k,)
        Best values.
    processes
        Compute the tests side by side; None: this process computes one after the other.
    tell
        Called with what is computed next.
    """
    measured = {experiment.name: experiment for experiment in plan.experiments}
    variants = [
        _Variants(model, plan.unknowns, values, share)
        for model in models
        if (share := _noise(measured[model.experiment.name])) is not None
    ]
    if processes is None or len(variants) < 2:
        found = [_further_of(tell, each) for each in variants]
    else:
        tell("other quantities and larger loads")
        what = "while it solved the experiment '{}' under a larger load"
        found = results_of(
            [
                processes.submit(what.format(each.model.experiment.name), further_elsewhere, each)
                for each in variants
            ]
        )
    return [data for one in found for data in one]


def further_elsewhere(tell: Tell, variants: _Variants) -> list[FurtherData]:
    """Return the further data of a test in this process."""
    return _further_of(lambda words: None, variants)


def _further_of(tell: Callable[[str], None], variants: _Variants) -> list[FurtherData]:
    model = variants.model
    of = f" in the test '{model.experiment.name}'" if model.experiment.name else ""
    tell(f"other quantities{of}")
    found = [FurtherData(f"{words}{of}", rows) for words, rows in variants.other_quantities()]
    if all(number.kind != "load" for _, number, _ in model.numbers):
        tell(f"larger load{of}")
        found += variants.larger_load()
    return found


def _noise(experiment: Experiment) -> float | None:
    """Return the standard deviation of the measured curves as a share of their largest values, that of the worst.

    Curves of zeros do not count; None: there are no others.
    """
    sizes = [(c, float(np.abs(c.measured).max())) for c in experiment.curves if c.measured is not None]
    return max((float(np.mean(c.deviations)) / size for c, size in sizes if size > 0), default=None)


def _other_quantities(model: ExperimentModel) -> Experiment:
    """Return the experiment with all quantities that were not measured, at the times of the first curve."""
    measured = {curve.series for curve in model.experiment.curves}
    first = model.experiment.curves[0]
    curves = [
        replace(first, name=words, series=series, factor=1.0)
        for series, words in _quantities(model)
        if series not in measured
    ]
    return replace(model.experiment, curves=tuple(curves))


def _quantities(model: ExperimentModel) -> Iterator[tuple[MeasuredSeries, str]]:
    yield MeasuredSeries("settlement"), "the settlement"
    yield MeasuredSeries("pressure"), "the largest pore pressure"
    yield MeasuredSeries("drained"), "the drained volume"
    for probe in model.config.macro.probes:
        yield MeasuredSeries("pressure", probe=probe), f"the pore pressure of the probe '{probe}'"
        for i in (1, 2, 3):
            series = MeasuredSeries("displacement", probe=probe, component=i)
            yield series, f"the displacement {i} of the probe '{probe}'"


class _Variants:
    """Variants of one test, each computed at the best values.

    Parameters
    ----------
    model
        Of the test.
    unknowns, values
        All unknowns, and their best values.
    share
        Standard deviation of a curve as a share of its largest value.
    """

    def __init__(
        self, model: ExperimentModel, unknowns: Sequence[PlannedUnknown], values: Array, share: float
    ) -> None:
        self.model, self.unknowns, self.values, self._share = model, unknowns, values, share
        ones = [each.unknown for each in unknowns]
        places = [one.coordinate(float(x)) for one, x in zip(ones, values, strict=True)]
        self._by_coordinate = np.array([one.value_slope(x) for one, x in zip(ones, places, strict=True)])

    def other_quantities(self) -> list[tuple[str, Array]]:
        """Return words and rows of the quantities that were not measured."""
        experiment = _other_quantities(self.model)
        prediction = self._computed(experiment)
        return [] if prediction is None else self._rows(experiment, prediction)

    def larger_load(self) -> list[FurtherData]:
        """Return the measured curves under the largest of some loads at which the surrogate is trusted."""
        for factor in LOADS:
            name = self.model.experiment.name
            experiment = replace(self.model.experiment, load=factor * self.model.experiment.load)
            prediction = self._computed(experiment)
            if prediction is not None and not prediction.flagged:
                rows = np.concatenate([rows for _, rows in self._rows(experiment, prediction)])
                test = f"the test '{name}'" if name else "the same test"
                return [FurtherData(f"{test} under {factor:g} times the load, too", rows)]
        return []

    def _computed(self, experiment: Experiment) -> CurvePrediction | None:
        """Return the curves of a variant in the same steps of time; None: it cannot be computed."""
        if not experiment.curves:
            return None
        try:
            return ExperimentModel(experiment, self.unknowns, self.model.law, self.model.chosen_steps).curves(
                self.values
            )
        except SolveError:
            return None

    def _rows(self, experiment: Experiment, prediction: CurvePrediction) -> list[tuple[str, Array]]:
        """Return name and weighted derivatives by the coordinates of each curve that does not stay zero."""
        ends = np.cumsum([len(curve) for curve in experiment.curves])[:-1]
        values, slopes = np.split(prediction.values, ends), np.split(prediction.slopes, ends)
        sizes = [float(np.abs(each).max()) for each in values]
        return [
            (curve.name, by * self._by_coordinate / (self._share * size))
            for curve, by, size in zip(experiment.curves, slopes, sizes, strict=True)
            if size > NOTHING * max(sizes)
        ]
