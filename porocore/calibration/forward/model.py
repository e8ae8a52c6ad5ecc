"""Model of all experiments of a calibration (StudiesModel), one curve after the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from porocore.calibration.forward.experiment import ExperimentModel
from porocore.calibration.problem import CurveModel, CurvePrediction, Unknown
from porocore.states import Array


class StudiesModel(CurveModel):
    """Curves of several experiments.

    Parameters
    ----------
    unknowns
        All unknowns.
    experiments
        A model of each experiment.
    """

    def __init__(self, unknowns: Sequence[Unknown], experiments: Sequence[ExperimentModel]) -> None:
        self.unknowns, self.experiments = tuple(unknowns), tuple(experiments)

    def curves(self, values: Array) -> CurvePrediction:
        """Return the curves; see :class:`~porocore.calibration.problem.CurveModel`."""
        found = [one.curves(values) for one in self.experiments]
        return CurvePrediction(
            np.concatenate([each.values for each in found]),
            np.concatenate([each.slopes for each in found]),
            any(each.flagged for each in found),
        )
