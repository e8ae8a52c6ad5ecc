"""Check of the responses and the conductivity that a cell solver returns."""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.core.fields.check import response_fault
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.plugins.border.origin import described, refuse
from porocore.plugins.hookspecs import short_repr
from porocore.states import Array, MacroState


def solution_of(solver: CellSolver, prepared: Any, states: MacroState, **how: Any) -> CellSolution:
    """Return what ``solver.solve(prepared, states, **how)`` returns.

    Raises
    ------
    PluginError
        The response is not what its fields declare for n states, or the micro displacements do not belong to them.
    """
    solution = solver.solve(prepared, states, **how)
    if not isinstance(solution, CellSolution):
        raise refuse(solver, f"expected a CellSolution, got {short_repr(solution)}")
    if fault := response_fault(solution.response, len(states)) or _fields_fault(solution.fields, len(states)):
        raise refuse(solver, fault)
    return solution


def conductivity_of(solver: CellSolver, prepared: Any) -> Array:
    """Return the conductivity K (3, 3) of the undeformed cell, as the solver gives it.

    Raises
    ------
    PluginError
        It is no matrix (3, 3) of finite numbers.
    """
    K = solver.conductivity(prepared)
    if not (isinstance(K, np.ndarray) and K.shape == (3, 3) and K.dtype == np.float64):
        raise refuse(solver, f"conductivity: expected (3, 3) numbers of type float64, got {described(K)}")
    if not np.isfinite(K).all():
        raise refuse(solver, "conductivity: holds numbers that are not finite")
    return K


def _fields_fault(found: Any, n: int) -> str:
    if found is None:
        return ""
    if not isinstance(found, list | tuple) or len(found) != n:
        return f"fields: expected {n}, one for each state, or None, got {short_repr(found)}"
    for row, field in enumerate(found):
        if field is None:
            continue
        if not isinstance(field, CellField) or field.domain not in ("eighth", "whole"):
            return (
                f"fields: row {row}: expected a CellField of the eighth or the whole, got {short_repr(field)}"
            )
        u = field.u
        if not (isinstance(u, np.ndarray) and u.ndim == 2 and u.shape[1] == 3 and np.isfinite(u).all()):
            return f"fields: row {row}: expected finite displacements u (nodes, 3), got {described(u)}"
    return ""
