"""``porocore plugins`` and ``porocore plugin``: list of plugins, new project, check by the kit."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from porocore.cli.common import command, interruptible, shell_line
from porocore.cli.parsing import command_group
from porocore.errors import PluginError
from porocore.plugins.kinds import Kind, kind_of

if TYPE_CHECKING:
    from porocore.plugins.table import PluginRow
    from porocore.testing.plugin_check import CheckResult

plugin = command_group(
    "Write a project for a plugin, or check a plugin by the conformance kit.", no_args_is_help=True
)
COLOURS = {"passed": "green", "failed": "bold red", "expected failure": "yellow", "skipped": "dim"}


@plugin.command()
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name in configurations, such as my-sampler.")],
    kind: Annotated[
        str, typer.Option("--kind", metavar="KIND", help="cell, macro, surrogate, sampler or command.")
    ],
    to: Annotated[
        Path | None,
        typer.Option("--to", metavar="DIR", help="The new folder.", show_default="porocore-KIND-NAME"),
    ] = None,
) -> None:
    """Write a complete project, which can be installed and passes its tests.

    Prints the path of the folder. Nothing is overwritten.
    """
    from porocore.plugins.scaffold.project import write_project

    folder = write_project(name, kind, to)
    typer.echo(folder)
    # The checks are run by pytest, which the extra brings.
    install = shell_line(["pip", "install", "-e", f"{folder}[test]"])
    typer.secho(f"next: {install}, then {command('plugin', 'check', name, '--kind', kind)}", err=True)


@plugin.command()
def check(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name in the list of 'porocore plugins'.")],
    kind: Annotated[
        str | None,
        typer.Option(
            "--kind",
            metavar="KIND",
            help="cell, macro, surrogate, sampler or command.",
            show_default="all of the name",
        ),
    ] = None,
    only: Annotated[
        str,
        typer.Option(
            "--only",
            metavar="CHECK",
            help="Only this check, by its name or its sentence.",
            show_default="all",
        ),
    ] = "",
    as_json: Annotated[
        bool, typer.Option("--json", help="Print every check with its outcome as JSON.")
    ] = False,
) -> None:
    """Check an installed plugin by the conformance kit.

    Exit status 1 if it fails a check that it does not list among its expected failures.
    """
    from porocore.core.console import Console
    from porocore.testing.plugin_check import UnknownCheck, check_plugin, find_offers

    results: list[CheckResult] = []
    unknown: UnknownCheck | None = None
    with interruptible():
        for offered in find_offers(name, None if kind is None else kind_of(kind)):
            title = f"checking {offered.kind} '{offered.offer.name}' of {offered.source}"
            try:
                with Console().task(title, "checks") as task:
                    results += check_plugin(offered, task, only)
            except UnknownCheck as error:  # another kind of the same name may have this check
                unknown = error
    if unknown is not None and not results:
        raise unknown
    if as_json:
        from porocore.testing import KIT_VERSION

        document = {"plugin": name, "kit_version": KIT_VERSION, "laws": [asdict(each) for each in results]}
        typer.echo(json.dumps(document, indent=2, ensure_ascii=False))
    else:
        _show(results)
    if any(each.result == "failed" for each in results):
        raise typer.Exit(1)


def _show(results: list[CheckResult]) -> None:
    """Print a table for each suite, and the counts."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(highlight=False)
    for kind, suite in dict.fromkeys((each.kind, each.suite) for each in results):
        table = Table(title=f"{kind}: {suite}", title_justify="left", expand=False)
        for column in ("check", "result", "reason"):
            table.add_column(column, overflow="fold", no_wrap=column == "result")
        for each in results:
            if (each.kind, each.suite) == (kind, suite):
                table.add_row(
                    Text(each.text), Text(each.result, style=COLOURS[each.result]), Text(each.reason)
                )
        console.print(table)
    counts = {result: sum(each.result == result for each in results) for result in COLOURS}
    words = [f"{count} {result}" for result, count in counts.items() if count]
    console.print(f"{len(results)} {'check' if len(results) == 1 else 'checks'}: {', '.join(words)}")


