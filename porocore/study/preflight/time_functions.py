"""Check of every function of time at a run's planned times; notes on those that go on after its end."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from porocore.core.echo import echo
from porocore.core.files.yaml_document import dotted
from porocore.core.formulas.domain import first_fault
from porocore.core.formulas.expressions import Expression
from porocore.core.formulas.time_function import TimeFunction
from porocore.core.models.walk import walk
from porocore.core.units.results import ResultUnits, spoken
from porocore.errors import ConfigurationError
from porocore.macro.composition.composed_body import sections
from porocore.macro.integration.stepping import Stepper
from porocore.macro.problem import MacroSetup
from porocore.states import Array

#: Times between 0 and the end at which a function is evaluated, beside those of the steps.
DENSE = 20_000


def check_time_functions(setup: MacroSetup) -> None:
    """Refuse a function of time that has no value somewhere between 0 and the end.

    Raises
    ------
    ConfigurationError
        A function divides by zero, takes the root of a negative number or becomes too large; names key and time.
    """
    expressions = [
        (place.path, place.value.expression)
        for place in walk(MacroSetup, setup)
        if isinstance(place.value, TimeFunction) and place.value.expression is not None
    ]
    times = run_times(setup) if expressions else np.zeros(0)
    for path, text in expressions:
        fault = first_fault(Expression.parse(text, ("t",)), times)
        if fault is not None:
            index, why = fault
            said = partial(spoken().text, quantity="time", digits=6)
            key = dotted(("macro", *path, "expression"))
            raise ConfigurationError(
                f"{key}: {echo(text)} {why} near t = {said(times[index])}, within the run from t = 0 to "
                f"{said(setup.time.end)}; t and the result of an expression are dimensionless"
            )


def run_times(setup: MacroSetup) -> Array:
    """Return the planned times of a run and a dense set between, (n,) in ascending order."""
    stepper = Stepper(setup.time, setup.corners)
    times = [0.0]
    while setup.time.tolerance is None and not stepper.done:
        stepper.accept()
        times.append(stepper.time)
    found: Array = np.unique(np.concatenate([times, np.linspace(0, setup.time.end, DENSE + 1)]))
    return found


def late_functions(setup: MacroSetup, units: ResultUnits) -> Iterator[str]:
    """Yield notes of functions of time that go on after the end of the run, as a missing unit may cause."""
    end = setup.time.end
    courses = {
        f"on the surface {name}": [corner for course in boundary.time_functions for corner in course.corners]
        for name, boundary in setup.boundary.items()
    }
    courses |= {
        f"of {prefix}.{name}": list(entry.corners)
        for prefix, entries in sections(setup)
        for name, entry in entries.items()
        if not isinstance(entry, float | str)
    }
    for where, corners in courses.items():
        last = max(corners, default=0.0)
        if last > end:
            last_time, end_time = (units.text(t, "time") for t in (last, end))
            yield (
                f"the function of time {where} goes on until t = {last_time}, beyond the "
                f"end, {end_time}, and is cut there; check macro.time.end and the unit of the time"
            )
