"""Characteristic scales of a study (Scales): list of quantities with their SI units; scenarios."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Annotated, Self

from pydantic import ConfigDict, Field, model_validator

from porocore.core.echo import echo
from porocore.core.models.strict import StrictModel
from porocore.core.units.dimensions import Dimension
from porocore.errors import ConfigurationError

#: Products of their powers stay finite.
SMALLEST, LARGEST = 1e-30, 1e30
Positive = Annotated[float, Field(ge=SMALLEST, le=LARGEST, allow_inf_nan=False)]


@dataclass(frozen=True)
class ExactScales:
    """Stress E [Pa], length L [m], pore size d [m] and viscosity μ_c [Pa s], as the decimal numbers that were given."""

    stress: Fraction
    length: Fraction
    pore: Fraction
    viscosity: Fraction

    @property
    def force(self) -> Fraction:
        """Force f_c = E L² [N]."""
        return self.stress * self.length**2

    @property
    def velocity(self) -> Fraction:
        """Velocity of the fluid, f_c d²/(L³ μ_c) [m/s]."""
        return self.stress * self.pore**2 / (self.length * self.viscosity)

    @property
    def time(self) -> Fraction:
        """Time L⁴ μ_c/(f_c d²) [s]."""
        return self.length / self.velocity


class Scales(StrictModel):
    """Length L, pore size d, viscosity μ_c and either Young's modulus E of the solid or the force f_c = E L².

    Plain numbers are in SI units. Dimensionless results are for E = 1.

    References
    ----------
    Dehghani & Zilian (2022), the section on non-dimensionalisation and the end of the numerical example.
    """

    # An editor is not to ask for a pore size beside the size of a voxel.
    model_config = ConfigDict(json_schema_extra={"required": ["length"]})

    force: Annotated[Positive, Dimension("force", si=True)] | None = None
    """f_c = E L², as in the paper; this or ``modulus``."""
    modulus: Annotated[Positive, Dimension("stress", si=True)] | None = None
    """E, Young's modulus of the solid, or the reference modulus of another material; this or ``force``."""
    pore: Annotated[Positive, Dimension("displacement", si=True)]
    """d, the edge of a cubic cell, of a box the cube root of its volume; not needed with ``voxel_size`` of an image."""
    viscosity: Annotated[Positive, Dimension("viscosity", si=True)] = 1.0
    """μ_c; ``cell.viscosity`` is relative to it."""
    length: Annotated[Positive, Dimension("displacement", si=True)]
    """L, the length of the body that is 1."""

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.force is None) == (self.modulus is None):
            raise ValueError("expected either modulus, which is E, or force, which is E L²; give one of them")
        return self

    @cached_property
    def exact(self) -> ExactScales:
        """Scales without rounding: a value with a unit and its dimensionless number agree to the last bit."""
        length, pore, viscosity = map(as_written, (self.length, self.pore, self.viscosity))
        if self.modulus is not None:
            return ExactScales(as_written(self.modulus), length, pore, viscosity)
        assert self.force is not None
        return ExactScales(as_written(self.force) / length**2, length, pore, viscosity)

    def factor(self, quantity: str) -> float:
        """Return one dimensionless unit of a quantity in the unit of :data:`QUANTITIES`.

        Raises
        ------
        ConfigurationError
            The quantity is unknown.
        """
        return float(known_quantity(quantity).factor(self.exact))


def as_written(number: float) -> Fraction:
    """Return the shortest decimal number that equals this one to the last bit, as it was written."""
    return Fraction(repr(float(number)))


@dataclass(frozen=True)
class Quantity:
    """A kind of value: its SI unit and its scale."""

    unit: str
    formula: str
    factor: Callable[[ExactScales], Fraction]


QUANTITIES: dict[str, Quantity] = {
    "displacement": Quantity("m", "L", lambda s: s.length),
    "volume": Quantity("m³", "L³", lambda s: s.length**3),
    "time": Quantity("s", "L⁴ μ_c/(f_c d²)", lambda s: s.time),
    "pressure": Quantity("Pa", "f_c/L²", lambda s: s.stress),
    "stress": Quantity("Pa", "f_c/L²", lambda s: s.stress),
    "force": Quantity("N", "f_c", lambda s: s.force),
    "body-force": Quantity("N/m³", "f_c/L³", lambda s: s.stress / s.length),
    "energy-density": Quantity("J/m³", "f_c/L²", lambda s: s.stress),
    "velocity": Quantity("m/s", "f_c d²/(L³ μ_c)", lambda s: s.velocity),
    "flow": Quantity("m³/s", "f_c d²/(L μ_c)", lambda s: s.velocity * s.length**2),
    "viscosity": Quantity("Pa s", "μ_c", lambda s: s.viscosity),
    "conductivity": Quantity("m²/(Pa s)", "d²/μ_c", lambda s: s.pore**2 / s.viscosity),
    "permeability": Quantity("m²", "d²", lambda s: s.pore**2),
    "diffusivity": Quantity("m²/s", "f_c d²/(L² μ_c)", lambda s: s.length**2 / s.time),
    "compliance": Quantity("1/Pa", "L²/f_c", lambda s: 1 / s.stress),
    "pore-size": Quantity("m", "d", lambda s: s.pore),
}

#: Names that configurations and states have for some quantities.
OTHER_NAMES = {"length": "displacement", "p": "pressure"}

#: The two of the paper.
SCENARIOS: dict[str, Scales] = {
    "brain-tissue": Scales(force=1e-3, pore=2e-6, viscosity=1.0, length=1e-3),
    "soil": Scales(force=1.5e6, pore=2e-4, viscosity=1.0, length=1.0),
}


def quantity_name(name: str) -> str:
    """Return the name of a quantity in :data:`QUANTITIES`, given this or another name of it.

    Raises
    ------
    ConfigurationError
        It is unknown.
    """
    known = OTHER_NAMES.get(name, name)
    if known not in QUANTITIES:
        raise ConfigurationError(f"unknown quantity {echo(name)}; expected one of {', '.join(QUANTITIES)}")
    return known


def known_quantity(name: str) -> Quantity:
    """Return a quantity by name.

    Raises
    ------
    ConfigurationError
        It is unknown.
    """
    return QUANTITIES[quantity_name(name)]


def known_scenario(name: str) -> Scales:
    """Return a scenario by name.

    Raises
    ------
    ConfigurationError
        It is unknown.
    """
    if name not in SCENARIOS:
        raise ConfigurationError(
            f"unknown scenario {echo(name)}; expected one of {', '.join(SCENARIOS)}, or give the characteristic values "
            "with --force, --pore, --viscosity and --length"
        )
    return SCENARIOS[name]
