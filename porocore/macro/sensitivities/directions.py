"""Directions of change of a run under its unknowns: at the points, in the loads, at the beginning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from porocore.core.echo import echo, suggestion
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.law_changes import PointChanges
from porocore.interfaces.sensitivities import (
    BoundaryChange,
    CellParameterChange,
    InitialPressureChange,
    LoadChange,
    MacroChange,
    ModulusChange,
    ViscosityChange,
)
from porocore.macro.boundary.conditions import Loads
from porocore.macro.composition.body_fields import BodyFields
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.sensitivities.boundary_changes import LoadsAt, boundary_change, load_change, no_change
from porocore.states import Array, MacroState


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
