"""Model of all experiments of a calibration (StudiesModel), one curve after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from porocore.calibration.forward.experiment import ExperimentModel
from porocore.calibration.problem import CurveModel, CurvePrediction, Unknown
from porocore.core.parallel.calls import CallProcesses, Tell, results_of
from porocore.states import Array


class StudiesModel(CurveModel):
    """Curves of several experiments.

    Parameters
    ----------
    unknowns
        All unknowns.
    experiments
        A model of each experiment.
    processes
        Solve the experiments side by side; None: this process solves one after the other.
    """

    def __init__(
        self,
        unknowns: Sequence[Unknown],
        experiments: Sequence[ExperimentModel],
        processes: CallProcesses | None = None,
    ) -> None:
        self.unknowns, self.experiments = tuple(unknowns), tuple(experiments)
        self._processes = processes

    def curves(self, values: Array) -> CurvePrediction:
        """Return the curves; see :class:`~porocore.calibration.problem.CurveModel`."""
        found: list[CurvePrediction] = self._each(curves_elsewhere, values)
        return CurvePrediction(
            np.concatenate([each.values for each in found]),
            np.concatenate([each.slopes for each in found]),
            any(each.flagged for each in found),
        )

    def with_halved_steps(self, values: Array, halvings: int) -> list[Array]:
        """Return the curves of each experiment without slopes, each step in time cut into 2^halvings.

        Raises
        ------
        SolveError
            An experiment cannot be computed with these steps.
        """
        return self._each(halved_elsewhere, values, halvings)

    def _each(self, call: Callable[..., Any], *arguments: Any) -> list[Any]:
        """Return what a call of each experiment returns, side by side where there are processes."""
        if self._processes is None or len(self.experiments) < 2:
            return [call(lambda told: None, one, *arguments) for one in self.experiments]
        calls = [
            self._processes.submit(
                f"while it solved the experiment '{one.experiment.name}'", call, one, *arguments
            )
            for one in self.experiments
        ]
        return results_of(calls)


def curves_elsewhere(tell: Tell, model: ExperimentModel, values: Array) -> CurvePrediction:
    """Return the curves of an experiment in this process."""
    return model.curves(values)


def halved_elsewhere(tell: Tell, model: ExperimentModel, values: Array, halvings: int) -> Array:
    """Return the curves of an experiment with halved steps in this process."""
    return model.halved(halvings).values(values)
