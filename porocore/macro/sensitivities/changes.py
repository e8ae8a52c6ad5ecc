"""Directions of change of a run under its unknowns: of points, loads, prescribed values and the initial state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from porocore.core.echo import echo, suggestion
from porocore.core.fields import provided
from porocore.core.formulas import TimeFunction
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroLaw, PointChanges
from porocore.interfaces.sensitivities import (
    BoundaryChange,
    CellParameterChange,
    IndenterChange,
    InitialPressureChange,
    LoadChange,
    MacroChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.macro.boundary.conditions import Loads, boundary_data
from porocore.macro.composition.regions import BodyFields
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.problem import MacroProblem
from porocore.states import Array, MacroState

#: Change of the loads of a process at a time.
LoadsAt = Callable[[float], Loads]


def _loads(d: Discretisation, change: MacroChange) -> LoadsAt:
    """Return the change of the loads under a unit change of one unknown."""
    if isinstance(change, BoundaryChange):
        return _boundary_change(d, change)
    if isinstance(change, IndenterChange):
        return _indenter_change(d, change)
    if isinstance(change, ModulusChange) and change.region is None:
        # The penalty of contacts is a multiple of the modulus.
        still = replace(d.loads(0.0 * d.boundary.amplitudes(d.problem, 0.0)), stiffening=1.0)
        return lambda time: still
    if isinstance(change, ViscosityChange):
        # A drained surface lets fluid pass so many times better than the body.
        draining = replace(d.loads(0.0 * d.boundary.amplitudes(d.problem, 0.0)), conducting=-1.0)
        return lambda time: draining
    unit = d.problem.model_copy(update={"load": 1.0 if isinstance(change, LoadChange) else 0.0})
    return lambda time: d.loads(d.boundary.amplitudes(unit, time))


def _indenter_change(d: Discretisation, change: IndenterChange) -> LoadsAt:
    """Return the change of the loads under a unit change of an indenter.

    Raises
    ------
    ConfigurationError
        There is no such indenter, or nothing of the kind to change.
    """
    contacts, name = d.boundary.contacts, change.indenter
    names = [contact.name for contact in contacts]
    if name not in names:
        raise ConfigurationError(
            f"sensitivities: there is no indenter {echo(name)}; "
            f"{suggestion(name, names, 'those of macro.contact are', 'macro.contact is empty')}"
        )
    number = names.index(name)
    contact = contacts[number]
    given = "force" if contact.by_force else "displacement"
    if change.quantity in ("displacement", "force") and change.quantity != given:
        raise ConfigurationError(
            f"macro.contact.{name}.{change.quantity}: the indenter is given a {given}, so that it cannot change"
        )
    if change.quantity == "radius" and not contact.indenter.shape.has_radius:
        raise ConfigurationError(
            f"macro.contact.{name}.shape: a {contact.indenter.shape.kind} has no radius that could change"
        )
    still = d.loads(0.0 * d.boundary.amplitudes(d.problem, 0.0))
    nothing = (0.0,) * len(contacts)

    def at(time: float) -> Loads:
        one = 1.0
        if change.quantity == given:
            one = float(d.boundary.amplitudes(d.problem, time)[contact.function])
        unit = (*nothing[:number], one, *nothing[number + 1 :])
        if change.quantity == "radius":
            return replace(still, radii=unit)
        return replace(still, offsets=unit) if change.quantity == "offset" else replace(still, indenters=unit)

    return at


def _boundary_change(d: Discretisation, change: BoundaryChange) -> LoadsAt:
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
    loads, followed = d.loads_of(data), _followed(d)

    def at(time: float) -> Loads:
        found = loads(data.amplitudes(alone, time))
        own = found.pressures[0] if found.pressures else 0.0
        # Pressures stand in the order of those of the whole problem.
        pressures = tuple(own if name == change.surface else 0.0 for name in followed)
        return Loads(found.values, found.external, pressures, (0.0,) * len(d.boundary.contacts))

    return at


def _followed(d: Discretisation) -> list[str]:
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
    faces = {name: face.without_values() for name, face in problem.boundary.items()}
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
    none = {"boundary": faces, "body_force": (0.0, 0.0, 0.0), "contact": {}}
    return problem.model_copy(update=none)


class Directions:
    """Directions of change under unit changes of k unknowns.

    Parameters
    ----------
    d, body, law
        Of the run.
    changes
        The unknowns.

    Raises
    ------
    ConfigurationError
        There is none, or one is of what the problem does not have.
    """

    def __init__(
        self, d: Discretisation, body: BodyFields, law: MacroLaw, changes: Sequence[MacroChange]
    ) -> None:
        if not changes:
            raise ConfigurationError("sensitivities: expected at least one unknown, got none")
        self._d, self._changes = d, tuple(changes)
        n, k = d.n_points, len(changes)
        modulus, viscosity = np.zeros((n, k)), np.zeros((n, k))
        theta = np.zeros((n, len(law.parameters), k)) if law.parameters else None
        self._factors: list[tuple[int, int]] = []
        self._loads: list[LoadsAt] = []
        for j, change in enumerate(changes):
            self._loads.append(_loads(d, change))
            if isinstance(change, ViscosityChange):
                viscosity[:, j] = 1.0
            elif isinstance(change, ModulusChange):
                modulus[:, j] = body.in_region(change.region, n)
            elif isinstance(change, CellParameterChange):
                column = _column(law, change)
                provided(theta)[:, column, j] = _having(d, body, change)
                if change.factor:
                    self._factors.append((column, j))
        self._points = PointChanges(modulus, viscosity, theta)

    def __len__(self) -> int:
        return len(self._changes)

    def points(self, states: MacroState) -> PointChanges:
        """Return the changes of the points, where these have the parameters of ``states``."""
        found = self._points
        if not self._factors:
            return found
        theta, present = provided(found.parameters).copy(), provided(states.parameters)
        for column, j in self._factors:
            share = theta[:, column, j]
            theta[:, column, j] = np.where(share != 0, share * present[:, column], 0.0)
        return PointChanges(found.modulus, found.viscosity, theta)

    @property
    def at_first(self) -> PointChanges:
        """Changes of the points as shares, where an unknown is a factor of a field."""
        return self._points

    def loads_of(self, unknown: int, time: float) -> Loads:
        """Return the change of loads and prescribed values at ``time`` under one unknown."""
        return self._loads[unknown](time)

    def loads(self, time: float) -> list[Loads]:
        """Return the changes of loads and prescribed values at ``time``, one for each unknown."""
        return [at(time) for at in self._loads]

    def start(self) -> list[Array]:
        """Return the changes (local unknowns,) of the state at the beginning."""
        whole = np.zeros(self._d.mesh.size)
        whole[self._d.mesh.n_u :] = 1.0
        pressure, nothing = self._d.from_mesh(whole), np.zeros(len(self._d.unknowns))
        return [
            pressure if isinstance(change, InitialPressureChange) else nothing for change in self._changes
        ]


def _having(d: Discretisation, body: BodyFields, change: CellParameterChange) -> Array:
    """Return the share of the change that the points (n,) take: 0 where their parameter does not change."""
    having = body.with_field(change.name, change.region)
    if not d.communicator.sum(float(having.sum())):
        where = (
            "no part of the body goes by macro.fields; name a region"
            if change.region is None
            else f"the cell of the region {echo(change.region)} has no such parameter"
        )
        raise ConfigurationError(f"sensitivities: the parameter {echo(change.name)} changes nothing: {where}")
    if change.weight is None:
        return having.astype(float)
    shares = np.where(having, change.weight.values(body.points.places), 0.0)
    if not d.communicator.sum(float(shares.sum())):
        node = ", ".join(f"{'xyz'[axis]} = {place:g}" for axis, place in change.weight.node.items())
        raise ConfigurationError(
            f"sensitivities: the parameter {echo(change.name)} changes nothing: no point of the body lies about "
            f"{node}; take fewer places, or others"
        )
    return shares


def _column(law: MacroLaw, change: CellParameterChange) -> int:
    """Return the place of a parameter among those of the law."""
    if change.name not in law.parameters:
        known = suggestion(change.name, law.parameters, "the parameters are")
        raise ConfigurationError(
            f"sensitivities: the law '{law.name}' has no parameter {echo(change.name)}; {known}"
        )
    return law.parameters.index(change.name)
