"""``porocore crosscheck``: every installed backend on one case, compared with the others."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from porocore.cli.common import failed, interruptible, page, plain_table, read_config
from porocore.cli.options import SeveralFemOption
from porocore.core.console import Console
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from porocore.commands.crosscheck.check import CrossCheck


def crosscheck(
    config: Annotated[
        Path | None,
        typer.Argument(metavar="CONFIG", help="Configuration (YAML).", show_default="a small packaged case"),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder of crosscheck.json and crosscheck.html.")
    ] = Path("runs/crosscheck"),
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the content of crosscheck.json instead of the table.")
    ] = False,
    fem: SeveralFemOption = None,
    surrogate: Annotated[
        list[str] | None,
        typer.Option("--surrogate", metavar="NAME", help="Only this surrogate. Repeatable."),
    ] = None,
    what: Annotated[
        Literal["backends", "relaxation"],
        typer.Option(
            "--what",
            help="relaxation: compare the law of a solid that relaxes with a cell that knows its history.",
        ),
    ] = "backends",
    path: Annotated[
        list[Path] | None,
        typer.Option(
            "--path",
            metavar="FILE",
            help="With --what relaxation: CSV table of a path, columns time and some of H11 … H33, p. Repeatable.",
            show_default="some ramps and holds",
        ),
    ] = None,
) -> None:
    """Run every pair of finite-element backend and surrogate on one case and compare the results.

    Compares averages, derivatives and conductivity of the cell, predictions of the surrogates, and histories of the
    body under its first load. Exit status 1 when a difference exceeds its tolerance or a backend fails. With
    --what relaxation the law of a solid that relaxes is compared with the cell instead, along paths.
    """
    from porocore.study.config.loading import crosscheck_path

    if what != "relaxation" and path:
        raise ConfigurationError("--path: expected with --what relaxation only; leave it out")
    if what == "relaxation" and surrogate:
        raise ConfigurationError("--surrogate: no surrogate takes part with --what relaxation; leave it out")
    _, settings = read_config(crosscheck_path() if config is None else config, None)
    with interruptible():
        from porocore.commands.crosscheck.check import crosscheck as check
        from porocore.commands.crosscheck.check import crosscheck_relaxation
        from porocore.commands.crosscheck.comparison import select_backends
        from porocore.commands.crosscheck.page import write
        from porocore.commands.crosscheck.relaxation import read_path, select_cell_solvers
        from porocore.core.files.atomic import new_folder

        console = Console()
        if what == "relaxation":
            names, paths = select_cell_solvers(settings, fem or ()), [read_path(file) for file in path or ()]
            new_folder(out)
            result = crosscheck_relaxation(settings, names, paths, console=console)
        else:
            who = select_backends(fem or (), surrogate or ())
            new_folder(out)
            for text in who.absent:
                console.note(f"takes no part: {text}")
            result = check(settings, who, console=console)
        document, page = write(out, result)
    if as_json:
        typer.echo(document.read_text(encoding="utf-8"), nl=False)
    else:
        _print(result)
        typer.echo(page)
    if not result.passed:
        count = f"{len(result.failed)} of {len(result.comparisons)} comparisons"
        failed(f"{count}; the worst: {result.worst.describe()}")


def _print(result: CrossCheck) -> None:
    from rich.text import Text

    from porocore.commands.crosscheck.page import PARTS

    table = plain_table(("", "quantity", "at", "who", "difference", "tolerance", ""), range(4, 7))
    part = None
    for line in result.comparisons:
        title = PARTS[line.part][0] if line.part != part else ""
        part = line.part
        numbers = ("–", "–") if line.reason else (f"{line.difference:.1e}", f"{line.tolerance:.0e}")
        verdict = "[green]pass[/green]" if line.passed else "[red]FAIL[/red]"
        verdict = "[dim]skipped[/dim]" if line.skipped else verdict
        table.add_row(title, Text(line.quantity), Text(line.case), Text(line.pair), *numbers, verdict)
    page().print(table)
    for line in result.comparisons:
        if line.reason and (line.skipped or not line.passed):
            typer.echo(line.describe())
