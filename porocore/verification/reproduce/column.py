"""The column as the claims and figures of a reproduction ask for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from porocore.interfaces.solution import MacroSolution, Profile
from porocore.interfaces.surrogate import Surrogate
from porocore.plugins.border import prediction_of
from porocore.report.context import ReportContext
from porocore.report.figures.profiles import ColumnAxis, profile_at
from porocore.report.metrics import LoadCase
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Array, CellTangent, MacroState
from porocore.study.config.config import RunConfig

#: Loads of the published column.
LARGE, SMALL = -0.2, -0.01


@dataclass(frozen=True, eq=False)
class Column:
    """The run of the consolidation benchmark, with both closures.

    Attributes
    ----------
    config
        Configuration of the run, with the paper's closure.
    context, metrics
        What its report shows.
    dataset, held_out
        Solved states.
    surrogate
        Of the paper's closure.
    timings
        Seconds by stage.
    """

    config: RunConfig
    context: ReportContext
    metrics: dict[str, Any]
    dataset: Dataset
    held_out: Dataset
    surrogate: Surrogate
    timings: dict[str, float]

    def case(self, load: float) -> LoadCase:
        """Solutions under one load."""
        return next(case for case in self.context.cases if case.load == load)

    def figures_of(self, load: float) -> dict[str, Any]:
        """Figures of merit under one load."""
        found: dict[str, Any] = next(m for m in self.metrics["macro"] if m["load"] == load)
        return found

    @cached_property
    def times(self) -> tuple[float, float, float]:
        """Times of an early, a middle and a late profile."""
        early, middle, late = sorted(self.config.macro.time.profiles)[:3]
        return early, middle, late

    def tangent(self, profile: Profile) -> CellTangent:
        """M and Q of the surrogate at the states of a profile."""
        states = MacroState(profile.grad_u, profile.element_p)
        found = prediction_of(self.surrogate, states).tangent
        assert found is not None
        return found

    def upwards(self, solution: MacroSolution, time: float) -> tuple[Profile, ColumnAxis]:
        """A profile, and which of its nodes and elements follow each other from the bottom to the top."""
        return profile_at(solution, time), ColumnAxis.from_solution(solution)


def at(values: Array, of: Array, where: float) -> float:
    """A quantity ``of`` a load, linear between its ``values``."""
    good = np.isfinite(of)
    return float(np.interp(where, values[good], of[good]))
