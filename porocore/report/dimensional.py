"""Results with units, also for each scenario: table rows, figures for metrics.json, Darcy flux."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.core.units import ResultUnits
from porocore.interfaces.solution import MacroSolution, Profile, all_series
from porocore.report.context import LoadingMode, contacts, force_name, reactions
from porocore.report.format import measured, number
from porocore.report.metrics import goes_back
from porocore.report.words.cell import symmetric
from porocore.report.words.results import has_suction, heaves, nothing_settles
from porocore.states import Array

#: Name, quantity and dimensionless value of a row.
Row = tuple[str, str, float | None]


@dataclass(frozen=True)
class DimensionalRow:
    """Result, dimensionless and in each scenario."""

    name: str
    dimensionless: str
    values: tuple[str, ...]


def darcy_flux(profile: Profile) -> Array:
    """Return w (elements, 3) = F₀ q/J₀, F₀ = I + H: the relative fluid flux through area of the deformed body.

    It is F₀ that deforms the body and its surface, so that w of a flux q̄ through reference area dA is q̄ dA/da along
    the current normal.
    """
    F0 = np.eye(3) + profile.grad_u
    w: Array = np.einsum("eij,ej->ei", F0, profile.flux) / np.linalg.det(F0)[:, None]
    return w


def dimensional_rows(
    metrics: dict[str, Any],
    solution: MacroSolution,
    conductivity: Array,
    units: Mapping[str, ResultUnits],
    loading_mode: LoadingMode,
    which: str = "",
) -> list[DimensionalRow]:
    """Return the main results of one load case, given its :func:`porocore.report.metrics.case_metrics`.

    Parameters
    ----------
    solution
        The nonlinear one; its profiles give the largest Darcy flux.
    conductivity
        K (3, 3) of the undeformed cell.
    loading_mode
        The load times E is listed only where a stress is prescribed as a share of it; forces are listed where a
        surface is moved, settlements where they are a result.
    which
        Member of a family that the undeformed cell is, with a space before it.
    """
    found, linear = metrics["nonlinear"], metrics["linear"]
    rows: list[Row] = []

    def said(value: float) -> str:
        return f"{number(value)} {[_in_units(value, 'conductivity', each) for each in units.values()]}"

    if loading_mode.scales:
        rows.append(("load times E", "stress", metrics["load"]))
    if loading_mode.settles:
        rows += _settlement_rows(found, linear)
    rows += _fluid_rows(found)
    rows += [
        (f"conductivity {name} of the undeformed cell{which}", "conductivity", value)
        for name, value in symmetric("K", conductivity, said)
    ]
    for name, force in (reactions(solution) if loading_mode.displaced else {}).items():
        for when in ("peak", "final"):
            rows.append((f"{when} {force_name(force)} on {name}", "force", force[when]))
    for name, each in contacts(solution).items():
        rows += [
            (f"peak force of the indenter {name}", "force", each["peak"]),
            (f"final force of the indenter {name}", "force", each["final"]),
            (f"largest displacement of the indenter {name}", "displacement", each["largest_displacement"]),
            (f"largest contact radius of the indenter {name}", "displacement", each["largest_radius"])
            if "largest_radius" in each
            else (f"largest contact area of the indenter {name}", "area", each["largest_area"]),
            (
                f"largest contact pressure of the indenter {name}",
                "pressure",
                each["largest_contact_pressure"],
            ),
        ]
    if solution.profiles:
        profile = max(solution.profiles, key=lambda p: float(np.abs(darcy_flux(p)).max()))
        time = measured(profile.time, "time")
        name = "largest Darcy flux at the times of the profiles (through the deformed body, averaged over each element)"
        name += f", at t = {time}"
        rows.append((name, "velocity", float(np.abs(darcy_flux(profile)).max())))
    return [
        DimensionalRow(
            name, number(value), tuple(_in_units(value, quantity, each) for each in units.values())
        )
        for name, quantity, value in rows
    ]


def _settlement_rows(found: dict[str, Any], linear: dict[str, Any] | None) -> list[Row]:
    """Return heave if there is any, and the final settlement with its times, and the largest where that is another."""
    if not found["moves_along_y"]:
        named = f"largest displacement, mostly {found['largest_component']}".removesuffix(", mostly ")
        return [(named, "displacement", found["largest_displacement"])]
    heave: Row = ("largest displacement along +y", "displacement", found["largest_heave"])
    if nothing_settles(found) and found["largest_heave"]:
        return [heave]
    laws = {"": found} | ({} if linear is None else {", linear": linear})
    rows = [heave] if heaves(found) else []
    if any(goes_back(law, "final_settlement") for law in laws.values()):
        for name, law in laws.items():
            rows.append((f"largest settlement{name}", "displacement", law["largest_settlement"]))
            rows.append((f"time of the largest settlement{name}", "time", law["time_of_largest_settlement"]))
    rows += [
        (f"final settlement{name}", "displacement", law["final_settlement"]) for name, law in laws.items()
    ]
    rows.append(("95 % of the settlement after", "time", found["time_to_95_percent"]))
    rows.append(("99 % of the settlement after", "time", found["time_to_99_percent"]))
    if linear is not None:
        rows.append(("99 %, linear", "time", linear["time_to_99_percent"]))
    return rows


def _fluid_rows(found: dict[str, Any]) -> list[Row]:
    """Return pressures and drained volumes."""
    rows: list[Row] = [(f"largest {found['pressure']}", "pressure", found["max_pressure"])]
    if has_suction(found):
        rows.append((f"least {found['pressure']}", "pressure", found["least_pressure"]))
    if goes_back(found, "drained"):
        rows.append(("largest drained volume", "volume", found["largest_drained"]))
    return [*rows, ("drained volume", "volume", found["drained"])]


def _in_units(value: float | None, quantity: str, units: ResultUnits) -> str:
    if value is None:
        return number(None)
    found = float(f"{value * units.factor(quantity):.3g}")
    return f"{number(found, 3)} {units.name(quantity)}"


#: Quantities of the figures in ``metrics.json`` and of the responses of a cell; the others are plain numbers.
FIGURES = {
    "conductivity": "conductivity",
    "deformed_conductivity": "conductivity",
    "conductivity_grad_u": "conductivity",
    "permeability": "permeability",
    "Q_11": "compliance",
    "Q": "compliance",
    "C_eff_2222": "stress",
    "C_eff": "stress",
    "biot_modulus": "stress",
    "consolidation_coefficients": "diffusivity",
    "final_settlement": "displacement",
    "largest_settlement": "displacement",
    "time_of_largest_settlement": "time",
    "largest_heave": "displacement",
    "largest_displacement": "displacement",
    "largest_area": "area",
    "largest_radius": "displacement",
    "largest_penetration": "displacement",
    "largest_contact_pressure": "pressure",
    "time_of_largest_displacement": "time",
    "final_displacement": "displacement",
    "time_of_largest_heave": "time",
    "time_to_50_percent": "time",
    "time_to_95_percent": "time",
    "time_to_99_percent": "time",
    "stress_spread": "stress",
    "max_pressure": "pressure",
    "time_of_max_pressure": "time",
    "final_pressure": "pressure",
    "least_pressure": "pressure",
    "time_of_least_pressure": "time",
    "drained": "volume",
    "largest_drained": "volume",
    "time_of_largest_drained": "time",
    "drained_paper": "volume",
    "flagged_first_time": "time",
    "flagged_all_time": "time",
    "end_time": "time",
    "mesh_diffusion_time": "time",
    "time": "time",
    "time_of_largest": "time",
    "peak": "force",
    "time_of_peak": "time",
    "overstress_largest": "stress",
    "time_of_largest_overstress": "time",
    "overstress_end": "stress",
    "overpressure_largest": "pressure",
    "overpressure_end": "pressure",
    "times": "time",
    "osmotic_pressure": "pressure",
    "fixed_charge_density": "concentration",
    "pore_pressure": "pressure",
    "place": "displacement",
    "final": "force",
    "equilibrium": "force",
    "relaxed_50_percent": "time",
    "relaxed_95_percent": "time",
    "stress": "stress",
    "stress_grad_u": "stress",
    "potential": "energy-density",
    "energy": "energy-density",
    "energy_mean": "energy-density",
    "mean_grad_p": "compliance",
    "fluid_volume_p": "compliance",
}


def figures_with_units(figures: Any, units: ResultUnits, name: str = "") -> Any:
    """Return nested figures with ``{"value", "unit", "dimensionless"}`` for each that has a unit; without scales as is.

    Figures are known by their keys; see :data:`FIGURES`.
    """
    if not units.given:
        return figures
    if isinstance(figures, Mapping):
        return {key: figures_with_units(value, units, key) for key, value in figures.items()}
    quantity = FIGURES.get(name)
    if quantity is not None and figures is not None:
        return {
            "value": _each(figures, quantity, units),
            "unit": units.name(quantity),
            "dimensionless": figures,
        }
    if isinstance(figures, list):
        return [figures_with_units(each, units) for each in figures]
    return figures


def _each(figures: Any, quantity: str, units: ResultUnits) -> Any:
    if hasattr(figures, "tolist"):
        figures = figures.tolist()
    if isinstance(figures, list | tuple):
        return [_each(each, quantity, units) for each in figures]
    return float("nan") if figures is None else units.value(float(figures), quantity)


def dimensional_metrics(solutions: Iterable[MacroSolution], units: ResultUnits) -> list[dict[str, Any]]:
    """Return the last and the largest value of every quantity with a unit, and its time, ready for JSON."""
    found = []
    for solution in solutions:
        times = solution.history.time
        series = {}
        for each in all_series(solution):
            if not each.quantity or each.name == "time":
                continue
            largest = int(np.abs(each.values).argmax())
            series[each.name] = {
                "unit": units.name(each.quantity),
                "final": units.value(float(each.values[-1]), each.quantity),
                "largest": units.value(float(each.values[largest]), each.quantity),
                "at": units.value(float(times[largest]), "time"),
            }
        head = {"law": solution.law, "load": solution.load, "time_unit": units.name("time")}
        found.append({**head, "end_time": units.value(float(times[-1]), "time"), "series": series})
    return found
