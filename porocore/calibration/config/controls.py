"""Control values of a field along an axis of the body (control_numbers): places, hats, values of the study."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from porocore.calibration.config.numbers import AXES, StudyNumber
from porocore.calibration.config.settings import ControlSettings
from porocore.core.echo import echo
from porocore.core.units.quantities import UnitError
from porocore.core.units.texts import value_of
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import HatFunction
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.axes import as_field
from porocore.macro.composition.field import Points
from porocore.macro.problem import body_mesh
from porocore.states import Array
from porocore.study.config.config import RunConfig


def control_numbers(number: StudyNumber, given: ControlSettings, config: RunConfig) -> list[StudyNumber]:
    """Return the control values of a field as numbers of a study, with the values that the study has there.

    Parameters
    ----------
    number
        The parameter of the cell.
    given
        Axis and coordinates.
    config
        The study.

    Raises
    ------
    ConfigurationError
        The coordinates do not ascend, a control value concerns no point of the body, or the field of the study changes
        with time.
    """
    axis = AXES.index(given.along)
    places, mesh = _places(given, config), body_mesh(config.macro)
    hats = [HatFunction(axis, places, i) for i in range(len(places))]
    _require_points(given, hats, mesh)
    values = _values_of_study(number, hats, mesh, config)
    return [replace(number, hat=hat, value=float(value)) for hat, value in zip(hats, values, strict=True)]


def _places(given: ControlSettings, config: RunConfig) -> tuple[float, ...]:
    """Return the coordinates of the control values, dimensionless."""
    try:
        found = tuple(
            value_of(each, "displacement", config.scales) if isinstance(each, str) else each
            for each in given.at
        )
    except UnitError as error:
        raise ConfigurationError(f"field.at: {error}") from None
    for k, (one, other) in enumerate(pairwise(found)):
        if not one < other:
            raise ConfigurationError(
                f"field.at: expected ascending coordinates, got {_text(given.at[k])} before {_text(given.at[k + 1])}"
            )
    return found


def _text(coordinate: float | str) -> str:
    return echo(coordinate) if isinstance(coordinate, str) else f"{coordinate:g}"


def _require_points(given: ControlSettings, hats: list[HatFunction], mesh: BodyMesh) -> None:
    """Refuse a control value that holds at no point of the body."""
    points = mesh.quadrature_points.reshape(-1, 3)
    for hat, told in zip(hats, given.at, strict=True):
        if not hat.values(points).any():
            along = mesh.points[:, hat.axis]
            raise ConfigurationError(
                f"field.at: no point of the body has the value at {_text(told)}; the body reaches from "
                f"{along.min():.6g} to {along.max():.6g} along {given.along}, dimensionless, and each value needs an "
                "element beside it; give fewer coordinates, or others"
            )


def _values_of_study(
    number: StudyNumber, hats: list[HatFunction], mesh: BodyMesh, config: RunConfig
) -> Array:
    """Return the values at the control places, of a field of the study those along a line through the body's middle."""
    own = config.macro.fields.get(number.name)
    if own is None or isinstance(own, float | int):
        return np.full(len(hats), number.value)
    key, field = f"macro.fields.{number.name}", as_field(own)
    if field.varies:
        raise ConfigurationError(
            f"field: {key} changes with time, which the fitted field would not; remove it, or give numbers"
        )
    middle = (mesh.points.min(axis=0) + mesh.points.max(axis=0)) / 2
    line = np.tile(middle, (len(hats), 1))
    line[:, hats[0].axis] = hats[0].places
    return field.reached(Points(line, line, np.arange(len(line))), 0.0, key)
