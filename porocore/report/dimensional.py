"""Results with units, also for each scenario: table rows, figures for metrics.json, Darcy flux."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.core.units.results import ResultUnits
from porocore.interfaces.solution import MacroSolution, Profile
from porocore.macro.series import all_series
from porocore.report.format import measured, number
from porocore.report.loading_mode import LoadingMode, force_name, reactions
from porocore.report.words.components import symmetric
from porocore.states import Array


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
    """
    found, linear = metrics["nonlinear"], metrics["linear"]
    rows: list[tuple[str, str, float | None]] = []

    def said(value: float) -> str:
        return f"{number(value)} {[_in_units(value, 'conductivity', each) for each in units.values()]}"

    if loading_mode.scales:
        rows.append(("load times E", "stress", metrics["load"]))
    if loading_mode.settles:
        rows += [
            ("final settlement", "displacement", found["final_settlement"]),
            ("95 % of the settlement after", "time", found["time_to_95_percent"]),
            ("99 % of the settlement after", "time", found["time_to_99_percent"]),
        ]
    if loading_mode.settles and linear is not None:
        rows.insert(-2, ("final settlement, linear", "displacement", linear["final_settlement"]))
        rows.append(("99 %, linear", "time", linear["time_to_99_percent"]))
    rows += [
        ("largest pore pressure", "pressure", found["max_pressure"]),
        ("drained volume", "volume", found["drained"]),
        *(
            (f"conductivity {name} of the undeformed cell", "conductivity", value)
            for name, value in symmetric("K", conductivity, said)
        ),
    ]
    for name, force in (reactions(solution) if loading_mode.displaced else {}).items():
        for which in ("peak", "final"):
            rows.append((f"{which} {force_name(force)} on {name}", "force", force[which]))
    if solution.profiles:
        profile = max(solution.profiles, key=lambda p: float(np.abs(darcy_flux(p)).max()))
        time = measured(profile.time, "time")
        name = f"largest Darcy flux through the deformed body (averaged over each element; largest at t = {time})"
        rows.append((name, "velocity", float(np.abs(darcy_flux(profile)).max())))
    return [
        DimensionalRow(
            name, number(value), tuple(_in_units(value, quantity, each) for each in units.values())
        )
        for name, quantity, value in rows
    ]


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
    "time_to_95_percent": "time",
    "time_to_99_percent": "time",
    "max_pressure": "pressure",
    "time_of_max_pressure": "time",
    "final_pressure": "pressure",
    "drained": "volume",
    "drained_paper": "volume",
    "flagged_first_time": "time",
    "flagged_all_time": "time",
    "end_time": "time",
    "mesh_diffusion_time": "time",
    "time": "time",
    "time_of_largest": "time",
    "peak": "force",
    "time_of_peak": "time",
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
