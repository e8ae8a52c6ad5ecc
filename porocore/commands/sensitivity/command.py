"""``porocore sensitivity``: every response of the cell along one load at a time; plan from text."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli import options
from porocore.cli.common import (
    MINUS,
    check_workers,
    chosen_store,
    in_units_of,
    page,
    parse_pressure,
    plain_table,
    read_config,
)
from porocore.core.echo import comma_within, echo
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from porocore.commands.sensitivity.plan import StudyPlan, Sweep
    from porocore.commands.sensitivity.results import Sensitivity
    from porocore.core.units import Scales

_ALL = "uniaxial,volumetric,shear,pressure"


def sensitivity(
    config: options.ConfigArgument = None,
    fem: options.FemOption = None,
    loads: Annotated[
        str,
        typer.Option(
            metavar="LIST",
            help="Loads, separated by commas: uniaxial (H11), volumetric (H11 = H22 = H33), shear (H12), pressure (p). "
            "Each may name its goals on either side and its step, as in shear=-0.5:0.5:0.1; with scales those "
            "of the pressure may have a unit, as in pressure=-1 kPa:2 kPa.",
        ),
    ] = _ALL,
    tolerance: Annotated[
        float,
        typer.Option(
            metavar="X",
            help="Width of the interval in which the last solvable state is found; of p a multiple of E.",
        ),
    ] = 0.01,
    workers: options.WorkersOption = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder of data, table and figures.")
    ] = Path("runs/sensitivity"),
    resume: options.ResumeOption = False,
    store: options.StoreOption = None,
    no_store: options.NoStoreOption = False,
) -> None:
    """Study the cell under one load at a time, both signs, as far as it can be solved.

    Follows mean and largest micro displacement gradients and strain energies, conductivity, M, Q and Biot modulus along
    each load, as in the paper's section on numerical tests of the cell. Writes sensitivity.h5, sensitivity.csv and
    a figure for each of the paper's, and prints how far each load could be followed.
    """
    kept = chosen_store(store, no_store)
    _, settings = read_config(config, fem)
    with in_units_of(settings.result_units):
        from porocore.commands.sensitivity.study import study_sensitivity

        check_workers(workers)
        plan = parse_loads(loads, tolerance, settings.scales)
        found = study_sensitivity(
            settings, out, plan, workers=workers, resume=resume, store=kept or False, progress=True
        )
        print_ends(found.study)
    for path in (found.table, *found.pictures.values()):
        typer.echo(path)


def parse_loads(text: str, tolerance: float, scales: Scales | None = None) -> StudyPlan:
    """Return the plan of a text such as ``"uniaxial,shear=-0.5:0.5:0.1"``; omitted goals and steps are the default.

    With ``scales`` goals and step of the pressure may have a unit.

    Raises
    ------
    ConfigurationError
        The text is no such list.
    """
    from porocore.commands.sensitivity.plan import LOADS, StudyPlan

    sweeps = {}
    for part in text.split(","):
        name, _, numbers = (word.strip() for word in part.partition("="))
        if name not in LOADS:
            raise ConfigurationError(
                f"--loads: expected some of {', '.join(LOADS)}, got {echo(name)}{comma_within(text)}"
            )
        if name in sweeps:
            raise ConfigurationError(f"--loads: '{name}' is there twice")
        try:
            sweeps[name] = _sweep(name, part, numbers, scales)
        except ConfigurationError as error:
            raise ConfigurationError(f"{error}{comma_within(text)}") from None
    try:
        return StudyPlan(sweeps, tolerance)
    except ConfigurationError as error:
        raise ConfigurationError(f"--tolerance: {error}") from None


def _sweep(name: str, part: str, numbers: str, scales: Scales | None) -> Sweep:
    """Return the sweep of one load from its goals and step, ``lower:upper`` or ``lower:upper:step``."""
    from porocore.commands.sensitivity.plan import SWEEPS, Sweep, load_quantity
    from porocore.core.units import has_unit

    def read(number: str) -> float:
        with_unit = load_quantity(name) == "pressure" and has_unit(number)
        return parse_pressure(f"--loads {name}", number, scales) if with_unit else float(number)

    default = SWEEPS[name]
    if "=" not in part:
        return default
    try:
        lower, upper, *step = map(read, numbers.split(":"))
        if len(step) > 1:
            raise ValueError
    except ValueError:
        raise ConfigurationError(
            f"--loads: expected goals and a step such as {name}=-0.5:0.5:0.1, got {echo(part.strip())}"
        ) from None
    try:
        return Sweep(lower, upper, step[0] if step else default.step)
    except ConfigurationError as error:
        of_e = " in multiples of the modulus" if load_quantity(name) and scales is not None else ""
        raise ConfigurationError(f"--loads: {name}: {error}{of_e}") from None


def print_ends(study: Sensitivity) -> None:
    """Print how far each load was followed, and why it ends there."""
    from porocore.commands.sensitivity.plan import LOADS
    from porocore.commands.sensitivity.results import line_name
    from porocore.core.inputs import value_text
    from porocore.report.text import MEANINGS
    from porocore.states import Status

    headings = ("load", "first contact", "first unstable", "last solved", "why it ends there")
    table = plain_table(headings, range(1, 4))
    for line in (study.lines[line_name(name, sign)] for name, sign, _ in study.plan.half_lines()):
        row, moved = [f"{line.load} {'+' if line.sign > 0 else '−'}"], LOADS[line.load][0]
        for status in (Status.contact, Status.unstable):
            there = line.values[line.response.status == status]
            row.append(value_text(moved, there[0], 4).translate(MINUS) if len(there) else "–")
        row.append(value_text(moved, line.values[line.response.valid][-1], 4).translate(MINUS))
        end = line.end
        row.append("goal reached" if end is None else f"{end.name.replace('_', ' ')}: {MEANINGS[end]}")
        table.add_row(*row)
    page().print(table)
