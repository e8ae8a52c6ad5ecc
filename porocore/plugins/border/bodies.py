"""Check of the solution of a macro solver: mesh, history, profiles; derivatives of the histories."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.sensitivities import (
    HISTORY_SERIES,
    HistoryWeights,
    MacroChange,
    MacroSensitivities,
)
from porocore.interfaces.solution import PROFILE_SHAPES, SERIES, History, MacroSolution, Profile
from porocore.plugins.border.origin import described, refuse
from porocore.plugins.hookspecs import short_repr
from porocore.states import Array

if TYPE_CHECKING:
    from porocore.macro.problem import MacroProblem

#: Share of the end of a run by which round-off may miss it.
SLACK = 1e-9


def body_solution_of(
    solver: MacroSolver, prepared: Any, law: MacroLaw, problem: MacroProblem, **how: Any
) -> MacroSolution:
    """Return what ``solver.solve(prepared, law, **how)`` returns for ``problem``.

    Raises
    ------
    PluginError
        An array has another shape than it should, holds numbers that are not finite, or the history does not run from
        0 to the end of the problem's time.
    """
    solution = solver.solve(prepared, law, **how)
    return _checked(solver, solution, problem)


def body_sensitivities_of(
    solver: MacroSolver, prepared: Any, law: MacroLaw, problem: MacroProblem, changes: Sequence[MacroChange]
) -> tuple[MacroSolution, MacroSensitivities]:
    """Return what ``solver.solve_with_sensitivities(prepared, law, changes)`` returns for ``problem``.

    Raises
    ------
    PluginError
        As :func:`body_solution_of`, also of the derivatives.
    """
    solution, found = solver.solve_with_sensitivities(prepared, law, changes)
    _checked(solver, solution, problem)
    if not isinstance(found, MacroSensitivities):
        raise refuse(solver, f"expected MacroSensitivities, got {short_repr(found)}")
    steps, k = len(solution.history.time), len(changes)
    for name in HISTORY_SERIES:
        if fault := array_fault(f"sensitivities.{name}", getattr(found, name), (steps, k)):
            raise refuse(solver, fault)
    for kind in ("probes", "reactions", "inflow"):
        for name, values in getattr(found, kind).items():
            if fault := array_fault(f"sensitivities.{kind}/{name}", values, (steps, *SERIES[kind], k)):
                raise refuse(solver, fault)
    return solution, found


def body_gradients_of(
    solver: MacroSolver,
    prepared: Any,
    law: MacroLaw,
    problem: MacroProblem,
    changes: Sequence[MacroChange],
    weights: Callable[[MacroSolution], HistoryWeights],
) -> tuple[MacroSolution, Array]:
    """Return what ``solver.solve_with_gradients(prepared, law, changes, weights)`` returns for ``problem``.

    Raises
    ------
    PluginError
        As :func:`body_solution_of`, also of the gradients.
    """
    counts = []

    def counted(solution: MacroSolution) -> HistoryWeights:
        found = weights(solution)
        counts.append(found.count)
        return found

    solution, gradients = solver.solve_with_gradients(prepared, law, changes, counted)
    _checked(solver, solution, problem)
    if fault := array_fault("gradients", gradients, (counts[-1] if counts else 0, len(changes))):
        raise refuse(solver, fault)
    return solution, gradients


def _checked(solver: MacroSolver, solution: Any, problem: MacroProblem) -> MacroSolution:
    if not isinstance(solution, MacroSolution):
        raise refuse(solver, f"expected a MacroSolution, got {short_repr(solution)}")
    if fault := _mesh_fault(solution) or _history_fault(solution, problem) or _profiles_fault(solution):
        raise refuse(solver, fault)
    return solution


def _mesh_fault(solution: MacroSolution) -> str:
    nodes = len(solution.points) if isinstance(solution.points, np.ndarray) else 0
    if fault := array_fault("points", solution.points, (nodes, 3)):
        return fault
    cells: Any = solution.cells
    if not (isinstance(cells, np.ndarray) and cells.ndim == 2 and cells.dtype.kind in "iu" and cells.size):
        return f"cells: expected numbers of nodes (elements, nodes of each), got {described(cells)}"
    if cells.min() < 0 or cells.max() >= nodes:
        return f"cells: names node {int(cells.max())} of {nodes}"
    return ""


def _history_fault(solution: MacroSolution, problem: MacroProblem) -> str:
    history, end = solution.history, problem.time.end
    if not isinstance(history, History):
        return f"history: expected a History, got {short_repr(history)}"
    steps = len(history.time) if isinstance(history.time, np.ndarray) else 0
    for f in fields(History):
        if fault := array_fault(f"history.{f.name}", getattr(history, f.name), (steps,)):
            return fault
    time = history.time
    if steps < 2 or time[0] != 0 or (np.diff(time) <= 0).any() or abs(time[-1] - end) > SLACK * end:
        return f"history.time: expected times that grow from 0 to {end:g}, got {short_repr(time.tolist())}"
    for kind, width in SERIES.items():
        for name, values in getattr(solution, kind).items():
            if fault := array_fault(f"{kind}/{name}", values, (steps, *width)):
                return fault
    return ""


def _profiles_fault(solution: MacroSolution) -> str:
    counts = {"nodes": len(solution.points), "elements": len(solution.cells)}
    if not solution.profiles:
        return "profiles: expected one at the end at least, got none"
    for i, profile in enumerate(solution.profiles):
        if not isinstance(profile, Profile):
            return f"profiles: expected a Profile, got {short_repr(profile)}"
        for name, declared in PROFILE_SHAPES.items():
            shape = tuple(counts[n] if isinstance(n, str) else n for n in declared)
            if fault := array_fault(f"profiles[{i}].{name}", getattr(profile, name), shape):
                return fault
    return ""


def array_fault(name: str, value: Any, shape: tuple[int, ...]) -> str:
    """Return why a value is no array of finite numbers of this shape; empty if it is one."""
    if not isinstance(value, np.ndarray) or value.shape != shape or value.dtype.kind not in "fiu":
        return f"{name}: expected numbers of shape {shape}, got {described(value)}"
    return "" if np.isfinite(value).all() else f"{name}: holds numbers that are not finite"
