"""``porocore stability``: where the cell leaves the state that is solved for."""

from __future__ import annotations

import hashlib
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from porocore.cli.common import (
    ConfigArgument,
    FemOption,
    command,
    interruptible,
    parse_inputs,
    read_config,
)
from porocore.core.console import Console
from porocore.core.echo import echo
from porocore.errors import ConfigurationError, RunFolderError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from porocore.cell.stability.line import StabilityLine
    from porocore.cell.stability.map import MapPlan

#: Columns of the tables where standard output is no terminal.
WIDTH = 130
MINUS = str.maketrans("-", "−")


def stability(
    config: ConfigArgument = None,
    fem: FemOption = None,
    along: Annotated[
        str,
        typer.Option(
            metavar="NAME=GOAL", help="Inputs that run from zero to a goal on each line, with commas between."
        ),
    ] = "H22=-0.36",
    across: Annotated[
        str, typer.Option(metavar="NAME=LIST", help="The input that has one value on each line.")
    ] = "p=0,0.05,0.1,0.15,0.2",
    steps: Annotated[int, typer.Option(metavar="N", help="Equal steps of each line.")] = 12,
    tolerance: Annotated[
        float, typer.Option(metavar="X", help="Width of the interval in which an onset is found.")
    ] = 0.005,
    eigenvalues: Annotated[
        bool,
        typer.Option("--eigenvalues", help="The lowest eigenvalue of each wave vector at every state, too."),
    ] = False,
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Where tables and figure go.")] = Path(
        "runs/stability"
    ),
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the map that the folder already holds.")
    ] = False,
) -> None:
    """Map where the cell creases and touches itself, and where it becomes unstable.

    Inputs are H11, H22, H33 and p. Along each line every state is solved on the eighth of the cell and examined for
    modes of all wave vectors with components 0 and π (periods one and two), and for loss of rank-one convexity of W;
    every onset is bisected. Writes stability.h5, states.csv, onsets.csv and stability.png, and prints the onsets.
    """
    _, settings = read_config(config, fem)
    with interruptible(_again(config, fem, along, across, steps, tolerance, eigenvalues, out)):
        from porocore.cell.equilibrium.solver import EquilibriumCellSolver
        from porocore.cell.stability.line import LineSettings
        from porocore.cell.stability.map import MapPlan, map_stability, write_tables
        from porocore.core.files.atomic import new_folder
        from porocore.core.inputs.input_space import NAMES
        from porocore.core.inputs.possible_states import require_possible
        from porocore.core.models.bounds import MOST_LINES, MOST_POINTS, SMALLEST_INTERVAL
        from porocore.report.figures.stability import stability_figure
        from porocore.report.figures.style import png_bytes
        from porocore.study.preflight.checks import find_backends
        from porocore.study.stages.stage_files import prepare_cell

        if not 1 <= steps <= MOST_POINTS:
            raise ConfigurationError(f"--steps: expected 1 to {MOST_POINTS}, got {echo(steps)}")
        if not SMALLEST_INTERVAL <= tolerance < math.inf:
            raise ConfigurationError(
                f"--tolerance: expected at least {SMALLEST_INTERVAL:g}, got {tolerance:g}"
            )
        goal = parse_along(along)
        name, values = parse_across(across)
        if len(values) > MOST_LINES:
            raise ConfigurationError(f"--across: {len(values)} lines; at most {MOST_LINES} are followed")
        plan = MapPlan(goal, name, values, LineSettings(steps, tolerance, eigenvalues))
        for value in values:
            state = {**goal, name: value}
            row = [state.get(each, 0.0) for each in NAMES]
            require_possible(
                row[:9], row[9], settings.cell.modulus, f"--along and --across: {name} = {value:g}"
            )
        table = out / "stability.h5"
        if table.exists() and not resume:
            raise RunFolderError(
                f"{out} already holds a map; add --resume to continue it, or choose another --out"
            )
        find_backends(settings, ["cell solver"])
        new_folder(out)
        console = Console()
        solver, prepared = prepare_cell(settings.fem.backend, settings.fem.options, settings.cell)
        if not isinstance(solver, EquilibriumCellSolver):
            raise ConfigurationError(
                f"--fem: backend '{settings.fem.backend}' gives no access to the tangent of its cell; "
                "choose one that does, such as skfem"
            )
        identity = hashlib.sha256(json.dumps([settings.stages.cell, plan.describe()]).encode()).hexdigest()[
            :16
        ]
        provenance = {"config": settings.resolved_yaml(), "plan": json.dumps(plan.describe())}
        with console.task("stability", "states") as task:
            total, done = len(plan.values) * (steps + 1), [0, 0]

            def show(line: int, text: str) -> None:
                if line != done[0]:
                    done[:] = [line, 0]
                done[1] += not text.startswith("onset")
                task.update(
                    min(total, line * (steps + 1) + done[1]),
                    total,
                    detail=f"{name} = {values[line]:g}, {text}",
                )

            lines = map_stability(solver, prepared, plan, table, identity, provenance, show)
        write_tables(out, plan, lines)
        picture = out / "stability.png"
        from porocore.core.files.atomic import atomic_path

        with atomic_path(picture) as part:
            part.write_bytes(png_bytes(stability_figure(plan, lines)))
    print_tables(plan, lines)
    typer.echo(picture)


