"""A macro solver around the core's time loop: a backend adds how it discretises."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from porocore.interfaces.macro import MacroSolver
from porocore.laws import MacroLaw
from porocore.macro.march import march
from porocore.solution import MacroSolution, StepReport


class MarchingMacroSolver(MacroSolver):
    """What ``prepare`` returns is a :class:`~porocore.macro.discretisation.Discretisation`.

    Attributes
    ----------
    checkpoint_seconds
        Wall time between two checkpoints; 0 writes one after every step.
    """

    checkpoint_seconds: float

    def solve(
        self,
        prepared: Any,
        law: MacroLaw,
        *,
        checkpoint: Path | None = None,
        on_step: Callable[[StepReport], None] | None = None,
    ) -> MacroSolution:
        """See :class:`porocore.MacroSolver`; ``prepared`` is what :meth:`prepare` returned."""
        return march(
            prepared,
            law,
            checkpoint=checkpoint,
            on_step=on_step,
            checkpoint_seconds=self.checkpoint_seconds,
        )
