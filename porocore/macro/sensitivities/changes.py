"""Directions of change of a run under its unknowns: of points, memory, loads, prescribed values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from porocore.core.echo import echo, suggestion
from porocore.core.formulas import TimeFunction
from porocore.errors import ConfigurationError
from porocore.interfaces.law import (
    LawMemory,
    MacroLaw,
    MacroResponse,
    MemoryChanges,
    PointChanges,
    ResponseChanges,
)
from porocore.interfaces.sensitivities import (
    BoundaryChange,
    CellParameterChange,
    InitialPressureChange,
    LoadChange,
    MacroChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.macro.boundary.conditions import Loads, boundary_data
from porocore.macro.composition.regions import BodyFields
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.problem import Boundary, MacroProblem
from porocore.macro.sensitivities.equations import MemoryWeights, PointWeights
from porocore.states import Array, MacroState

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


#: Numbers of a memory: H, <∇u¹>_s and φ.
MEMORY = 9 + 9 + 1


@dataclass(frozen=True, eq=False)
class UnitDerivatives:
    """Response with its derivatives at fixed (H, p, ∇p).

    Attributes
    ----------
    response
        With its tangent.
    fixed
        Derivatives by the unit changes of the points.
    storage_memory : (n, 19)
        Derivatives of the storage by the numbers of the memory.
    """

    response: MacroResponse
    fixed: ResponseChanges
    storage_memory: Array

    def of_changes(self, weights: PointWeights, memory: MemoryWeights) -> Array:
        """Return the weights (n, c) of the unit changes of the points."""
        n, fixed = len(weights.storage), self.fixed
        found = (
            (weights.stress.reshape(n, 1, 9) @ fixed.stress.reshape(n, 9, -1))[:, 0]
            + weights.storage[:, None] * fixed.storage
            + (weights.flux[:, None, :] @ fixed.flux)[:, 0]
        )
        return np.asarray(found + self.of_memory_changes(memory))

    def of_memory_changes(self, memory: MemoryWeights) -> Array:
        """Return the same where the memory of the state alone counts."""
        n, fixed = len(memory.fluid_volume), self.fixed
        found = np.zeros_like(fixed.storage)
        if fixed.fluid_volume is not None:
            found = found + memory.fluid_volume[:, None] * fixed.fluid_volume
        if fixed.mean_grad is not None:
            found = found + (memory.mean_grad.reshape(n, 1, 9) @ fixed.mean_grad.reshape(n, 9, -1))[:, 0]
        return np.asarray(found)

    def of_memory(self, weights: PointWeights) -> MemoryWeights:
        """Return the weights of the memory from which the step began."""
        n = len(weights.storage)
        found = weights.storage[:, None] * self.storage_memory
        return MemoryWeights(found[:, :9].reshape(n, 3, 3), found[:, 9:18].reshape(n, 3, 3), found[:, 18])


class UnitChanges:
    """Unit changes of modulus, viscosity and parameters of all points, as far as unknowns change them.

    Parameters
    ----------
    changes
        Of all unknowns, at all points.
    """

    def __init__(self, changes: PointChanges) -> None:
        self.modulus, self.viscosity = bool(changes.modulus.any()), bool(changes.viscosity.any())
        #: Parameters that change, by their places.
        self.parameters: list[int] = []
        self._count = 0
        if changes.parameters is not None:
            self._count = changes.parameters.shape[1]
            self.parameters = np.flatnonzero(changes.parameters.any(axis=(0, 2))).tolist()

    @property
    def size(self) -> int:
        """Number c of unit changes."""
        return self.modulus + self.viscosity + len(self.parameters)

    def _points(self, n: int, columns: int) -> PointChanges:
        modulus, viscosity = np.zeros((n, columns)), np.zeros((n, columns))
        parameters = np.zeros((n, self._count, columns)) if self._count else None
        column = 0
        for wanted, part in ((self.modulus, modulus), (self.viscosity, viscosity)):
            if wanted:
                part[:, column] = 1.0
                column += 1
        for i in self.parameters:
            assert parameters is not None
            parameters[:, i, column] = 1.0
            column += 1
        return PointChanges(modulus, viscosity, parameters)

    def at_step(self, law: MacroLaw, states: MacroState, grad_p: Array, memory: LawMemory) -> UnitDerivatives:
        """Return the derivatives by the unit changes and by the memory."""
        n, c = len(states), self.size
        rows = np.zeros((MEMORY, c + MEMORY))
        rows[:, c:] = np.eye(MEMORY)
        everywhere = np.broadcast_to(rows, (n, *rows.shape))
        before = MemoryChanges(
            everywhere[:, :9].reshape(n, 3, 3, -1),
            everywhere[:, 9:18].reshape(n, 3, 3, -1),
            everywhere[:, 18],
        )
        response, found = law.respond_to_changes(states, grad_p, memory, self._points(n, c + MEMORY), before)
        return UnitDerivatives(response, _first(found, c), np.ascontiguousarray(found.storage[:, c:]))

    def at_rest(self, law: MacroLaw, states: MacroState) -> UnitDerivatives:
        """Return the derivatives by the unit changes of a law's own memory of a state."""
        n, still = len(states), np.zeros((len(states), 3))
        # One column at least, so that laws are asked for something.
        c = max(self.size, 1)
        response, found = law.respond_to_changes(
            states, still, law.initial_at(states), self._points(n, c), MemoryChanges.zeros(n, c)
        )
        return UnitDerivatives(response, _first(found, self.size), np.zeros((n, MEMORY)))

    def of_unknowns(self, weights: Array, changes: PointChanges) -> Array:
        """Return the gradient (k,) from the integrated weights (n, c) of the unit changes."""
        total, column = np.zeros(changes.modulus.shape[1]), 0
        for wanted, part in ((self.modulus, changes.modulus), (self.viscosity, changes.viscosity)):
            if wanted:
                total += weights[:, column] @ part
                column += 1
        for i in self.parameters:
            assert changes.parameters is not None
            total += weights[:, column] @ changes.parameters[:, i]
            column += 1
        return total


