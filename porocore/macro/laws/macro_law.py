"""Macroscopic law of a cell law and a closure (ClosedLaw); one refined where a step leaves its range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from porocore.errors import ConfigurationError
from porocore.interfaces.law import (
    CellLaw,
    LawMemory,
    MacroLaw,
    MacroResponse,
    UndeformedCells,
    fingerprint,
)
from porocore.interfaces.law_changes import MemoryChanges, PointChanges, ResponseChanges
from porocore.macro.laws.cell_changes import cell_changes
from porocore.macro.laws.closure import Closure, ClosurePoints
from porocore.plugins.border import check_prediction, prediction_of
from porocore.states import Array, CellResponse, MacroState

#: Points that a closure treats at once, whose tensors stay in the cache: 80,000 points take 0.30 s in place of 0.49.
CHUNK = 5_000


class ClosedLaw(MacroLaw):
    """Macroscopic law of a cell law and a closure.

    Where the cell law has parameters, the closure takes φ_s and K of each point from the cell law too.

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
        self.noise, self.parameters = cell_law.noise, cell_law.parameters
        self.identity = fingerprint(closure.identity, cell_law.identity if identity is None else identity)
        self._rest: CellResponse | None = None
        #: Parameters of points and their undeformed cells, of the last two that were asked for.
        self._known: list[tuple[Array, UndeformedCells]] = []
        self._begin()

    def _begin(self) -> None:
        """Ask the cell law for its response at rest, which has to have what the closure reads."""
        if not self.parameters:
            self._rest = prediction_of(self.cell_law, MacroState.zeros(1))
            self.closure.check(self._rest, type(self.cell_law).__name__)

    def initial(self, n: int) -> LawMemory:
        """Return the memory at rest with the cell law's own response there, so that its error stores no fluid.

        Raises
        ------
        ValueError
            The law has parameters, which :meth:`initial_at` is told.
        """
        if self._rest is None:
            raise ValueError(f"expected the parameters {', '.join(self.parameters)}; call initial_at")
        rest = replace(self._rest, tangent=None, extrema=None)[np.zeros(n, dtype=np.int64)]
        return self.closure.memory(MacroState.zeros(n), rest, self._porosity(None, n))

    def initial_at(self, points: MacroState) -> LawMemory:
        """Return the memory at rest, of a cell law with parameters by its response to each point's own.

        Raises
        ------
        ConfigurationError
            The cell law does not provide what the closure needs.
        """
        if not self.parameters:
            return self.initial(len(points))
        rest = points.at_rest()
        if len(rest):
            self.closure.check(prediction_of(self.cell_law, rest[:1]), type(self.cell_law).__name__)
        found = prediction_of(self.cell_law, rest, tangent=False)
        porosity = self._porosity(self._cells(rest.parameters), len(rest))
        return self.closure.memory(rest, replace(found, extrema=None), porosity)

    def porosity(self, parameters: Array) -> Array:
        """Return φ_f (n,) of the undeformed cells with ``parameters`` (n, m), of a cell law that has some."""
        cells = self._cells(parameters)
        assert cells is not None
        return cells.porosity

    def _porosity(self, cells: UndeformedCells | None, n: int) -> Array:
        """Return φ_f (n,) of the undeformed cells of n points."""
        return np.full(n, 1 - self.closure.solid_fraction_of(cells))

    def _cells(self, parameters: Array | None) -> UndeformedCells | None:
        """Return the undeformed cells with ``parameters`` (n, m); None where all are that of the closure's constants.

        Raises
        ------
        ConfigurationError
            The parameters are missing, or the cell law does not provide the cells.
        """
        if not self.parameters:
            return None
        law, names = type(self.cell_law).__name__, ", ".join(self.parameters)
        if parameters is None:
            raise ConfigurationError(
                f"the cell law {law} has the parameters {names}, but no values were given"
            )
        for known, cells in self._known:
            if np.array_equal(known, parameters):
                return cells
        found = self.cell_law.undeformed(parameters)
        if found is None:
            raise ConfigurationError(
                f"the cell law {law} has the parameters {names}, but does not provide porosity and conductivity of "
                "the undeformed cell for them"
            )
        self._known = [(parameters, found), *self._known[:1]]
        return found

    def respond(
        self, states: MacroState, grad_p: Array, memory: LawMemory, *, tangent: bool = True
    ) -> MacroResponse:
        """See :class:`MacroLaw`; NaN where the cell law has no values."""
        return self.respond_to_each(states, [grad_p], memory, tangent=tangent)[0]

    def respond_to_each(
        self, states: MacroState, gradients: Sequence[Array], memory: LawMemory, *, tangent: bool = True
    ) -> list[MacroResponse]:
        """See :class:`MacroLaw`; the cell law is asked once."""
        # Newton's iteration may ask for anything; what is not finite is for the macro solver to refuse.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            # Parameters that are missing are told before the cell law is asked.
            cells = self._cells_of(states, memory)
            cell = self._predicted(states, memory, tangent)
            points = [ClosurePoints(states, cell, grad_p, memory, *cells) for grad_p in gradients]
            return [self._closed(at, tangent) for at in points]

    def respond_to_changes(
        self,
        states: MacroState,
        grad_p: Array,
        memory: LawMemory,
        changes: PointChanges,
        before: MemoryChanges,
    ) -> tuple[MacroResponse, ResponseChanges]:
        """Return the response and its derivatives by unknowns; see :class:`MacroLaw`."""
        closure, cells = self.closure, self._cells_of(states, memory)
        at = ClosurePoints(states, self._predicted(states, memory, True), grad_p, memory, *cells)
        K = closure.conductivity if at.cells is None else at.cells.conductivity
        undeformed = None if closure.law == "deformed" else K
        by = cell_changes(self.cell_law, states, at.cell, changes, undeformed, closure.responses)
        closed = [
            closure.respond_to_changes(at[part], by[part], before[part]) for part in _parts(len(states))
        ]
        if len(closed) == 1:
            return closed[0]
        responses, derivatives = map(list, zip(*closed, strict=True))
        return MacroResponse.concatenate(responses), ResponseChanges.concatenate(derivatives)

    def _cells_of(
        self, states: MacroState, memory: LawMemory
    ) -> tuple[UndeformedCells | None, UndeformedCells | None]:
        """Return the undeformed cells of the points, and those of the memory where they are others."""
        before, cells = (self._cells(at.parameters) for at in (memory.states, states))
        return cells, None if before is cells else before

    def _predicted(self, states: MacroState, memory: LawMemory, tangent: bool) -> CellResponse:
        found = self.cell_law.predict_from(memory.states.in_own_axes(), states, tangent=tangent)
        return check_prediction(self.cell_law, found, states)

    def _closed(self, at: ClosurePoints, tangent: bool) -> MacroResponse:
        """Return the response that the closure makes of the cell's, so many points at a time."""
        found = [self.closure.respond(at[part], tangent=tangent) for part in _parts(len(at.states))]
        return found[0] if len(found) == 1 else MacroResponse.concatenate(found)

    def reasons(self, states: MacroState) -> list[str]:
        """Return the reasons that the cell law knows; see :class:`MacroLaw`."""
        return self.cell_law.reasons(states)


def _parts(n: int) -> list[slice]:
    """Return the parts of n points that a closure treats at once, one at least."""
    if n <= CHUNK:
        return [slice(None)]
    return [slice(first, first + CHUNK) for first in range(0, n, CHUNK)]


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
        self.cell_law, self._known = refined, []
        self._begin()
        known = replace(prediction_of(refined, memory.states, tangent=False), outside_training_range=None)
        return self.closure.memory(memory.states, known, memory.fluid_volume)
