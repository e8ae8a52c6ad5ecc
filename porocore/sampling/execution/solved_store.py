"""Cell solver that takes states from a store and adds those that it solves (StoringSolver)."""

from __future__ import annotations

import hashlib
import io
import time
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from porocore.core.files.store import ResultStore
from porocore.errors import MemberError
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.interfaces.records import build_response, flatten_response
from porocore.plugins.border import conductivity_of, solution_of
from porocore.sampling.execution.tasks import FinishedSolve
from porocore.states import Array, CellResponse, MacroState, Status

#: Kind of these results in the store.
STATES = "states"
#: What a numpy archive that is not one may raise.
_FOREIGN = (ValueError, KeyError, OSError, zipfile.BadZipFile)


@dataclass(eq=False)
class SolvedStore:
    """The states of one cell, solved by one backend with one choice of results.

    Attributes
    ----------
    store
        Where they are kept.
    identity
        Hash of the cell, the backend with its version and options, and the version of the equations.
    tangent, fields
        Results of each solve, see :meth:`porocore.CellSolver.solve`. What was solved with fields serves those who want
        none, too.
    found, saved
        Number of states that the store held, and the seconds that their solves had taken.
    member
        For a family the hash of its member with some parameters (m,), in place of ``identity``. A state whose
        parameters no member has is not kept.
    """

    store: ResultStore
    identity: str
    tangent: bool = True
    fields: bool = True
    found: int = 0
    saved: float = 0.0
    member: Callable[[Array], str] | None = None

    def find(self, key: str, state: MacroState, start: CellField | None) -> FinishedSolve | None:
        """Return the solve of a state (one row) that started from a field, under the name ``key``; None if unknown."""
        place = self._hash(state, start)
        found = self.store.find(STATES, place) if place else None
        if found is None or (self.fields and not found.facts.get("fields")):
            return None
        try:
            with np.load(io.BytesIO(found.payload), allow_pickle=False) as arrays:
                solve = _finished(key, dict(arrays), float(found.facts["seconds"]))
        except _FOREIGN:
            return None
        self.found, self.saved = self.found + 1, self.saved + solve.seconds
        return solve if self.fields else replace(solve, field=None)

    def keep(self, solve: FinishedSolve, state: MacroState, start: CellField | None) -> None:
        """Keep a finished solve, one without values too; not one that was lost, since it was never finished."""
        response, field, place = solve.response, solve.field, self._hash(state, start)
        if response.status[0] == Status.lost or not place:
            return
        arrays = flatten_response(response) | {"status": response.status}
        if field is not None:
            arrays |= {"field/grad_u": field.grad_u, "field/p": np.array(field.p), "field/u": field.u}
            arrays["field/domain"] = np.array(field.domain)
        payload = io.BytesIO()
        np.savez(payload, **arrays)
        facts = {"seconds": solve.seconds, "cell": self.identity, "fields": self.fields}
        self.store.keep(STATES, place, payload.getvalue(), facts)

    def _hash(self, state: MacroState, start: CellField | None) -> str:
        """Return the hash of all that a solve depends on; empty where there is no such cell."""
        identity, arrays = self.identity, state.arrays()
        if self.member is not None and state.parameters is not None:
            try:
                identity, arrays = self.member(state.parameters[0]), arrays[:2]
            except MemberError:
                return ""
        found = hashlib.sha256(repr((identity, self.tangent)).encode())
        if start is not None:
            found.update(start.domain.encode())
            arrays += [start.grad_u, np.array(start.p), start.u]
        for array in arrays:
            found.update(np.ascontiguousarray(array, dtype=float).tobytes())
        return found.hexdigest()[:40]


class StoringSolver(CellSolver[Any]):
    """Cell solver that takes from a store what it holds, and adds what it solves.

    Parameters
    ----------
    solver
        Solves the other states.
    known
        Solved states of the prepared cell; the results of each call count, not its own.
    """

    def __init__(self, solver: CellSolver[Any], known: SolvedStore) -> None:
        self._solver, self.known = solver, known

    def prepare(self, cell: Any) -> Any:
        """Return the cell as the solver prepares it."""
        return self._solver.prepare(cell)

    def conductivity(self, prepared: Any) -> Array:
        """Return the conductivity as the solver computes it."""
        return conductivity_of(self._solver, prepared)

    def solve(
        self,
        prepared: Any,
        states: MacroState,
        *,
        start: Sequence[CellField | None] | None = None,
        tangent: bool = True,
        fields: bool = False,
    ) -> CellSolution:
        """Return the solutions of n states, of which those that are not known are solved together."""
        n, known = len(states), replace(self.known, tangent=tangent, fields=fields, found=0, saved=0.0)
        starts = [None] * n if start is None else list(start)
        rows = [known.find("", states[i : i + 1], starts[i]) for i in range(n)]
        self.known.found, self.known.saved = self.known.found + known.found, self.known.saved + known.saved
        missing = [i for i in range(n) if rows[i] is None]
        if missing or not n:
            began = time.perf_counter()
            how: dict[str, Any] = {} if start is None else {"start": [starts[i] for i in missing]}
            solution = solution_of(
                self._solver, prepared, states[missing], tangent=tangent, fields=fields, **how
            )
            if not n:
                return solution
            seconds = (time.perf_counter() - began) / len(missing)
            reached = solution.fields
            if reached is None:  # also where fields are asked for, of a solver that has none
                known, reached = replace(known, fields=False), [None] * len(missing)
            for k, i in enumerate(missing):
                solved = FinishedSolve("", solution.response[k : k + 1], reached[k], seconds)
                known.keep(solved, states[i : i + 1], starts[i])
                rows[i] = solved
        found = [row for row in rows if row is not None]
        response = CellResponse.concatenate([row.response for row in found])
        return CellSolution(response, [row.field for row in found] if known.fields else None)


def _finished(key: str, arrays: dict[str, Array], seconds: float) -> FinishedSolve:
    status = arrays.pop("status")
    of_field = {
        name.removeprefix("field/"): arrays.pop(name) for name in list(arrays) if name.startswith("field/")
    }
    field = None
    if of_field:
        field = CellField(of_field["grad_u"], float(of_field["p"]), str(of_field["domain"]), of_field["u"])
    return FinishedSolve(key, build_response(status, arrays), field, seconds, stored=True)