def parse_along(text: str) -> dict[str, float]:
    """``"H22=-0.36,H11=0.1"`` → goals by input.

    Raises
    ------
    ConfigurationError
        It is something else.
    """
    return parse_inputs("--along", "goals of inputs such as H22=-0.36, with commas between", text)


def parse_across(text: str) -> tuple[str, tuple[float, ...]]:
    """``"p=0,0.1"`` → the input and its values.

    Raises
    ------
    ConfigurationError
        It is something else.
    """
    name, _, values = text.partition("=")
    try:
        return name.strip(), tuple(_finite(value) for value in values.split(","))
    except ValueError:
        raise ConfigurationError(
            f"--across: expected an input and its values such as p=0,0.1, got {echo(text)}"
        ) from None


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def _again(
    config: Path | None,
    fem: str | None,
    along: str,
    across: str,
    steps: int,
    tolerance: float,
    eigenvalues: bool,
    out: Path,
) -> str:
    words: list[Any] = ["stability", config, *(["--fem", fem] if fem else [])]
    words += ["--along", along, "--across", across, "--steps", steps, "--tolerance", tolerance]
    return command(*words, *(["--eigenvalues"] if eigenvalues else []), "--out", out, "--resume")


def print_tables(plan: MapPlan, lines: Sequence[StabilityLine]) -> None:
    """Onsets of every line; for a single line its states, too."""
    from rich.console import Console as RichConsole
    from rich.table import Table

    from porocore.cell.stability.inertia import FAMILIES, WAVES
    from porocore.core.inputs.input_space import NAMES
    from porocore.states import Status

    shown = RichConsole(width=None if sys.stdout.isatty() else WIDTH, highlight=False)
    leading, across = NAMES.index(plan.leading), NAMES.index(plan.across)

    def table(title: str, headings: Sequence[str]) -> Table:
        made = Table(
            title=title, title_justify="left", title_style="", box=None, pad_edge=False, header_style="bold"
        )
        for heading in headings:
            made.add_column(heading, justify="right", no_wrap=True)
        return made

    if len(lines) == 1:
        line = lines[0]
        asked = any(math.isfinite(x) for x in line.eigenvalues.ravel())
        headings = [
            plan.leading,
            "status",
            "contact",
            "gap",
            *(f"modes {name}" for name in FAMILIES),
            "acoustic",
        ]
        states = table("", [*headings, *((f"λ {name}" for name in FAMILIES) if asked else ())])
        for k, theta in enumerate(line.states()):
            columns = [[WAVES.index(wave) for wave in waves] for waves in FAMILIES.values()]
            counts = [line.pivots[k, c] for c in columns]
            row = [_number(theta[leading], 4), Status(int(line.status[k])).name.replace("_", " ")]
            row += [f"{100 * line.contact_share[k]:.2f} %", _number(line.min_gap[k], 3)]
            row += ["?" if (count < 0).any() else str(count.sum()) for count in counts]
            row.append(_number(line.acoustic[k], 4))
            row += [_number(line.eigenvalues[k, c].min(), 3) for c in columns] if asked else []
            states.add_row(*row)
        shown.print(states)
    onsets = table(
        f"{plan.leading} at which it begins, ± {plan.line.tolerance / 2:g}",
        [
            plan.across,
            "crease",
            *(f"mode {name}" for name in FAMILIES),
            "acoustic",
            "line ends at",
            "with status",
        ],
    )
    for line in lines:
        begins = [line.onset(*events)[leading] for events in (("crease",), *FAMILIES.values(), ("acoustic",))]
        row = [_number(line.start[across], 4), *(_number(begin, 4) for begin in begins)]
        last = Status(int(line.status[-1])).name.replace("_", " ")
        onsets.add_row(*row, _number(line.states()[-1][leading], 4), last)
    shown.print(onsets)


def _number(value: float, digits: int) -> str:
    return "–" if not math.isfinite(value) else f"{value + 0.0:.{digits}f}".translate(MINUS)
