"""Notes on ramps, steps and ends of a run that are far from the consolidation time."""

from __future__ import annotations

from collections.abc import Iterator

from porocore.core.formulas.time_function import TimeFunction, Value
from porocore.core.units.results import ResultUnits
from porocore.macro.problem import Boundary, MacroSetup

#: A ramp below this share of the time of consolidation is a jump, and most often one whose unit was left out; 1e-2 to
#: 1e-3 is usual where a relaxation is asked for.
JUMP = 1e-4
#: Before this share of the time half of the fluid is still in a column (0.46): such a run shows little of it.
EARLY = 0.2
#: A run so many times as long, in steps that are longer than it, shows nothing of it either.
LATE = 100.0
#: All that the time of consolidation depends on.
GROWS = (
    "the time grows with cell.viscosity, of which a number without unit is a multiple of scales.viscosity, and with "
    "the square of the size, and falls with the modulus and the square of the pore size (scales.pore or voxel_size)"
)


def run_times(macro: MacroSetup, consolidation: float, units: ResultUnits) -> Iterator[str]:
    """Yield notes on ramps, end and steps of a run that are far from the time in which the body consolidates."""

    def text(time: float) -> str:
        return units.text(time, "time", 3)

    plan, told = macro.time, text(consolidation)
    for key, time in _ramps(macro):
        if time < JUMP * consolidation:
            yield (
                f"{key} is {text(time)}, and the body consolidates in {told}: a jump of the load, which Newton's "
                f"iteration and the sampled ranges have to bear; {_unit(units)}"
            )
    scales = (
        f", the body's size and the scales: {GROWS}"
        if units.given
        else ", cell.viscosity and the size of the body"
    )
    if plan.end < EARLY * consolidation:
        yield (
            f"the run ends after {text(plan.end)}, long before the body consolidates ({told}); "
            f"check macro.time{scales}"
        )
    elif plan.end > LATE * consolidation and plan.step > consolidation:
        yield (
            f"the run ends after {text(plan.end)}, and its steps of {text(plan.step)} are longer than the "
            f"consolidation ({told}); check macro.time{scales}"
        )


def long_step(macro: MacroSetup, units: ResultUnits) -> Iterator[str]:
    """Yield a note on steps of equal length that are longer than the run."""
    plan = macro.time
    if plan.tolerance is None and plan.step > plan.end:
        step, end = (units.text(time, "time", 3) for time in (plan.step, plan.end))
        yield (
            f"macro.time.step is {step}, longer than the whole run, which ends at {end}: after the ramp it takes one "
            "step; give a shorter step, or a later end"
        )


def _unit(units: ResultUnits) -> str:
    if not units.given:
        return "is that what you want?"
    return f"did you leave out a unit, here or of cell.viscosity? {GROWS[0].upper()}{GROWS[1:]}"


def _ramps(macro: MacroSetup) -> Iterator[tuple[str, float]]:
    """Yield the keys of all ramps, and the times at which their loads are reached."""
    plain: list[Value] = [value for value in macro.body_force if not isinstance(value, TimeFunction)]
    for name, face in macro.boundary.items():
        plain += [value for value in _values(face) if not isinstance(value, TimeFunction)]
        for course in face.time_functions:
            if course.until is not None:
                yield f"'until' of a ramp under macro.boundary.{name}", course.until
            elif len(course.table) > 1:
                yield f"the last time of a table under macro.boundary.{name}", course.table[-1][0]
    if any(value != 0 for value in plain) and not macro.time.load_curve:
        time = macro.time.ramp_increments * macro.time.ramp_step
        yield "the ramp of macro.time, ramp_increments times ramp_step,", time


def _values(face: Boundary) -> list[Value]:
    several = (
        *face.displacement,
        face.normal,
        *face.traction,
        face.follower,
        face.plate,
        face.pressure,
        face.flux,
    )
    return [value for value in several if value is not None]
