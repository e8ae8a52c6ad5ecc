"""Recursion of the sensitivities over the accepted steps of a run (SensitivityTracker).

With backward Euler a step solves R(x, m, θ) = 0 for the unknowns x, with m what the law remembers of the last accepted
state. So J δx = −∂R/∂θ − ∂R/∂m δm for each unknown θ, with the tangent J at the solution and the total derivative δm
of the memory.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from porocore.core.units.results import spoken
from porocore.errors import SolveError
from porocore.interfaces.law import LawMemory, MacroLaw
from porocore.interfaces.law_changes import MemoryChanges
from porocore.interfaces.sensitivities import MacroChange, MacroSensitivities
from porocore.macro.boundary.conditions import Loads
from porocore.macro.composition.body_fields import BodyFields
from porocore.macro.integration.discretisation import Discretisation, StepFailed
from porocore.macro.integration.linearisation import Linearisations
from porocore.macro.integration.newton import Step
from porocore.macro.integration.recorder import HistoryRecorder
from porocore.macro.sensitivities.directions import Directions
from porocore.macro.sensitivities.equations import StepEquations, changes_at_points
from porocore.macro.sensitivities.recorder import SensitivityRecorder
from porocore.states import Array


class SensitivityTracker:
    """Derivatives of a run by its unknowns, followed from step to step.

    Parameters
    ----------
    d, body, law, record
        Of the run.
    changes
        The unknowns.

    Raises
    ------
    ConfigurationError
        An unknown is of what the problem does not have.
    """

    def __init__(
        self,
        d: Discretisation,
        body: BodyFields,
        law: MacroLaw,
        changes: Sequence[MacroChange],
    ) -> None:
        self._d, self._law, self._changes = d, law, tuple(changes)
        self._directions = Directions(d, body, law, changes)
        self._x = self._directions.start()
        self._memory = MemoryChanges.zeros(d.n_points, len(self._x))
        self._record: SensitivityRecorder | None = None

    def begin(self, x: Array, memory: LawMemory, record: HistoryRecorder) -> None:
        """Take the initial state, and the memory of it."""
        self._record = SensitivityRecorder(record, self._changes)
        self._record.add_start(x, self._x)
        self.renew(memory)

    def renew(self, memory: LawMemory) -> None:
        """Take another memory of the same state, as of a law that has learned more."""
        states, law = memory.states, self._law
        points = self._directions.points(states)
        still = np.zeros((len(states), 3))
        before = MemoryChanges.zeros(len(states), len(self._x))
        response, fixed = law.respond_to_changes(states, still, law.initial_at(states), points, before)
        assert response.tangent is not None
        self._memory = fixed.moved(response.tangent, *changes_at_points(self._d, self._x))[1]

    def add(
        self,
        step: Step,
        memory: LawMemory,
        time: float,
        dt: float,
        loads: Loads,
        linearisations: Linearisations,
    ) -> None:
        """Follow an accepted step that began from ``memory`` and ended at ``time``.

        Raises
        ------
        SolveError
            A linear system has no solution.
        """
        d, states = self._d, step.response.memory.states
        points, own = self._directions.points(states), self._directions.loads(time)
        response, fixed = self._law.respond_to_changes(
            states, d.states(step.x)[1], memory, points, self._memory
        )
        try:
            linear = linearisations.begin(dt, loads) or linearisations.at(response, dt, step.x, loads)
            equations = StepEquations(d, linear, response, fixed, step.x, dt, loads, own)
            self._x, total, self._memory, residuals = equations.solved()
        except StepFailed as failure:
            raise SolveError(
                f"the derivatives at t = {spoken().text(time, 'time', 6)} have no solution: {failure}"
            ) from failure
        assert self._record is not None
        self._record.add_step(step.x, self._x, total, residuals, own, dt)

    def result(self) -> MacroSensitivities:
        """Return the derivatives of the histories."""
        assert self._record is not None
        return self._record.result()
