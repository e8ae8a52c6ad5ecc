"""Characteristic values of a scenario, and what one dimensionless unit of each quantity amounts to in SI units."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from porocore.errors import ConfigurationError

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Scales(BaseModel):
    """Force f_c, pore size d, viscosity μ_c and length L, all in SI units.

    Dimensionless results are for E = 1, so that f_c/L² is Young's modulus of the solid [Pa].

    References
    ----------
    Dehghani & Zilian (2022), the section on non-dimensionalisation and the end of the numerical example.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    force: Positive
    """f_c [N]."""
    pore: Positive
    """d, characteristic size of the pores [m]."""
    viscosity: Positive = 1.0
    """μ_c [Pa s]; the dimensionless viscosity of the configuration is relative to it."""
    length: Positive
    """L, characteristic length of the body [m]."""

    def factor(self, quantity: str) -> float:
        """What one dimensionless unit of a quantity amounts to, in the unit of :data:`QUANTITIES`.

        Raises
        ------
        ConfigurationError
            The quantity is unknown.
        """
        return known_quantity(quantity).factor(self)


@dataclass(frozen=True)
class Quantity:
    """A kind of result: its SI unit and its scale."""

    unit: str
    formula: str
    factor: Callable[[Scales], float]


QUANTITIES: dict[str, Quantity] = {
    "displacement": Quantity("m", "L", lambda s: s.length),
    "volume": Quantity("m³", "L³", lambda s: s.length**3),
    "time": Quantity("s", "L⁴ μ_c/(f_c d²)", lambda s: s.length**4 * s.viscosity / (s.force * s.pore**2)),
    "pressure": Quantity("Pa", "f_c/L²", lambda s: s.force / s.length**2),
    "stress": Quantity("Pa", "f_c/L²", lambda s: s.force / s.length**2),
    "energy-density": Quantity("J/m³", "f_c/L²", lambda s: s.force / s.length**2),
    "velocity": Quantity(
        "m/s", "f_c d²/(L³ μ_c)", lambda s: s.force * s.pore**2 / (s.length**3 * s.viscosity)
    ),
    "conductivity": Quantity("m²/(Pa s)", "d²/μ_c", lambda s: s.pore**2 / s.viscosity),
}

#: The two of the paper.
SCENARIOS: dict[str, Scales] = {
    "brain-tissue": Scales(force=1e-3, pore=2e-6, viscosity=1.0, length=1e-3),
    "soil": Scales(force=1.5e6, pore=2e-4, viscosity=1.0, length=1.0),
}


def known_quantity(name: str) -> Quantity:
    """A quantity by name.

    Raises
    ------
    ConfigurationError
        It is unknown.
    """
    if name not in QUANTITIES:
        raise ConfigurationError(f"unknown quantity '{name}'; expected one of {', '.join(QUANTITIES)}")
    return QUANTITIES[name]


def known_scenario(name: str) -> Scales:
    """A scenario by name.

    Raises
    ------
    ConfigurationError
        It is unknown.
    """
    if name not in SCENARIOS:
        raise ConfigurationError(
            f"unknown scenario '{name}'; expected one of {', '.join(SCENARIOS)}, or give the characteristic values "
            "with --force, --pore, --viscosity and --length"
        )
    return SCENARIOS[name]
