"""Notes on laws with memory: what they are, pressures beyond the sampled range, times that a run never sees."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from porocore.core.units import ResultUnits
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.baths import value_at
from porocore.macro.composition.charges import Charges
from porocore.macro.composition.evolution import Evolution
from porocore.macro.composition.fields import Points, as_field
from porocore.macro.composition.regions import field_times
from porocore.macro.laws.rates import NAMED_RATES, name_in_formula
from porocore.macro.problem import MacroSetup, TimePlan
from porocore.study.config.config import RunConfig

#: A branch is never seen that dies out within this share of the shortest step, or lives so many times as long as a run.
SHORTEST, LONGEST = 0.1, 100.0
#: A proposed range goes beyond the osmotic pressure by this share, since what drives the fluid comes on top.
MARGIN = 0.25


def law_lines(config: RunConfig, mesh: BodyMesh) -> Iterator[str]:
    """Yield what the laws of a body remember, one line each; nothing where they have no memory."""
    units, macro = config.result_units, config.macro
    for name, relaxation in config.relaxations.items():
        if relaxation is None:
            continue
        told = (f"{each.strength:g} in {units.text(each.time, 'time')}" for each in relaxation.branches)
        whole = 1 + sum(each.strength for each in relaxation.branches)
        cell = "" if name is None else f" of the cell {name}"
        yield f"relaxation{cell}: {', '.join(told)}; a sudden strain meets {whole:g} times the stiffness"
    if macro.charges is not None:
        yield _charges(macro.charges, OsmoticPressures.of(macro, macro.charges, mesh), units)
    ranges = {name: ends for of_cell in config.cell_ranges.by_region for name, ends in of_cell.items()}
    for name, evolution in macro.evolution.items():
        low, high = ranges[name]
        yield f"{name} evolves within [{low:g}, {high:g}]: {_rate(name, evolution, units)}"


def memory_warnings(config: RunConfig, mesh: BodyMesh) -> Iterator[str]:
    """Yield warnings of pressures that are not sampled, and of relaxations that a run never sees."""
    yield from _unsampled(config, mesh)
    yield from _unseen(config)


@dataclass(frozen=True)
class OsmoticPressures:
    """Ends of the charge density c_F0, the bath and the osmotic pressure π of the undeformed body, at all times."""

    density: tuple[float, float]
    bath: tuple[float, float]
    pressure: tuple[float, float]

    @classmethod
    def of(cls, macro: MacroSetup, charges: Charges, mesh: BodyMesh) -> OsmoticPressures:
        """Return them for a body; its bath is looked at from the beginning to the end."""
        field, points = as_field(charges.density), Points.of(mesh)
        times = sorted(
            {*field_times(macro, macro.time.end), *(t for t in charges.corners if t <= macro.time.end)}
        )
        densities = np.concatenate(
            [
                field.in_time(field.reached(points, t, "macro.charges.density"), t)
                for t in (times if field.varies else times[:1])
            ]
        )
        baths = [value_at(bath, t) for bath in charges.baths.values() for t in times]
        density, bath = ((float(min(values)), float(max(values))) for values in (densities.tolist(), baths))
        pressures = [
            charges.osmotic_pressure(*ends) for ends in ((density[0], bath[1]), (density[1], bath[0]))
        ]
        return cls(density, bath, (pressures[0], pressures[1]))


def _charges(charges: Charges, found: OsmoticPressures, units: ResultUnits) -> str:
    density, bath = (_from_to(ends, "concentration", units) for ends in (found.density, found.bath))
    pressure = _from_to(found.pressure, "pressure", units)
    where = "baths" if isinstance(charges.bath, dict) else "a bath"
    begins = {
        "free-swelling": "the run begins when it has swollen freely",
        "as charged": "the run begins undeformed",
    }
    return (
        f"fixed charges: {density} of the fluid, in {where} of {bath} at {charges.temperature:g} K: osmotic pressure "
        f"{pressure} in the undeformed body; {begins[charges.initial]}"
    )


def _rate(name: str, evolution: Evolution, units: ResultUnits) -> str:
    formula, quantities = evolution.rate, dict[str, str]()
    if evolution.law is not None:
        law = NAMED_RATES[evolution.law]
        formula = f"{evolution.law}, {law.formula.replace('OWN', name_in_formula(name))}"
        quantities = {key: one.unit for key, one in law.constants.items()}
    named = {"1/time": "rate", "stress": "stress"}
    numbers = (
        f"{key} = {units.text(value, named.get(quantities.get(key, ''), ''))}"
        for key, value in evolution.constants.items()
    )
    return ", ".join([f"{formula} per time", *numbers])


def _from_to(ends: tuple[float, float], quantity: str, units: ResultUnits) -> str:
    low, high = (units.text(end, quantity, 3) for end in ends)
    return low if low == high else f"{low} to {high}"


def _unsampled(config: RunConfig, mesh: BodyMesh) -> Iterator[str]:
    """Yield a warning where the sampled pressures of a cell do not hold the osmotic pressure of the charged body."""
    charges, units = config.macro.charges, config.result_units
    if charges is None:
        return
    reached = OsmoticPressures.of(config.macro, charges, mesh).pressure[1]
    for name in config.cell_names:
        inputs = config.of_cell(name).sampling.inputs
        high = inputs["p"].range[1] if "p" in inputs else 0.0
        if reached <= high:
            continue
        key = f"sampling.cells.{name}" if name in config.sampling.cells else "sampling"
        there = units.text(high, "pressure", 3) if "p" in inputs else "none"
        wanted = units.text((1 + MARGIN) * reached, "pressure", 2)
        yield (
            f"{key}.inputs.p: the osmotic pressure of the charged body is up to "
            f"{units.text(reached, 'pressure', 3)} before it swells, but the largest that is sampled is {there}; "
            f"sample up to {wanted}"
        )


def _unseen(config: RunConfig) -> Iterator[str]:
    """Yield a warning of each branch that dies out within a step, or hardly begins to before the end of the run."""
    plan, units = config.macro.time, config.result_units
    shortest = shortest_step(plan)
    for name, relaxation in config.relaxations.items():
        key = f"{'cell' if name is None else f'cells.{name}'}.material.relaxation.branches"
        for k, branch in enumerate(() if relaxation is None else relaxation.branches):
            time = f"{key}.{k}.time: {units.text(branch.time, 'time')}"
            if branch.strength == 0:
                continue
            if branch.time < SHORTEST * shortest:
                yield (
                    f"{time} is far below the shortest step, {units.text(shortest, 'time')}, so that the branch has "
                    "died out after each and is never seen; take shorter steps, or leave it out"
                )
            elif branch.time > LONGEST * plan.end:
                yield (
                    f"{time} is far beyond the end of the run, {units.text(plan.end, 'time')}, so that the branch does "
                    "not relax and only stiffens the solid; check its unit, or leave it out"
                )


def shortest_step(plan: TimePlan) -> float:
    """Return the length of the shortest step that a plan takes, if none fails; with an error control the least."""
    return plan.smallest_step if plan.tolerance is not None else min(plan.step, plan.ramp_step)
