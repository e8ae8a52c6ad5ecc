"""Tape of a run (RunTape): what a pass backwards over its accepted steps needs of each."""

from __future__ import annotations

from dataclasses import dataclass

from porocore.errors import ConfigurationError
from porocore.interfaces.law import LawMemory
from porocore.macro.boundary.conditions import Loads
from porocore.macro.integration.linearisation import Linearisations
from porocore.macro.integration.newton import Step
from porocore.macro.integration.recorder import HistoryRecorder
from porocore.states import Array, MacroState


@dataclass(frozen=True, eq=False)
class TapedStep:
    """Accepted step of a run, as a tape keeps it.

    Attributes
    ----------
    x : (local unknowns,)
        Its solution.
    states
        Of the points there, with parameters and places.
    memory
        From which it began.
    time, dt, loads
        Its end, length and loads.
    """

    x: Array
    states: MacroState
    memory: LawMemory
    time: float
    dt: float
    loads: Loads


class RunTape:
    """Record of a run, some 20 numbers for each point and step.

    Attributes
    ----------
    start : (local unknowns,)
        Initial state.
    steps
        Accepted steps.
    history
        Recorder of the histories.
    """

    start: Array
    history: HistoryRecorder

    def __init__(self) -> None:
        self.steps: list[TapedStep] = []

    def begin(self, x: Array, memory: LawMemory, record: HistoryRecorder) -> None:
        """Take the initial state."""
        self.start, self.history = x, record

    def renew(self, memory: LawMemory) -> None:
        """Refuse a law that learns during the run: earlier steps cannot be gone over with what it was then.

        Raises
        ------
        ConfigurationError
            Always.
        """
        raise ConfigurationError(
            "gradients: the law learns during the run, so that no pass goes back over its steps; let it learn before, "
            "or ask for sensitivities"
        )

    def add(
        self,
        step: Step,
        memory: LawMemory,
        time: float,
        dt: float,
        loads: Loads,
        linearisations: Linearisations,
    ) -> None:
        """Add an accepted step that began from ``memory`` and ended at ``time``."""
        self.steps.append(TapedStep(step.x, step.response.memory.states, memory, time, dt, loads))
