"""Check of every function of time over the whole run, before anything is solved."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from porocore.core.echo import echo
from porocore.core.formulas.domain import first_fault
from porocore.core.formulas.expressions import Expression
from porocore.core.formulas.time_function import TimeFunction
from porocore.errors import ConfigurationError
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
    courses = [(key, course) for key, course in _courses(setup) if course.expression is not None]
    if not courses:
        return
    times = run_times(setup)
    for key, course in courses:
        text = course.expression or ""
        fault = first_fault(Expression.parse(text, ("t",)), times)
        if fault is not None:
            index, why = fault
            raise ConfigurationError(
                f"{key}.expression: {echo(text)} {why} near t = {times[index]:.6g}, within the run from t = 0 to "
                f"{setup.time.end:g}; t and the result are dimensionless"
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


def _courses(setup: MacroSetup) -> Iterator[tuple[str, TimeFunction]]:
    for name, boundary in setup.boundary.items():
        for field in type(boundary).model_fields:
            yield from _within(f"macro.boundary.{name}.{field}", getattr(boundary, field))
    yield from _within("macro.body_force", setup.body_force)


def _within(key: str, value: object) -> Iterator[tuple[str, TimeFunction]]:
    if isinstance(value, TimeFunction):
        yield key, value
    elif isinstance(value, tuple):
        for i, part in enumerate(value):
            yield from _within(f"{key}.{i}", part)
