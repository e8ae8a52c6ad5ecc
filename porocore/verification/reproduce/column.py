"""The consolidation run with both closures (Column): figures of merit, times, tangents."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from porocore.interfaces.solution import Profile
from porocore.interfaces.surrogate import Surrogate
from porocore.plugins.border import prediction_of
from porocore.report.context import ReportContext
from porocore.report.metrics import LoadCase
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Array, MacroState
from porocore.study.config.config import RunConfig

#: Loads of the published column.
LARGE, SMALL = -0.2, -0.01
#: M and Q of the paper's figures: field of the tangent, and component, 0-based. The paper's network knows only H_22 and
#: p, so that its "M_2211" can only be the derivative of component 11 by H_22, M_1122; in the undeformed cubic cell both
#: are the same.
TANGENTS: dict[str, tuple[str, tuple[int, ...]]] = {
    "M_2222": ("mean_grad_grad_u", (1, 1, 1, 1)),
    "M_2211": ("mean_grad_grad_u", (0, 0, 1, 1)),
    "Q_22": ("mean_grad_p", (1, 1)),
    "Q_11": ("mean_grad_p", (0, 0)),
}


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

    def tangent(self, name: str, profile: Profile) -> Array:
        """Return a component of :data:`TANGENTS` of the surrogate at the states of a profile, (elements,)."""
        field, component = TANGENTS[name]
        found = prediction_of(self.surrogate, MacroState(profile.grad_u, profile.element_p)).tangent
        values: Array = getattr(found, field)[:, *component]
        return values
