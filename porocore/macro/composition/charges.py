"""Configuration of fixed charges in the body (Charges): density, bath, temperature, state to begin with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Discriminator, Field, Tag, field_validator

from porocore.core.formulas import TimeFunction, Value
from porocore.core.models.strict import Name, StrictModel
from porocore.core.units import Dimension, units_now
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.baths import BathsField, value_at
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

#: Keys of the density and the bath.
DENSITY, BATH = "macro.charges.density", "macro.charges.bath"
#: State with which a charged body begins: at rest under its osmotic pressure, or undeformed.
Beginning = Literal["free-swelling", "as charged"]


def _of_salt(bath: float | TimeFunction) -> float | TimeFunction:
    """Refuse a bath without salt.

    Raises
    ------
    ValueError
        It is one.
    """
    if isinstance(bath, TimeFunction) and bath.ramp is not None:
        raise ValueError(
            "expected a concentration above 0 at all times, got a ramp, which begins at 0; write 'table: [[0, "
            "...], [..., ...]]'"
        )
    given = [bath] if isinstance(bath, float) else [value for _, value in bath.table]
    for value in given:
        if value <= 0:
            raise ValueError(
                f"expected a concentration above 0, got {_concentration(value)}; a bath of little salt has a small one"
            )
    return bath


def _form(bath: Any) -> str:
    if isinstance(bath, Mapping) and bath and not bath.keys() & TimeFunction.model_fields.keys():
        return "by-surface"
    return "course" if isinstance(bath, Mapping | TimeFunction) else "number"


#: Bath of a surface.
SurfaceBath = Annotated[Value, AfterValidator(_of_salt), Dimension("concentration")]
#: One bath, or those of the drained surfaces by their names.
Bath = Annotated[
    Annotated[float, Tag("number")]
    | Annotated[TimeFunction, Tag("course")]
    | Annotated[dict[Name, SurfaceBath], Tag("by-surface")],
    Discriminator(_form),
]


class Charges(StrictModel):
    """Charges fixed to the solid, whose counterions draw water from a bath of a salt of two single ions.

    The fluid is in Donnan equilibrium with the bath: its osmotic pressure is
    π = R T Φ (√(c_F² + 4 c*²) − 2 c*), with the charge density c_F = c_F0 φ_f0/φ of the fluid that is left.
    """

    density: Annotated[AnyField, Dimension("concentration")]
    """c_F0, fixed charge by volume of fluid in the undeformed body: a number, at least 0, or a field, whose numbers are
    multiples of the scale of concentrations."""
    bath: Annotated[Bath, Dimension("concentration")]
    """c*, concentration of the salt in the bath, above 0: a number, which acts from the beginning, a function of time,
    or where they differ one of these for each drained surface, by its name. In between the salt has then diffused to
    its steady state in the undeformed body, without flux through other surfaces, for ions are faster than fluid; where
    two baths touch it is the mean. The effective fluid pressure is continuous on each surface and drives the fluid, so
    that a difference of baths moves none through a body without charges: there is no osmosis."""
    osmotic_coefficient: Annotated[float, Field(gt=0, le=10)] = 1.0
    """Φ, osmotic coefficient within the body over that of the bath."""
    temperature: Annotated[Annotated[float, Field(gt=0, le=10_000)], Dimension("temperature", si=True)] = (
        298.15
    )
    """T, the same everywhere and always."""
    initial: Beginning = "free-swelling"
    """State to begin with: at rest under the osmotic pressure with nothing prescribed but the supports, which is found
    first; or undeformed: the body has been held in its shape in the bath, and is released at t = 0."""

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
    def _has_salt(cls, bath: Any) -> Any:
        return bath if isinstance(bath, dict) else _of_salt(bath)

    @property
    def osmotic(self) -> float:
        """R T Φ over the scales of pressure and concentration, which is T/(1 K) Φ."""
        return self.temperature * self.osmotic_coefficient

    @property
    def baths(self) -> dict[str, Value]:
        """All baths by their keys."""
        if isinstance(self.bath, dict):
            return {f"{BATH}.{surface}": bath for surface, bath in self.bath.items()}
        return {BATH: self.bath}

    @property
    def bath_field(self) -> ParameterField:
        """The bath as a field of the body."""
        if isinstance(self.bath, dict):
            return BathsField(surfaces=self.bath)
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
    for key, bath in charges.baths.items():
        for time in times.tolist():
            if (value := value_at(bath, time)) <= 0:
                raise ConfigurationError(
                    f"{key}: expected a concentration above 0 at all times, got {_concentration(value)} at "
                    f"t = {units_now().text(time, 'time', 6)}"
                )
    points = Points.of(mesh)
    if isinstance(charges.bath, dict):
        charges.bath_field.reached(points, 0.0, BATH)
    field = as_field(charges.density)
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