def plugins(
    as_json: Annotated[bool, typer.Option("--json", help="Print everything that is known, as JSON.")] = False,
    load: Annotated[
        bool, typer.Option("--load", help="Import each implementation, which takes a while.")
    ] = False,
) -> None:
    """List the backends, their state, and how to repair those that are missing or broken."""
    from porocore.plugins.registry import plugins_table

    rows = [_loaded(row) if load else row for row in plugins_table()]
    if as_json:
        typer.echo(json.dumps([_document(row) for row in rows], indent=2, ensure_ascii=False))
        return
    header = ("kind", "name", "state", "from")
    cells = [(row.kind or "plugin", row.name, row.state, row.distribution) for row in rows]
    widths = [max(len(line[i]) for line in (header, *cells)) for i in range(len(header))]
    typer.secho("  ".join(text.ljust(width) for text, width in zip(header, widths, strict=True)), bold=True)
    colours = {"ready": typer.colors.GREEN, "not installed": typer.colors.YELLOW}
    told: set[str] = set()
    for row, line in zip(rows, cells, strict=True):
        padded = [text.ljust(width) for text, width in zip(line, widths, strict=True)]
        padded[2] = typer.style(padded[2], fg=colours.get(row.state, typer.colors.RED))
        typer.echo("  ".join([*padded, one_line(row.summary)]).rstrip())
        # What holds for the module of an entry point is said once, not for each of its offers.
        for text in (row.advice, *(note for note in row.notes if note not in told)):
            if text:
                typer.echo(f"{'':{widths[0]}}  {one_line(text)}")
        told.update(row.notes)


def one_line(text: str) -> str:
    """Return a foreign text as one line; letters that do not print become spaces."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


def _loaded(row: PluginRow) -> PluginRow:
    """Return the row after importing the class, and its suites if pytest is installed."""
    from porocore.plugins.registry import get

    if row.state != "ready" or not row.kind:
        return row
    try:
        implementation = get(row.kind, row.name)
    except PluginError as error:
        return replace(row, state="broken", advice=str(error))
    return replace(row, notes=(*row.notes, *_suite_faults(row.kind, row.name, implementation)))


def _suite_faults(kind: Kind, name: str, implementation: type[Any]) -> list[str]:
    """Return the faults of the suites of ``porocore plugin check``; none without pytest."""
    from porocore.plugins.foreign_code import attempt, file_of, place_of, reason_of
    from porocore.plugins.registry import registry

    if find_spec("pytest") is None:
        return []
    from porocore.plugins.table import complaint
    from porocore.testing.plugin_process import find_suites

    offered = registry().find(kind, name)
    found = attempt(find_suites, kind, offered.offer, implementation)
    if found.error is not None:
        module = getattr(offered.offer.suites, "__module__", None) or ""
        place = place_of(found.error.__cause__ or found.error, module) or offered.source.file
        return [f"{reason_of(found.error)} ({place})"]
    return [
        f"{suite.__name__} {text} ({file_of(suite.__module__)})"
        for suite in found.value
        if (text := complaint(suite.kit_version))
    ]


def _document(row: PluginRow) -> dict[str, Any]:
    source = row.source
    return {
        "kind": row.kind or None,
        "name": row.name,
        "distribution": source.distribution if source else row.distribution,
        "version": source.version if source else None,
        "entry_point": source.entry_point if source else None,
        "interface": row.interface,
        "summary": row.summary,
        "requirements": list(source.requirements) if source else [],
        "modules": list(row.modules),
        "file": source.file if source else None,
        "seconds": round(source.seconds, 4) if source else None,
        "state": row.state,
        "works": row.state == "ready",
        "advice": row.advice or None,
        "notes": list(row.notes),
    }
