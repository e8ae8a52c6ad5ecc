"""Macro solver around the core's time loop, to which a backend adds its discretisation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from porocore.core.echo import echo
from porocore.core.models.bounds import LARGEST_NUMBER
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.solution import MacroSolution, StepReport
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.integration.time_integration import integrate_in_time


class TimeSteppingMacroSolver(MacroSolver[Discretisation]):
    """Macro solver that integrates in time; a subclass prepares its discretisation.

    Parameters
    ----------
    checkpoint_seconds
        Wall time between two checkpoints; 0 writes one after every step.

    Raises
    ------
    ConfigurationError
        It is no time.
    """

    def __init__(self, *, checkpoint_seconds: float = 5.0) -> None:
        if (
            isinstance(checkpoint_seconds, bool)
            or not isinstance(checkpoint_seconds, int | float)
            or not 0 <= checkpoint_seconds <= LARGEST_NUMBER
        ):
            raise ConfigurationError(
                f"macro.options.checkpoint_seconds: expected a number of at least 0, got {echo(checkpoint_seconds)}"
            )
        self.checkpoint_seconds = float(checkpoint_seconds)

    def solve(
        self,
        prepared: Discretisation,
        law: MacroLaw,
        *,
        checkpoint: Path | None = None,
        on_step: Callable[[StepReport], None] | None = None,
    ) -> MacroSolution:
        """Solve the problem; see :class:`porocore.MacroSolver`."""
        return integrate_in_time(
            prepared,
            law,
            checkpoint=checkpoint,
            on_step=on_step,
            checkpoint_seconds=self.checkpoint_seconds,
        )