def _first(found: ResponseChanges, c: int) -> ResponseChanges:
    """Return the derivatives by the first c changes, in arrays of their own."""

    def first(part: Array) -> Array:
        return np.ascontiguousarray(part[..., :c])

    return ResponseChanges(
        first(found.stress),
        first(found.storage),
        first(found.flux),
        None if found.fluid_volume is None else _weighed(first(found.fluid_volume)),
        None if found.mean_grad is None else _weighed(first(found.mean_grad)),
        None if found.mean_grad_grad_u is None else _weighed(found.mean_grad_grad_u),
        None if found.mean_grad_p is None else _weighed(found.mean_grad_p),
    )


def _weighed(part: Array) -> Array:
    """Return a part of the memory with 0 at points whose law has none, where nothing weighs it."""
    return np.where(np.isnan(part), 0.0, part)


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
                assert theta is not None
                theta[:, column, j] = _having(d, body, change)
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
        assert found.parameters is not None
        assert states.parameters is not None
        theta = found.parameters.copy()
        for column, j in self._factors:
            share = theta[:, column, j]
            theta[:, column, j] = np.where(share != 0, share * states.parameters[:, column], 0.0)
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


def _loads(d: Discretisation, change: MacroChange) -> LoadsAt:
    if isinstance(change, LoadChange):
        return load_change(d)
    return boundary_change(d, change) if isinstance(change, BoundaryChange) else no_change(d)


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
        place = change.weight.places[change.weight.index]
        raise ConfigurationError(
            f"sensitivities: the parameter {echo(change.name)} changes nothing: no point of the body lies about "
            f"{'xyz'[change.weight.axis]} = {place:g}; take fewer places, or others"
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
