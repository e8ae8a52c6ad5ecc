"""``porocore sensitivity``: every response of the cell along one load at a time."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli.common import ConfigArgument, FemOption, check_workers, command, interruptible, read_config
from porocore.core.console import Console
from porocore.core.echo import echo
from porocore.errors import ConfigurationError, RunFolderError

if TYPE_CHECKING:
    from porocore.verification.sensitivity.plan import StudyPlan
    from porocore.verification.sensitivity.results import Sensitivity
    from porocore.verification.sensitivity.study import Progress

MINUS = str.maketrans("-", "−")
_ALL = "uniaxial,volumetric,shear,pressure"


def sensitivity(
    config: ConfigArgument = None,
    fem: FemOption = None,
    loads: Annotated[
        str,
        typer.Option(
            metavar="LIST",
            help="Loads with commas between: uniaxial (H11), volumetric (H11 = H22 = H33), shear (H12), pressure (p); "
            "each may be followed by its goals on either side and its step, as in shear=-0.5:0.5:0.1.",
        ),
    ] = _ALL,
    tolerance: Annotated[
        float,
        typer.Option(
            metavar="X", help="Width of the interval in which the end of what can be solved is found."
        ),
    ] = 0.01,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", help="Processes.", show_default="as configured for sampling"),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Where data, table and figures go.")
    ] = Path("runs/sensitivity"),
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the study that the folder already holds.")
    ] = False,
) -> None:
    """Study the cell under one load at a time, both signs, as far as it can be solved.

    Mean and largest micro displacement gradients and strain energies, conductivity, M, Q and Biot modulus along each
    load, as in the paper's section on numerical tests of the cell. Writes sensitivity.h5, sensitivity.csv and a figure
    for each of the paper's, and prints how far each load could be followed.
    """
    _, settings = read_config(config, fem)
    again = command(
        "sensitivity", config, *(["--fem", fem] if fem else []), "--loads", loads, "--tolerance", tolerance,
        *(["--workers", workers] if workers else []), "--out", out, "--resume",
    )  # fmt: skip
    with interruptible(again):
        from porocore.core.files.atomic import new_folder
        from porocore.core.inputs.possible_states import require_possible
        from porocore.study.preflight.checks import find_backends
        from porocore.verification.sensitivity.figures import write_figures
        from porocore.verification.sensitivity.plan import states_of
        from porocore.verification.sensitivity.study import FILE, run_study
        from porocore.verification.sensitivity.tables import write_table

        check_workers(workers)
        plan = parse_loads(loads, tolerance)
        for name, _, goal in plan.half_lines():
            state = states_of(name, goal)
            require_possible(
                state.grad_u[0], float(state.p[0]), settings.cell.modulus, f"--loads: {name} = {goal:g}"
            )
        if (out / FILE).exists() and not resume:
            raise RunFolderError(
                f"{out} already holds a study; add --resume to continue it, or choose another --out"
            )
        find_backends(settings, ["cell solver"])
        new_folder(out)
        console = Console()
        with console.task("sensitivity", "states") as task:

            def show(progress: Progress) -> None:
                detail = f"{progress.load} {progress.value:g} {progress.status.name.replace('_', ' ')}"
                task.update(progress.done, progress.expected, detail=detail)

            study = run_study(
                settings.cell,
                settings.fem,
                out,
                plan,
                conductivity=settings.conductivity,
                workers=settings.sampling.worker_count() if workers is None else workers,
                on_state=show,
                provenance={"config": settings.resolved_yaml()},
            )
        table = write_table(out, study)
        console.note("drawing")
        pictures = write_figures(out, study)
    print_ends(study)
    typer.echo(table)
    for picture in pictures.values():
        typer.echo(picture)


def parse_loads(text: str, tolerance: float) -> StudyPlan:
    """``"uniaxial,shear=-0.5:0.5:0.1"`` → a plan; what is not given is as by default.

    Raises
    ------
    ConfigurationError
        It is something else.
    """
    from porocore.verification.sensitivity.plan import LOADS, SWEEPS, StudyPlan, Sweep

    sweeps = {}
    for part in text.split(","):
        name, given, numbers = (word.strip() for word in part.partition("="))
        if name not in LOADS:
            raise ConfigurationError(f"--loads: expected some of {', '.join(LOADS)}, got {echo(name)}")
        if name in sweeps:
            raise ConfigurationError(f"--loads: '{name}' is there twice")
        sweep = SWEEPS[name]
        if given:
            try:
                values = [float(number) for number in numbers.split(":")]
                lower, upper, step = (*values, sweep.step)[:3] if len(values) in (2, 3) else values
            except ValueError:
                raise ConfigurationError(
                    f"--loads: expected goals and a step such as {name}=-0.5:0.5:0.1, got {echo(part.strip())}"
                ) from None
            try:
                sweep = Sweep(lower, upper, step)
            except ConfigurationError as error:
                raise ConfigurationError(f"--loads: {name}: {error}") from None
        sweeps[name] = sweep
    try:
        return StudyPlan(sweeps, tolerance)
    except ConfigurationError as error:
        raise ConfigurationError(f"--tolerance: {error}") from None


def print_ends(study: Sensitivity) -> None:
    """How far each load was followed, and why no farther."""
    from rich.console import Console as RichConsole
    from rich.table import Table

    from porocore.report.text import MEANINGS
    from porocore.states import Status
    from porocore.verification.sensitivity.results import line_name

    shown = RichConsole(width=None if sys.stdout.isatty() else 130, highlight=False)
    table = Table(box=None, pad_edge=False, header_style="bold")
    table.add_column("load")
    for heading in ("first contact", "first unstable", "last solved"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("why it ends there")
    for line in (study.lines[line_name(name, sign)] for name, sign, _ in study.plan.half_lines()):
        row = [f"{line.load} {'+' if line.sign > 0 else '−'}"]
        for status in (Status.contact, Status.unstable):
            there = line.values[line.response.status == status]
            row.append(f"{there[0]:.4g}".translate(MINUS) if len(there) else "–")
        row.append(f"{line.values[line.response.valid][-1]:.4g}".translate(MINUS))
        end = line.end
        row.append("goal reached" if end is None else f"{end.name.replace('_', ' ')}: {MEANINGS[end]}")
        table.add_row(*row)
    shown.print(table)
