"""The main results in SI units, for each scenario of the configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.report.format import number, plain
from porocore.scales import QUANTITIES, Scales
from porocore.solution import MacroSolution, Profile
from porocore.states import Array


@dataclass(frozen=True)
class DimensionalRow:
    """A result, dimensionless and in each scenario."""

    name: str
    dimensionless: str
    values: tuple[str, ...]


def fluid_velocity(profile: Profile) -> Array:
    """w (elements, 3) = F̄ (Ḡw) / det F̄: the relative fluid flux through the deformed area.

    Darcy's law of the paper: w = −K F̄⁻ᵀ ∇_X p.
    """
    volume_ratio = np.linalg.det(profile.deformation)[:, None]
    w: Array = np.einsum("eij,ej->ei", profile.deformation, profile.flux) / volume_ratio
    return w


def dimensional_rows(
    metrics: dict[str, Any], solution: MacroSolution, conductivity: float, scenarios: Mapping[str, Scales]
) -> list[DimensionalRow]:
    """Of one case, as :func:`porocore.report.metrics.case_metrics` describes it.

    Parameters
    ----------
    solution
        The nonlinear one; its profiles give the largest fluid velocity.
    conductivity
        K_22 of the undeformed cell.
    """
    found = metrics["nonlinear"]
    rows: list[tuple[str, str, float | None]] = [
        ("load", "stress", metrics["load"]),
        ("final settlement", "displacement", found["final_settlement"]),
        ("final settlement, linear", "displacement", metrics["linear"]["final_settlement"]),
        ("largest pore pressure", "pressure", found["max_pressure"]),
        ("drained volume", "volume", found["drained_flux"]),
        ("95 % of the settlement after", "time", found["time_to_95_percent"]),
        ("99 % of the settlement after", "time", found["time_to_99_percent"]),
        ("99 %, linear", "time", metrics["linear"]["time_to_99_percent"]),
        ("conductivity of the undeformed cell", "conductivity", conductivity),
    ]
    if solution.profiles:
        profile = max(solution.profiles, key=lambda p: float(np.abs(fluid_velocity(p)).max()))
        name = f"largest relative fluid velocity among the kept times, at t = {plain(profile.time)}"
        rows.append((name, "velocity", float(np.abs(fluid_velocity(profile)).max())))
    return [
        DimensionalRow(
            name,
            number(value),
            tuple(_in_units(value, quantity, scales) for scales in scenarios.values()),
        )
        for name, quantity, value in rows
    ]


def _in_units(value: float | None, quantity: str, scales: Scales) -> str:
    if value is None:
        return number(None)
    found = float(f"{value * scales.factor(quantity):.3g}")
    return f"{number(found, 3)} {QUANTITIES[quantity].unit}"
