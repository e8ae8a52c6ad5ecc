"""Macroscopic law of a cell law and a closure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.interfaces.law import CellLaw, LawMemory, MacroLaw, MacroResponse, fingerprint
from porocore.macro.laws.closure import Closure
from porocore.plugins.border import check_prediction, prediction_of
from porocore.states import Array, MacroState


class ClosedLaw(MacroLaw):
    """Macroscopic law of a cell law and a closure.

    Parameters
    ----------
    cell_law
        Predicts the responses of the cell; it is told the last accepted states too.
    closure
        Makes stress, storage and flux of them.
    identity
        Hash that tells this cell law from every other, such as that of the file it was loaded from; without
        it the cell law's own is taken (for a surrogate that is the cell's, whatever its weights).
    name
        For reports.

    Raises
    ------
    ConfigurationError
        The cell law does not provide what the closure needs.
    """

    def __init__(
        self, cell_law: CellLaw, closure: Closure, *, identity: str | None = None, name: str | None = None
    ) -> None:
        self.cell_law, self.closure = cell_law, closure
        self.name = closure.name if name is None else name
        self.noise = cell_law.noise
        self.identity = fingerprint(closure.identity, cell_law.identity if identity is None else identity)
        self._rest = prediction_of(cell_law, MacroState.zeros(1))
        closure.check(self._rest, type(cell_law).__name__)

    def initial(self, n: int) -> LawMemory:
        """Return the memory at rest with the cell law's own response there, so that its error stores no fluid."""
        rest = replace(self._rest, tangent=None, extrema=None)[np.zeros(n, dtype=np.int64)]
        return self.closure.memory(MacroState.zeros(n), rest)

    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """See :class:`MacroLaw`; NaN where the cell law has no values."""
        # Newton's iteration may ask for anything; what is not finite is for the macro solver to refuse.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found = self.cell_law.predict_from(memory.states, states, tangent=tangent)
            cell = check_prediction(self.cell_law, found, states)
            return self.closure.respond(states, cell, grad_p, memory, tangent=tangent)

    def reasons(self, states: MacroState) -> list[str]:
        """Return the reasons that the cell law knows; see :class:`MacroLaw`."""
        return self.cell_law.reasons(states)
