"""Components of the state that what is prescribed brings about in any case; refusal of a body turned inside out.

Between two surfaces across an axis whose displacements are prescribed, a component of H has a known mean along every
line that joins them, so it reaches at least this mean somewhere on the line.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from porocore.core.formulas.time_function import Value
from porocore.core.units.results import ResultUnits
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.problem import Boundary, MacroSetup
from porocore.states import Array
from porocore.study.config.sections import MacroSettings

#: A surface is across an axis if its nodes differ by less than this share of the body along it.
FLAT = 1e-6
#: Times at which prescribed values are looked at, beside those of their kinks.
TIMES = 200


@dataclass(frozen=True, eq=False)
class Known:
    """Component of the state that is sure to occur, without the load.

    Attributes
    ----------
    name
        From ``H11`` … ``H33`` and ``p``.
    values : (times,)
        Its value, or its mean along a line.
    where
        Its place in words.
    moved
        Of a stretch, the surfaces with their displacement along its axis (times,) and the key of it.
    width
        Of a stretch, the distance of the surfaces.
    """

    name: str
    values: Array
    where: str
    moved: tuple[tuple[str, Array, str], ...] = ()
    width: float = 0.0


@dataclass(frozen=True, eq=False)
class _Face:
    """Surface across an axis, with the corners of its bounding box."""

    name: str
    axis: int
    at: float
    low: Array
    high: Array
    boundary: Boundary

    def displacement(self, i: int, upper: bool) -> tuple[Value, float, str] | None:
        """Return the prescribed displacement along ``i``, its sign and its key; None if it is free."""
        if self.boundary.normal is not None:
            return (self.boundary.normal, 1.0 if upper else -1.0, "normal") if i == self.axis else None
        value = self.boundary.displacement[i]
        return None if value is None else (value, 1.0, "displacement")

    def meets(self, other: _Face) -> bool:
        """Tell whether lines along the axis join it with another one."""
        others = [axis for axis in range(3) if axis != self.axis]
        overlap = (np.minimum(self.high, other.high) - np.maximum(self.low, other.low))[others]
        return self.axis == other.axis and abs(other.at - self.at) >= 1e-9 and bool((overlap > 0).all())


def require_right_side_out(macro: MacroSettings, mesh: BodyMesh, units: ResultUnits) -> None:
    """Refuse displacements of two surfaces that push one through the other under any load.

    Raises
    ------
    ConfigurationError
        The body would be turned inside out; names the key, the value, and the size of the body.
    """
    times = prescribed_times(macro)
    for each in known(macro, mesh, times):
        if not each.moved:
            continue
        for load in macro.loads:
            k = int((load * each.values).argmin())
            if load * each.values[k] > -1:
                continue
            name, course, key = max(each.moved, key=lambda one: abs(one[1][k]))
            axis = int(each.name[1]) - 1
            said = units.text(load * float(course[k]), "displacement", 4)
            asked = "is that its sign and size?"
            if units.given:
                one = units.text(1.0, "displacement", 4)
                asked = f"did you leave out a unit? A number without one is a multiple of {one}"
            raise ConfigurationError(
                f"macro.boundary.{name}.{key}: u_{axis + 1} = {said} at t = {units.text(float(times[k]), 'time', 3)} "
                f"under the load {load:g} turns the body inside out, which is "
                f"{units.text(each.width, 'displacement', 4)} long {each.where}; expected less than that; "
                f"{asked}"
            )


def prescribed_times(macro: MacroSetup) -> Array:
    """Return times of a run (n,), with all kinks of what is prescribed."""
    plan = macro.time
    kinks = [*macro.corners, plan.ramp_increments * plan.ramp_step]
    return np.asarray(np.unique(np.concatenate([kinks, np.linspace(0, plan.end, TIMES + 1)])))


def known(macro: MacroSetup, mesh: BodyMesh, times: Array) -> Iterator[Known]:
    """Yield components of the state that are sure to occur at ``times``."""
    for name, boundary in macro.boundary.items():
        if boundary.pressure is not None:
            yield Known("p", _course(macro, boundary.pressure, times), f"on the surface {name}")
    for one, two in combinations(_faces(macro, mesh), 2):
        if not one.meets(two):
            continue
        for i in range(3):
            first, second = one.displacement(i, one.at > two.at), two.displacement(i, two.at > one.at)
            if first is None or second is None:
                continue
            courses = [sign * _course(macro, value, times) for value, sign, _ in (first, second)]
            moved = ((one.name, courses[0], first[2]), (two.name, courses[1], second[2]))
            yield Known(
                f"H{i + 1}{one.axis + 1}",
                (courses[1] - courses[0]) / (two.at - one.at),
                f"between the surfaces {one.name} and {two.name}",
                moved if i == one.axis else (),
                abs(two.at - one.at),
            )


def _faces(macro: MacroSetup, mesh: BodyMesh) -> list[_Face]:
    """Return all surfaces across an axis that have facets."""
    size, found = np.ptp(mesh.points, axis=0), []
    for name, facets in mesh.surfaces.items():
        boundary = macro.boundary.get(name)
        if boundary is None or not len(facets):  # Patches may have taken all facets.
            continue
        points = mesh.points[np.unique(facets)]
        low, high = points.min(axis=0), points.max(axis=0)
        for j in np.flatnonzero(high - low < FLAT * size):
            found.append(_Face(name, int(j), float(low[j]), low, high, boundary))
    return found


def _course(macro: MacroSetup, value: Value, times: Array) -> Array:
    """Return a prescribed value at ``times``, without the load."""
    factor = np.array([macro.factor(value, float(time)) for time in times])
    return factor * value if isinstance(value, int | float) else factor
