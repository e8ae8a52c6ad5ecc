"""Changes of loads and prescribed values under a change of the load or of one prescribed value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from porocore.core.echo import echo, suggestion
from porocore.core.formulas.time_function import TimeFunction
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import BoundaryChange
from porocore.macro.boundary.conditions import Loads, boundary_data
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.problem import Boundary, MacroProblem

#: Change of the loads of a process at a time.
LoadsAt = Callable[[float], Loads]


def load_change(d: Discretisation) -> LoadsAt:
    """Return the change of the loads under a unit change of the load."""
    unit = d.problem.model_copy(update={"load": 1.0})
    return lambda time: d.loads(d.boundary.amplitudes(unit, time))


def no_change(d: Discretisation) -> LoadsAt:
    """Return loads that are zero."""
    return lambda time: d.loads(0.0 * d.boundary.amplitudes(d.problem, time))


def boundary_change(d: Discretisation, change: BoundaryChange) -> LoadsAt:
    """Return the change of the loads under a unit change of one prescribed value.

    Loads are linear in the prescribed values, so it is the loads of the problem with that value alone, in whose place
    there is 1; a function of time stays as it is.

    Raises
    ------
    ConfigurationError
        Nothing of the kind is prescribed on the surface.
    """
    alone = alone_at(d.problem, change)
    data = boundary_data(d.mesh, alone)
    return partial(_Alone(d, alone, data, d.loads_of(data), change).at)


@dataclass(frozen=True, eq=False)
class _Alone:
    """Loads of one prescribed value alone."""

    d: Discretisation
    problem: MacroProblem
    data: Any
    loads: Any
    change: BoundaryChange

    def at(self, time: float) -> Loads:
        found: Loads = self.loads.at(self.data.amplitudes(self.problem, time))
        if not self.d.boundary.followers:
            return found
        # Pressures stand in the order of those of the whole problem.
        names = followed(self.d)
        pressures = [0.0] * len(names)
        if found.pressures:
            pressures[names.index(self.change.surface)] = found.pressures[0]
        return Loads(found.values, found.external, tuple(pressures))


def followed(d: Discretisation) -> list[str]:
    """Return the surfaces with a pressure that follows them, in the order of the boundary data."""
    return [
        name
        for name, face in d.problem.boundary.items()
        if face.follower != 0 and len(d.mesh.surface(name, f"macro.boundary.{name}"))
    ]


def alone_at(problem: MacroProblem, change: BoundaryChange) -> MacroProblem:
    """Return the problem with one prescribed value alone; the same unknowns are prescribed.

    Raises
    ------
    ConfigurationError
        Nothing of the kind is prescribed on the surface.
    """
    names = list(problem.boundary)
    if change.surface not in names:
        raise ConfigurationError(
            f"sensitivities: nothing is prescribed on a surface {echo(change.surface)}; "
            f"{suggestion(change.surface, names, 'those of macro.boundary are', 'macro.boundary is empty')}"
        )
    if change.component not in (0, 1, 2):
        raise ConfigurationError(
            f"sensitivities: expected a component 0, 1 or 2 on the surface {echo(change.surface)}, got "
            f"{echo(change.component)}"
        )
    faces = {name: _zero(face) for name, face in problem.boundary.items()}
    face, zero = problem.boundary[change.surface], faces[change.surface]
    value = getattr(face, change.quantity)
    vector = change.quantity in ("displacement", "traction")
    present = value[change.component] if vector else value
    if present is None or (change.quantity == "follower" and present == 0):
        held = "free" if present is None else "zero"
        raise ConfigurationError(
            f"macro.boundary.{change.surface}.{change.quantity}: it is {held}, so that it cannot change; prescribe a "
            "value to begin with"
        )
    one: Any = present if isinstance(present, TimeFunction) else 1.0
    if vector:
        whole = list(getattr(zero, change.quantity))
        whole[change.component] = one
        one = tuple(whole)
    faces[change.surface] = zero.model_copy(update={change.quantity: one})
    return problem.model_copy(update={"boundary": faces, "body_force": (0.0, 0.0, 0.0)})


def _zero(face: Boundary) -> Boundary:
    """Return conditions that prescribe the same and are all zero."""
    held = {name: None if getattr(face, name) is None else 0.0 for name in ("normal", "plate", "pressure")}
    return face.model_copy(
        update={
            **held,
            "displacement": tuple(None if u is None else 0.0 for u in face.displacement),
            "traction": (0.0, 0.0, 0.0),
            "follower": 0.0,
            "flux": 0.0,
        }
    )
