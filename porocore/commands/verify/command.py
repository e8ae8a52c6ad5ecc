"""``porocore verify``: cases with known answers."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from porocore.cli.common import failed, interruptible, page, plain_table
from porocore.cli.options import SeveralFemOption
from porocore.core.console import Console

if TYPE_CHECKING:
    from porocore.commands.verify.case import Check
    from porocore.commands.verify.cases import CaseResult

#: Columns of the table where standard output is no terminal.
WIDTH = 150


def verify(
    fem: SeveralFemOption = None,
    case: Annotated[
        list[str] | None, typer.Option("--case", metavar="NAME", help="Only this case. Repeatable.")
    ] = None,
    long: Annotated[
        bool,
        typer.Option(
            "--long", help="Use finer meshes and shorter steps; takes some minutes instead of one or two."
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FILE", help="Write the results as JSON, too; missing folders are made."
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of the table.")] = False,
) -> None:
    """Solve cases with known answers and print the errors of porocore.

    The cases are permeabilities of published packings, identities of the cell, linear consolidation, consolidation at
    large strain, and laws with a memory. Exit status 1 when an error is too large or a backend fails;
    docs/verification.md has the sources.
    """
    with interruptible():
        from porocore.commands.verify.cases import document, run_cases, select_cases, select_solvers
        from porocore.core.files.atomic import place_for
        from porocore.core.files.plain_data import write_json

        cases, backends = select_cases(case or ()), select_solvers(fem or ())
        if out is not None:
            place_for(out)
        console = Console()
        for text in backends.absent:
            console.note(f"takes no part: {text}")
        with console.task("verifying", "items") as task:
            rows = run_cases(
                cases,
                backends,
                long=long,
                on_item=lambda what, done, count: task.update(done, count, detail=what),
            )
    found = document(rows, long=long)
    if out is not None:
        write_json(out, found, indent=1, ensure_ascii=False)
    if as_json:
        typer.echo(json.dumps(found, indent=1, ensure_ascii=False))
    else:
        _print(rows)
    if wrong := [row for row in rows if not row.passed]:
        failed(f"{len(wrong)} of {len(rows)} checks; the first: {wrong[0].describe()}")


def _print(rows: Sequence[CaseResult]) -> None:
    from rich.text import Text

    from porocore.commands.verify.cases import CASES

    shown = page(WIDTH)
    headings = ("case", "", "backend", "quantity", "reference", "ours", "error", "allowed", "order", "")
    table = plain_table(headings, range(4, 10))
    for row in rows:
        verdict = "[green]pass[/green]" if row.passed else "[red]FAIL[/red]"
        absent: tuple[Any, ...] = (Text(row.reason), *["–"] * 5)
        cells = absent if row.check is None else _cells(row.check)
        table.add_row(row.case, row.item, row.backend, *cells, verdict)
    shown.print(table)
    for name in dict.fromkeys(row.case for row in rows if row.case):
        shown.print(Text(f"{name}: {CASES[name].source}"))
    notes = {row.check.note: row for row in rows if row.check is not None and row.check.note}
    for note, row in notes.items():
        shown.print(Text(f"{row.case}, {row.item}: {note}"))


def _cells(check: Check) -> tuple[Any, ...]:
    from rich.text import Text

    return (
        Text(check.quantity),
        _value(check.reference),
        _value(check.ours),
        f"{check.error:.1e}",
        f"{check.allowed:.1e}",
        "–" if check.order is None else f"{check.order:.1f}",
    )


def _value(value: float | None) -> str:
    return "–" if value is None else f"{value:.5g}"
