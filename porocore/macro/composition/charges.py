"""Configuration of fixed charges in the body (Charges): density, bath, temperature, state to begin with."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, field_validator

from porocore.core.formulas import TimeFunction, Value
from porocore.core.models.strict import StrictModel
from porocore.core.units import Dimension, units_now
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.fields import (
    AnyField,
    FormulaField,
    ParameterField,
    Points,
    TableField,
    as_field,
)
from porocore.macro.laws.charges import OsmoticPressure
from porocore.states import Array

#: Key of the density.
DENSITY = "macro.charges.density"
#: State with which a charged body begins: at rest under its osmotic pressure, or undeformed.
Beginning = Literal["free-swelling", "as charged"]


class Charges(StrictModel):
    """Charges fixed to the solid, whose counterions draw water from a bath of a salt of two single ions.

    The fluid is in Donnan equilibrium with the bath: its osmotic pressure is
    π = R T Φ (√(c_F² + 4 c*²) − 2 c*), with the charge density c_F = c_F0 φ_f0/φ of the fluid that is left.
    """

    density: Annotated[AnyField, Dimension("concentration")]
    """c_F0, fixed charge by volume of fluid in the undeformed body: a number, at least 0, or a field, whose numbers are
    multiples of the scale of concentrations."""
    bath: Annotated[Value, Dimension("concentration")]
    """c*, concentration of the salt in the bath, above 0: a number, which acts from the beginning, or a function of
    time."""
    osmotic_coefficient: Annotated[float, Field(gt=0, le=10)] = 1.0
    """Φ, osmotic coefficient within the body over that of the bath."""
    temperature: Annotated[Annotated[float, Field(gt=0, le=10_000)], Dimension("temperature", si=True)] = (
        298.15
    )
    """T, the same everywhere and always."""
    initial: Beginning = "free-swelling"
    """State to begin with: at rest under the osmotic pressure with nothing prescribed but the supports, which is found
    first; or undeformed, from where the body swells."""

    @field_validator("density")
    @classmethod
    def _not_negative(cls, density: float | str | ParameterField) -> float | str | ParameterField:
        given: list[float] = []
        if isinstance(density, float):
            given = [density]
        elif isinstance(density, TableField):
            given = [value for _, value in density.table]
        if not isinstance(density, float | str) and density.initial is not None:
            given.append(density.initial)
        for value in given:
            if value < 0:
                raise ValueError(
                    f"expected a density of at least 0, got {_concentration(value)}; the sign of the charges does not "
                    "matter"
                )
        return density

    @field_validator("bath")
    @classmethod
    def _of_salt(cls, bath: float | TimeFunction) -> float | TimeFunction:
        if isinstance(bath, TimeFunction) and bath.ramp is not None:
            raise ValueError(
                "expected a concentration above 0 at all times, got a ramp, which begins at 0; write 'table: [[0, "
                "...], [..., ...]]'"
            )
        given = [bath] if isinstance(bath, float) else [value for _, value in bath.table]
        for value in given:
            if value <= 0:
                raise ValueError(
                    f"expected a concentration above 0, got {_concentration(value)}; a bath of little salt has a small "
                    "one"
                )
        return bath

    @property
    def osmotic(self) -> float:
        """R T Φ over the scales of pressure and concentration, which is T/(1 K) Φ."""
        return self.temperature * self.osmotic_coefficient

    @property
    def bath_field(self) -> ParameterField:
        """The bath as a field that is the same everywhere."""
        if isinstance(self.bath, TimeFunction):
            return FormulaField(formula="1", initial=0.0, over=self.bath)
        return as_field(self.bath)

    @property
    def corners(self) -> tuple[float, ...]:
        """Times at which the bath or the density has a kink."""
        return (*self.bath_field.corners, *as_field(self.density).corners)

    def osmotic_pressure(self, charge: float, bath: float) -> float:
        """Return π [E] at a charge density c_F of the fluid and a concentration c* of the bath."""
        found = OsmoticPressure.at(np.ones(1), np.array([charge]), np.array([bath]), self.osmotic)
        return float(found.value[0])


def require_charges(charges: Charges, mesh: BodyMesh, times: Array) -> None:
    """Refuse a density of charges that is negative somewhere in the body, or a bath without salt, at one of ``times``.

    Raises
    ------
    ConfigurationError
        It is, or a field has no value; the message names key, place and time.
    """
    if isinstance(charges.bath, TimeFunction):
        for time in times.tolist():
            if (bath := charges.bath.at(time)) <= 0:
                raise ConfigurationError(
                    f"macro.charges.bath: expected a concentration above 0 at all times, got {_concentration(bath)} at "
                    f"t = {units_now().text(time, 'time', 6)}"
                )
    field, points = as_field(charges.density), Points.of(mesh)
    for time in times.tolist() if field.varies else [0.0]:
        values = field.in_time(field.reached(points, time, DENSITY), time)
        worst = int(values.argmin())
        if values[worst] < 0:
            at = units_now().texts(points.places[worst], "displacement")
            when = f", t = {units_now().text(time, 'time', 6)}" if field.varies else ""
            raise ConfigurationError(
                f"{DENSITY}: expected a density of at least 0, got {_concentration(values[worst])} at {at}{when}; the "
                "sign of the charges does not matter"
            )


def _concentration(value: float) -> str:
    return units_now().text(value, "concentration")
