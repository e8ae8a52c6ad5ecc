"""``porocore stability``: map of creases, contact and instability of the cell; tables of its onsets."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli import options
from porocore.cli.common import (
    check_workers,
    chosen_store,
    decimals,
    in_units_of,
    page,
    parse_inputs,
    parse_pressure,
    plain_table,
    read_config,
)
from porocore.core.echo import echo
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from porocore.cell.stability.map import MapPlan, StabilityLine
    from porocore.core.units import Scales


def stability(
    config: options.ConfigArgument = None,
    fem: options.FemOption = None,
    along: Annotated[
        str,
        typer.Option(
            metavar="NAME=GOAL", help="Inputs that run from zero to a goal on each line, separated by commas."
        ),
    ] = "H22=-0.36",
    across: Annotated[
        str, typer.Option(metavar="NAME=LIST", help="Input that has one value on each line.")
    ] = "p=0,0.05,0.1,0.15,0.2",
    steps: Annotated[int, typer.Option(metavar="N", help="Equal steps of each line.")] = 12,
    tolerance: Annotated[
        float,
        typer.Option(
            metavar="X", help="Width of the interval in which an onset is found; of p a multiple of E."
        ),
    ] = 0.005,
    eigenvalues: Annotated[
        bool,
        typer.Option(
            "--eigenvalues", help="Compute the lowest eigenvalue of each wave vector at every state."
        ),
    ] = False,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder of tables and figure.")] = Path(
        "runs/stability"
    ),
    workers: options.WorkersOption = None,
    resume: options.ResumeOption = False,
    store: options.StoreOption = None,
    no_store: options.NoStoreOption = False,
) -> None:
    """Map where the cell creases and touches itself, and where it becomes unstable.

    Inputs are H11, H22, H33 and p. Along each line every state is solved on the eighth of the cell and examined for
    modes of all wave vectors with components 0 and π (periods one and two), and for loss of rank-one convexity of W.
    Every onset is bisected. Writes stability.h5, states.csv, onsets.csv and stability.png, and prints the onsets.
    """
    kept = chosen_store(store, no_store)
    _, settings = read_config(config, fem)
    with in_units_of(settings.result_units):
        from porocore.commands.stability.study import map_stability

        check_workers(workers)
        plan = parse_plan(along, across, steps, tolerance, eigenvalues, settings.scales)
        found = map_stability(
            settings, out, plan, workers=workers, resume=resume, store=kept or False, progress=True
        )
        if len(found.lines) == 1:
            print_states(plan, found.lines[0])
        print_onsets(plan, found.lines)
    typer.echo(found.picture)


def parse_plan(
    along: str,
    across: str,
    steps: int,
    tolerance: float,
    eigenvalues: bool,
    scales: Scales | None = None,
) -> MapPlan:
    """Return the map that the options ask for.

    Raises
    ------
    ConfigurationError
        An option is wrong; the message names it.
    """
    from porocore.cell.stability.map import LineSettings, MapPlan
    from porocore.core.units import has_unit

    try:
        line = LineSettings(steps, tolerance, eigenvalues)
    except ConfigurationError as error:
        raise ConfigurationError(f"--{error}") from None
    goal = parse_inputs("--along", "goals of inputs such as H22=-0.36, with commas between", along, scales)
    name, _, values = across.partition("=")
    try:
        numbers = tuple(
            parse_pressure("--across", value, scales)
            if name.strip() == "p" and has_unit(value)
            else _finite(value)
            for value in values.split(",")
        )
    except ValueError:
        raise ConfigurationError(
            f"--across: expected an input and its values such as p=0,0.1, got {echo(across)}"
        ) from None
    return MapPlan(goal, name.strip(), numbers, line)


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def print_states(plan: MapPlan, line: StabilityLine) -> None:
    """Print the states of a line."""
    from porocore.cell.stability.map import eigenvalue_titled, input_factor, input_titled
    from porocore.cell.stability.modes import FAMILIES, WAVES
    from porocore.core.inputs import NAMES
    from porocore.core.units import units_now
    from porocore.states import Status

    asked = any(math.isfinite(x) for x in line.eigenvalues.ravel())
    title, factor, stress = (
        input_titled(plan.leading),
        input_factor(plan.leading),
        units_now().factor("stress"),
    )
    headings = [
        title,
        "status",
        "contact",
        "gap",
        *(f"modes {name}" for name in FAMILIES),
        units_now().titled("acoustic", "stress"),
    ]
    headings += [eigenvalue_titled(f"λ {name}") for name in FAMILIES] if asked else []
    table = plain_table(headings, range(len(headings)))
    columns = [[WAVES.index(wave) for wave in waves] for waves in FAMILIES.values()]
    for k, theta in enumerate(line.states()):
        counts = [line.pivots[k, c] for c in columns]
        row = [
            decimals(theta[NAMES.index(plan.leading)] * factor, 4),
            Status(int(line.status[k])).name.replace("_", " "),
        ]
        row += [f"{100 * line.contact_share[k]:.2f} %", decimals(line.min_gap[k], 3)]
        row += ["?" if (count < 0).any() else str(count.sum()) for count in counts]
        row.append(decimals(line.acoustic[k] * stress, 4))
        row += [decimals(line.eigenvalues[k, c].min() * stress, 3) for c in columns] if asked else []
        table.add_row(*row)
    page().print(table)


def print_onsets(plan: MapPlan, lines: Sequence[StabilityLine]) -> None:
    """Print the onsets of every line."""
    from porocore.cell.stability.map import input_factor, input_titled
    from porocore.cell.stability.modes import FAMILIES
    from porocore.core.inputs import NAMES
    from porocore.states import Status

    leading, across = NAMES.index(plan.leading), NAMES.index(plan.across)
    begins, title = input_titled(plan.leading), input_titled(plan.across)
    factor, of_line = input_factor(plan.leading), input_factor(plan.across)
    headings = [title, "crease", *(f"mode {name}" for name in FAMILIES), "acoustic"]
    headings += ["line ends at", "with status"]
    heading = f"{begins} at which it begins, ± {plan.line.tolerance / 2 * factor:.4g}"
    table = plain_table(headings, range(len(headings)), heading)
    for line in lines:
        found = [line.onset(*events)[leading] for events in (("crease",), *FAMILIES.values(), ("acoustic",))]
        row = [decimals(line.start[across] * of_line, 4)]
        row += [decimals(x * factor, 4) for x in (*found, line.states()[-1][leading])]
        table.add_row(*row, Status(int(line.status[-1])).name.replace("_", " "))
    page().print(table)
