"""Closed surrogate that is refined during a macro run where a step leaves its training range."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol

import numpy as np

from porocore.interfaces.law import CellLaw, LawMemory, MacroResponse
from porocore.macro.laws.closed_law import ClosedLaw
from porocore.macro.laws.closure import Closure
from porocore.plugins.border import prediction_of
from porocore.states import MacroState


class SurrogateRefinement(Protocol):
    """Refinement of a cell law by further states."""

    def __call__(self, states: MacroState) -> CellLaw | None:
        """Return a cell law that is trained on cells at or near n states too; None where none has a solution."""


class AdaptiveLaw(ClosedLaw):
    """A :class:`ClosedLaw` whose cell law is exchanged when a converged step asked it outside its range.

    The step is then solved again from the last accepted time, whose stored fluid is counted by the new cell law, so
    that the exchange itself moves no fluid. This ends when no point is outside any more or nothing more can be
    learned; what is left is flagged as always.

    Parameters
    ----------
    cell_law, closure, identity, name
        See :class:`ClosedLaw`. The identity does not change with what is learned.
    refine
        Asked with the states of the points outside.
    rounds
        Most exchanges in one step.
    """

    def __init__(
        self,
        cell_law: CellLaw,
        closure: Closure,
        refine: SurrogateRefinement,
        *,
        identity: str | None = None,
        name: str | None = None,
        rounds: int = 8,
    ) -> None:
        super().__init__(cell_law, closure, identity=identity, name=name)
        self.refine, self._rounds, self._round = refine, rounds, 0

    def before_accept(self, response: MacroResponse, memory: LawMemory) -> LawMemory | None:
        """Refine the surrogate where the step left its range; see :class:`~porocore.interfaces.law.MacroLaw`."""
        outside = np.flatnonzero(response.outside_training_range)
        if not len(outside) or self._round >= self._rounds:
            self._round = 0
            return None
        refined = self.refine(response.memory.states[outside])
        if refined is None:
            self._round = 0
            return None
        self._round += 1
        self.cell_law = refined
        self._rest = prediction_of(refined, MacroState.zeros(1))
        known = replace(prediction_of(refined, memory.states, tangent=False), outside_training_range=None)
        return self.closure.memory(memory.states, known)
