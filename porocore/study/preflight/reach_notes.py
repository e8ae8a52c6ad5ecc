"""Notes before a run on components that leave the sampled ranges, or ranges that are too wide.

Between two surfaces across an axis whose displacements are prescribed, a component of H has a known mean along every
line that joins them, so it reaches at least this mean somewhere on the line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import combinations

import numpy as np

from porocore.core.formulas.time_function import Value
from porocore.core.inputs.input_space import NAMES, components
from porocore.core.units.results import ResultUnits
from porocore.errors import SolveError
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.laws.linear import LinearCoefficients
from porocore.macro.problem import Boundary, body_mesh
from porocore.report.format import percent
from porocore.report.metrics import LEAST_FLAGGED
from porocore.states import Array, MacroState
from porocore.study.config.config import RunConfig
from porocore.study.preflight.linear_reach import linear_solutions, too_large
from porocore.study.preflight.workload import sheared
from porocore.study.reach import (
    MINUS,
    ROUND_OFF,
    Reach,
    advice,
    beyond,
    change_without,
    shears,
    visited,
    written,
)

#: States, and place and time of each.
Found = tuple[MacroState, Callable[[int], str]]

#: Beyond what the linear solution reaches, a proposed range goes by this share of what was missing: on a plug of a
#: scaffold at -10 % the law of the cell took H13 to -0.0100 where the linear one said -0.0072.
LINEAR_MARGIN = 0.5
#: Ranges so many times as wide as what is reached are noted: ample ones of the examples are 7, since pressures between
#: the few steps are higher by a third; a component below the smallest share of its range is zero.
WIDE, SMALLEST = 10.0, 1e-4
#: A surface is across an axis if its nodes differ by less than this share of the body along it.
FLAT = 1e-6
#: Times at which prescribed values are looked at, beside those of their kinks.
TIMES = 200


def predicted_reach(config: RunConfig, coefficients: LinearCoefficients) -> Iterator[str]:
    """Yield which components leave the sampled ranges by the linear solution of the body, one line for each.

    Where the body is too large for a check, or its linear solution fails, that is said, and what is prescribed is
    looked at alone.
    """
    why, units = too_large(config), config.result_units
    solutions = []
    try:
        solutions = [] if why else linear_solutions(config, coefficients)
    except SolveError as error:
        why = f"its linear solution fails: {error}"
    if why:
        yield from (f"note: {note}" for note in prescribed_reach(config, body_mesh(config.macro)))
        yield f"reach of the body: not predicted, since {why}"
        return
    found = [_of_solution(solution, units) for solution in solutions]
    share = max(map(partial(_share, config), solutions, [states for states, _ in found]))
    reached = _beyond(config, found) if share >= LEAST_FLAGGED else []
    if not reached:
        yield "reach of the body: by linear poroelasticity it stays within the sampled ranges"
        yield from (f"note: {note}" for note in prescribed_reach(config, body_mesh(config.macro)))
        yield from _too_wide(config, found, [])
        return
    yield (
        f"note: by linear poroelasticity up to {percent(share)} of the body leaves the sampled ranges at one time; "
        "write under 'sampling.inputs:'"
    )
    yield from (f"  {each.line(units, LINEAR_MARGIN)}, since {each.in_words(units)}" for each in reached)
    nodes = len(config.cell.make_mesh("solid", "whole").points)
    for note in sheared(config, nodes, [each.name for each in reached]):
        yield f"note: {note}{_without(config, reached, found)}"
    yield from _too_wide(config, found, [each.name for each in reached])


def _too_wide(config: RunConfig, found: Sequence[Found], left: Sequence[str]) -> Iterator[str]:
    """Yield a note on ranges that are much wider than what the body reaches, and lines to write; not on those ``left``.

    A component that stays zero is sampled for another reason.
    """
    inputs, units = config.sampling.input_space(), config.result_units
    states = MacroState.concatenate([states for states, _ in found])
    if config.surrogate_model == "potential":
        states = inputs.without_rotation(states)
    rows, lines = components(states), []
    for name, *ends in zip(inputs.names, inputs.lower, inputs.upper, strict=True):
        values = rows[NAMES.index(name)]
        low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
        times = (ends[1] - ends[0]) / max(high - low, SMALLEST * (ends[1] - ends[0]))
        if name in left or not WIDE < times < 1 / SMALLEST:
            continue
        more = LINEAR_MARGIN * (high - low)  # at both ends: the law of the cell may turn a sign
        texts = [written(name, end, units) for end in (max(low - more, ends[0]), min(high + more, ends[1]))]
        reaches = f"{written(name, low, units)} to {written(name, high, units)}".translate(MINUS)
        lines.append(
            f"  {name}: {{range: [{', '.join(texts)}]}}, since {name} reaches {reaches} and is sampled {times:.0f} "
            "times as wide"
        )
    if lines:
        yield (
            f"note: by linear poroelasticity the body uses less than one part in {WIDE:g} of a range, and states are "
            "spent where it never comes; write under 'sampling.inputs:'"
        )
        yield from lines


def _without(config: RunConfig, reached: Sequence[Reach], found: Sequence[Found]) -> str:
    """Return what leaving the reached shears out would change, for a cell with mirrors and no sampled shear."""
    if config.surrogate_model != "potential":
        return ""
    shear = max((each for each in reached if each.name in shears(NAMES)), key=lambda each: abs(each.value))
    largest = max(float(np.abs(states.grad_u).max()) for states, _ in found)
    return (
        f"; {shear.name} = {shear.value:.2g} is {percent(abs(shear.value) / largest)} of the largest component of H; "
        "without sampling it states stay flagged, and results change by no more than about the square of this share, "
        f"{100 * change_without(shear.value, largest):.2g} %"
    ).translate(MINUS)


def prescribed_reach(config: RunConfig, mesh: BodyMesh) -> list[str]:
    """Return a note of the components that what is prescribed takes out of the sampled ranges, none without such."""
    reached = _beyond(config, [_prescribed(config, mesh)])
    if not reached:
        return []
    said = advice(reached, config.result_units)
    return [f"what is prescribed leaves the sampled ranges, on average or more: {said}"]


def _beyond(config: RunConfig, found: Sequence[Found]) -> list[Reach]:
    """Return the components that leave the sampled ranges in any of the states that were found, the worst first."""
    inputs, states = config.sampling.input_space(), MacroState.concatenate([states for states, _ in found])
    starts = np.cumsum([0, *(len(states) for states, _ in found)])
    if config.surrogate_model == "potential":
        states = inputs.without_rotation(states)

    def where(row: int) -> str:
        k = int(np.searchsorted(starts, row, side="right")) - 1
        return found[k][1](row - int(starts[k]))

    return beyond(inputs, components(states), where)


def _share(config: RunConfig, solution: MacroSolution, states: MacroState) -> float:
    """Return the largest share of the body that leaves the sampled ranges at one time, given the states at all."""
    inputs = config.sampling.input_space()
    if config.surrogate_model == "potential":
        states = inputs.without_rotation(states)
    unit = inputs.to_unit(inputs.gather(states))
    outside = inputs.moves_other(states) | (np.abs(unit - 0.5) > 0.5 + ROUND_OFF).any(axis=1)
    volumes = BodyMesh(solution.points, solution.cells).weights.ravel()
    return float((outside.reshape(-1, len(volumes)) @ volumes).max() / volumes.sum())


def _of_solution(solution: MacroSolution, units: ResultUnits) -> Found:
    states, where = visited(solution, units)
    return states, lambda row: f"{where(row)} under the load {solution.load:g}"


def _prescribed(config: RunConfig, mesh: BodyMesh) -> Found:
    """Return states of single components that are sure to occur, under all loads, and where each does."""
    units, times, rows, where = config.result_units, _times(config), [np.zeros(10)], ["at rest"]
    for load in config.macro.loads:
        for column, values, said in _known(config, mesh, times):
            k = int(np.abs(values).argmax())
            rows.append(np.zeros(10))
            rows[-1][column] = load * values[k]
            where.append(f"{said} at t = {units.text(times[k], 'time', 3)} under the load {load:g}")
    flat = np.array(rows)
    return MacroState(flat[:, :9].reshape(-1, 3, 3), flat[:, 9]), where.__getitem__


def _times(config: RunConfig) -> Array:
    """Return times of a run (n,), with all kinks of what is prescribed."""
    plan = config.macro.time
    kinks = [*config.macro.corners, plan.ramp_increments * plan.ramp_step]
    return np.asarray(np.unique(np.concatenate([kinks, np.linspace(0, plan.end, TIMES + 1)])))


def _known(config: RunConfig, mesh: BodyMesh, times: Array) -> Iterator[tuple[int, Array, str]]:
    """Yield components of the state, their values at ``times`` that are sure to occur, and where, without the load."""
    macro = config.macro
    for name, boundary in macro.boundary.items():
        if boundary.pressure is not None:
            yield NAMES.index("p"), _course(config, boundary.pressure, times), f"on the surface {name}"
    faces = _faces(config, mesh)
    for (name, j, at, low, high, boundary), (other, k, there, low2, high2, opposite) in combinations(
        faces, 2
    ):
        others = [axis for axis in range(3) if axis != j]
        overlap = (np.minimum(high, high2) - np.maximum(low, low2))[others]
        if j != k or abs(there - at) < 1e-9 or not (overlap > 0).all():
            continue
        for i in range(3):
            one, two = (
                _displacement(b, i, j, x > y) for b, x, y in ((boundary, at, there), (opposite, there, at))
            )
            if one is not None and two is not None:
                change = _signed(config, two, times) - _signed(config, one, times)
                yield 3 * i + j, change / (there - at), f"between the surfaces {name} and {other}"


def _faces(config: RunConfig, mesh: BodyMesh) -> list[tuple[str, int, float, Array, Array, Boundary]]:
    """Return name, axis, position, corners of the bounding box and conditions of all surfaces across an axis."""
    size, found = np.ptp(mesh.points, axis=0), []
    for name, facets in mesh.surfaces.items():
        boundary = config.macro.boundary.get(name)
        if boundary is None:
            continue
        points = mesh.points[np.unique(facets)]
        low, high = points.min(axis=0), points.max(axis=0)
        for j in np.flatnonzero(high - low < FLAT * size):
            found.append((name, int(j), float(low[j]), low, high, boundary))
    return found


def _displacement(boundary: Boundary, i: int, axis: int, upper: bool) -> tuple[Value, float] | None:
    """Return the prescribed displacement along ``i`` of a surface across ``axis``, and its sign; None if it is free."""
    if boundary.normal is not None:
        return (boundary.normal, 1.0 if upper else -1.0) if i == axis else None
    value = boundary.displacement[i]
    return None if value is None else (value, 1.0)


def _signed(config: RunConfig, value: tuple[Value, float], times: Array) -> Array:
    return value[1] * _course(config, value[0], times)


def _course(config: RunConfig, value: Value, times: Array) -> Array:
    """Return a prescribed value at ``times``, without the load."""
    problem = config.macro.problem(1.0)
    factor = np.array([problem.factor(value, float(time)) for time in times])
    return factor * value if isinstance(value, int | float) else factor
