"""Solved states of one cell in a store: a state is not solved twice, in whichever study it is asked for."""

from __future__ import annotations

import hashlib
import io
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from porocore.core.files.store import ResultStore
from porocore.interfaces.cell import CellField
from porocore.interfaces.records import build_response, flatten_response
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
        Results of each solve, see :meth:`porocore.CellSolver.solve`.
    found, saved
        Number of states that the store held, and the seconds that their solves had taken.
    """

    store: ResultStore
    identity: str
    tangent: bool = True
    fields: bool = True
    found: int = 0
    saved: float = 0.0

    def find(self, key: str, state: MacroState, start: CellField | None) -> FinishedSolve | None:
        """Return the solve of a state (one row) that started from a field, under the name ``key``; None if unknown."""
        found = self.store.find(STATES, self._hash(state, start))
        if found is None:
            return None
        try:
            with np.load(io.BytesIO(found.payload), allow_pickle=False) as arrays:
                solve = _finished(key, dict(arrays), float(found.facts["seconds"]))
        except _FOREIGN:
            return None
        self.found, self.saved = self.found + 1, self.saved + solve.seconds
        return solve

    def keep(self, solve: FinishedSolve, state: MacroState, start: CellField | None) -> None:
        """Keep a finished solve, one without values too; not one that was lost, since it was never finished."""
        response, field = solve.response, solve.field
        if response.status[0] == Status.lost:
            return
        arrays = flatten_response(response) | {"status": response.status}
        if field is not None:
            arrays |= {"field/grad_u": field.grad_u, "field/p": np.array(field.p), "field/u": field.u}
            arrays["field/domain"] = np.array(field.domain)
        payload = io.BytesIO()
        np.savez(payload, **arrays)
        facts = {"seconds": solve.seconds, "cell": self.identity}
        self.store.keep(STATES, self._hash(state, start), payload.getvalue(), facts)

    def responses(self, states: MacroState, solve: Callable[[MacroState], CellResponse]) -> CellResponse:
        """Return the responses of n states from the undeformed cell; ``solve`` solves those that are not known."""
        known = [self.find("", states[i : i + 1], None) for i in range(len(states))]
        rows = [None if found is None else found.response for found in known]
        missing = [i for i, row in enumerate(rows) if row is None]
        if missing:
            began = time.perf_counter()
            solved = solve(states[missing])
            seconds = (time.perf_counter() - began) / len(missing)
            for k, i in enumerate(missing):
                rows[i] = solved[k : k + 1]
                self.keep(FinishedSolve("", solved[k : k + 1], None, seconds), states[i : i + 1], None)
        return CellResponse.concatenate([row for row in rows if row is not None])

    def _hash(self, state: MacroState, start: CellField | None) -> str:
        found = hashlib.sha256(repr((self.identity, self.tangent, self.fields)).encode())
        arrays: list[Array] = [state.grad_u, state.p]
        if start is not None:
            found.update(start.domain.encode())
            arrays += [start.grad_u, np.array(start.p), start.u]
        for array in arrays:
            found.update(np.ascontiguousarray(array, dtype=float).tobytes())
        return found.hexdigest()[:40]


def _finished(key: str, arrays: dict[str, Array], seconds: float) -> FinishedSolve:
    status = arrays.pop("status")
    of_field = {
        name.removeprefix("field/"): arrays.pop(name) for name in list(arrays) if name.startswith("field/")
    }
    field = None
    if of_field:
        field = CellField(of_field["grad_u"], float(of_field["p"]), str(of_field["domain"]), of_field["u"])
    return FinishedSolve(key, build_response(status, arrays), field, seconds)
