"""Notes on what is prescribed and leaves the sampled ranges, before anything is solved.

Between two surfaces across an axis whose displacements are prescribed, a component of H has a known mean along every
line that joins them, so it reaches at least this mean somewhere on the line.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from porocore.core.formulas.time_function import Value
from porocore.core.inputs.input_space import NAMES
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.problem import Boundary
from porocore.states import Array, MacroState
from porocore.study.config.config import RunConfig
from porocore.study.reach import advice, beyond

#: A surface is across an axis if its nodes differ by less than this share of the body along it.
FLAT = 1e-6
#: Times at which prescribed values are looked at, beside those of their kinks.
TIMES = 200


def prescribed_reach(config: RunConfig, mesh: BodyMesh) -> list[str]:
    """Return a note of the components that what is prescribed takes out of the sampled ranges, none without such."""
    inputs, times = config.sampling.input_space(), _times(config)
    units, rows, where = config.result_units, [], []
    for load in config.macro.loads:
        for column, values, said in _known(config, mesh, times):
            k = int(np.abs(values).argmax())
            row = np.zeros(10)
            row[column] = load * values[k]
            rows.append(row)
            where.append(f"{said} at t = {units.text(times[k], 'time', 3)} under the load {load:g}")
    if not rows:
        return []
    flat = np.array(rows)
    states = MacroState(flat[:, :9].reshape(-1, 3, 3), flat[:, 9])
    if config.surrogate_model == "potential":
        states = inputs.without_rotation(states)
    reached = beyond(inputs, np.column_stack([states.grad_u.reshape(-1, 9), states.p]).T, where)
    if not reached:
        return []
    return [f"what is prescribed leaves the sampled ranges, on average or more: {advice(reached, units)}"]


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
