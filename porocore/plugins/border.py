"""Border to plugins: all that comes out of one is checked once, and the fault names the plugin.

Behind it the core relies on shapes, numbers, statuses and keys.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from porocore.core.field_check import number_fault, response_fault, shape_fault
from porocore.core.inputs import InputSpace
from porocore.errors import PluginError
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.sampler import Outlook, Request, Sampler
from porocore.interfaces.sensitivities import HISTORY_SERIES, HistoryWeights, MacroChange, MacroSensitivities
from porocore.interfaces.solution import PROFILE_SHAPES, SERIES, History, MacroSolution, Profile
from porocore.plugins.foreign_code import origin_of
from porocore.plugins.hookspecs import short_repr
from porocore.states import Array, CellResponse, MacroState

if TYPE_CHECKING:
    from porocore.cell.materials.prony import Relaxation
    from porocore.macro.problem import MacroProblem


def refuse(thing: object, fault: str) -> PluginError:
    """Return the error to raise for something wrong that came out of ``thing``."""
    return PluginError(f"{origin_of(thing)} returned something wrong: {fault}; report this to its authors")


def described(value: Any) -> str:
    """Return shape and type of an array, and anything else as code has it."""
    if isinstance(value, np.ndarray):
        return f"shape {value.shape} of type {value.dtype}"
    return short_repr(value)


#: Share of the end of a run by which round-off may miss it.
SLACK_OF_END = 1e-9


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
    solver: MacroSolver,
    prepared: Any,
    law: MacroLaw,
    problem: MacroProblem,
    changes: Sequence[MacroChange],
    *,
    profiles: bool = False,
) -> tuple[MacroSolution, MacroSensitivities]:
    """Return what ``solver.solve_with_sensitivities(prepared, law, changes)`` returns for ``problem``.

    With ``profiles`` it is asked for the derivatives of the profiles, too.

    Raises
    ------
    PluginError
        As :func:`body_solution_of`, also of the derivatives.
    """
    more: dict[str, Any] = {"profiles": True} if profiles else {}
    solution, found = solver.solve_with_sensitivities(prepared, law, changes, **more)
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
    if profiles:
        fields: Any = found.profiles
        unknowns = np.shape(fields)[1] if np.ndim(fields) == 3 else 0
        shape = (len(solution.profiles), max(unknowns, 3 * len(solution.points) + 1), k)
        if fault := array_fault("sensitivities.profiles", fields, shape):
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
    if steps < 2 or time[0] != 0 or (np.diff(time) <= 0).any() or abs(time[-1] - end) > SLACK_OF_END * end:
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
        if profile.internal.keys() != solution.quantities.keys():
            return (
                f"profiles[{i}].internal: expected {short_repr([*solution.quantities])}, which 'quantities' names, "
                f"got {short_repr([*profile.internal])}"
            )
        for name, value in profile.internal.items():
            tensor = (3, 3) if np.ndim(value) > 1 else ()
            if fault := array_fault(
                f"profiles[{i}].internal['{name}']", value, (counts["elements"], *tensor)
            ):
                return fault
    return ""


def array_fault(name: str, value: Any, shape: tuple[int, ...]) -> str:
    """Return why a value is no array of finite numbers of this shape; empty if it is one."""
    if not isinstance(value, np.ndarray) or value.shape != shape or value.dtype.kind not in "fiu":
        return f"{name}: expected numbers of shape {shape}, got {described(value)}"
    return "" if np.isfinite(value).all() else f"{name}: holds numbers that are not finite"


def solution_of(solver: CellSolver, prepared: Any, states: MacroState, **how: Any) -> CellSolution:
    """Return what ``solver.solve(prepared, states, **how)`` returns.

    Raises
    ------
    PluginError
        The response is not what its fields declare for n states, or the micro displacements do not belong to them.
    """
    return _checked_cells(solver, solver.solve(prepared, states, **how), len(states))


def relaxed_solution_of(
    solver: CellSolver, prepared: Any, path: MacroState, times: Array, relaxation: Relaxation
) -> CellSolution:
    """Return what ``solver.relax(prepared, path, times, relaxation)`` returns.

    Raises
    ------
    PluginError
        As of :func:`solution_of`.
    """
    return _checked_cells(solver, solver.relax(prepared, path, times, relaxation), len(path))


def _checked_cells(solver: CellSolver, solution: Any, n: int) -> CellSolution:
    if not isinstance(solution, CellSolution):
        raise refuse(solver, f"expected a CellSolution, got {short_repr(solution)}")
    if fault := response_fault(solution.response, n) or _fields_fault(solution.fields, n):
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


#: Characters of a key at most.
LONGEST_KEY = 200
#: Share of an input's range by which round-off may leave the box.
SLACK_OF_RANGE = 1e-9


class CheckedSampler:
    """A sampler whose requests, for states of the box ``inputs``, are checked as they come."""

    def __init__(self, sampler: Sampler, inputs: InputSpace) -> None:
        self.sampler, self.inputs = sampler, inputs
        self._keys: set[str] = set()

    def ask(self) -> list[Request]:
        """Return the next requests.

        Raises
        ------
        PluginError
            They are no list of requests, a key is no new text, or an input is no number of the box.
        """
        requests = self.sampler.ask()
        if not isinstance(requests, list | tuple):
            raise refuse(self.sampler, f"ask: expected a list of Request, got {short_repr(requests)}")
        for request in requests:
            if fault := self._fault(request):
                raise refuse(self.sampler, f"ask: {fault}")
            self._keys.add(request.key)
        return list(requests)

    def tell(self, key: str, response: CellResponse) -> None:
        """Tell the response of a state."""
        self.sampler.tell(key, response)

    @property
    def choosing(self) -> str:
        """Work of a sampler that is asked after a round, in a few words."""
        return str(self.sampler.choosing)

    @property
    def done(self) -> bool:
        """True when every state has been asked for and told."""
        return bool(self.sampler.done)

    @property
    def expected(self) -> int:
        """Estimated number of all states.

        Raises
        ------
        PluginError
            It is no number.
        """
        expected: Any = self.sampler.expected
        try:
            return int(expected)
        except (TypeError, ValueError, OverflowError):
            raise refuse(self.sampler, f"expected: must be a number, got {short_repr(expected)}") from None

    @property
    def outlook(self) -> Outlook:
        """The states foreseen.

        Raises
        ------
        PluginError
            It is no :class:`Outlook`.
        """
        outlook: Any = self.sampler.outlook
        if not isinstance(outlook, Outlook):
            raise refuse(self.sampler, f"outlook: expected an Outlook, got {short_repr(outlook)}")
        return outlook

    def _fault(self, request: Any) -> str:
        if not isinstance(request, Request):
            return f"expected a list of Request, got {short_repr(request)} in it"
        key, x, start = request.key, request.x, request.start
        if not isinstance(key, str) or not key.isprintable() or not 0 < len(key) <= LONGEST_KEY:
            return f"key: expected a text of 1 to {LONGEST_KEY} letters, got {short_repr(key)}"
        if key in self._keys:
            return f"key: '{key}' is asked for twice"
        if start is not None and not isinstance(start, str):
            return f"start of '{key}': expected the key of another state or None, got {short_repr(start)}"
        if not isinstance(x, tuple) or len(x) != len(self.inputs):
            return f"x of '{key}': expected a tuple of {len(self.inputs)} numbers, got {short_repr(x)}"
        for name, value, low, high in zip(
            self.inputs.names, x, self.inputs.lower, self.inputs.upper, strict=True
        ):
            slack = SLACK_OF_RANGE * (high - low)
            if not isinstance(value, float | int) or not math.isfinite(value):
                return f"x of '{key}': expected a finite number for {name}, got {short_repr(value)}"
            if not low - slack <= value <= high + slack:
                return f"x of '{key}': {name} = {value:g} is outside its range [{low:g}, {high:g}]"
        return ""


class Predicts(Protocol):
    """A surrogate, or another law of the cell."""

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses of n states."""


def prediction_of(surrogate: Predicts, states: MacroState, *, tangent: bool = True) -> CellResponse:
    """Return what ``surrogate.predict`` returns.

    Raises
    ------
    PluginError
        As :func:`check_prediction`.
    """
    return check_prediction(surrogate, surrogate.predict(states, tangent=tangent), states)


def check_prediction(law: object, response: Any, states: MacroState) -> CellResponse:
    """Return the response that ``law`` predicts for n states.

    Beyond its sampled range nothing is asked of its numbers: there Newton's iteration may try anything, and refuses
    what is not finite.

    Raises
    ------
    PluginError
        It is not what its fields declare.
    """
    if fault := shape_fault(response, len(states)):
        raise refuse(law, fault)
    if fault := number_fault(response):
        finite = np.isfinite(states.grad_u).all(axis=(1, 2)) & np.isfinite(states.p)
        known = finite & ~response.flagged
        if not known.all():
            fault = number_fault(response[known])
        if fault:
            raise refuse(law, fault)
    found: CellResponse = response
    return found


__all__ = [
    "CheckedSampler",
    "body_gradients_of",
    "body_sensitivities_of",
    "body_solution_of",
    "check_prediction",
    "conductivity_of",
    "prediction_of",
    "solution_of",
]
