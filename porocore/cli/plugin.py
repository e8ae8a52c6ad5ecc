"""``porocore plugin``: for those who write plugins; a project to start from, and the laws that it is held to."""

from __future__ import annotations

import json
import shlex
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli.common import command, interruptible
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from porocore.discovery import Offered
    from porocore.hookspecs import Kind
    from porocore.plugin_check import Law

plugin = typer.Typer(
    help="Write a plugin: a project to start from, and the laws that it is held to.", no_args_is_help=True
)
#: By what a user types.
KINDS: dict[str, Kind] = {
    "cell": "cell solver",
    "macro": "macro solver",
    "surrogate": "surrogate",
    "sampler": "sampler",
}
COLOURS = {"passed": "green", "failed": "bold red", "expected failure": "yellow", "skipped": "dim"}


def _kind(text: str) -> Kind:
    if text not in KINDS:
        raise ConfigurationError(f"--kind: expected {', '.join(KINDS)}, got '{text}'")
    return KINDS[text]


@plugin.command()
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="What users will write, such as my-sampler.")],
    kind: Annotated[str, typer.Option("--kind", metavar="KIND", help="cell, macro, surrogate or sampler.")],
    to: Annotated[
        Path | None,
        typer.Option("--to", metavar="DIR", help="The new folder.", show_default="porocore-KIND-NAME"),
    ] = None,
) -> None:
    """Write a complete project: it can be installed, works, and passes its tests.

    Prints the path of the folder. Nothing that is there already is overwritten.
    """
    from porocore.scaffold.project import write_project

    _kind(kind)
    folder = write_project(name, kind, to)
    typer.echo(folder)
    # The laws are run by pytest, which the extra brings.
    install = shlex.join(["pip", "install", "-e", f"{folder}[test]"])
    typer.secho(f"next: {install}, then {command('plugin', 'check', name, '--kind', kind)}", err=True)


@plugin.command()
def check(
    name: Annotated[str, typer.Argument(metavar="NAME", help="As 'porocore plugins' lists it.")],
    kind: Annotated[
        str | None,
        typer.Option(
            "--kind",
            metavar="KIND",
            help="cell, macro, surrogate or sampler.",
            show_default="all of the name",
        ),
    ] = None,
    only: Annotated[
        str,
        typer.Option("--only", metavar="LAW", help="One law, by its name or in words.", show_default="all"),
    ] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Every law with its outcome, as JSON.")] = False,
) -> None:
    """Hold an installed plugin to the laws of its interface.

    Exit status 1 if it breaks one that it does not list among its expected failures.
    """
    from porocore.plugin_check import UnknownLaw, offers_of

    laws: list[Law] = []
    unknown: UnknownLaw | None = None
    with interruptible():
        for offered in offers_of(name, None if kind is None else _kind(kind)):
            try:
                laws += _check(offered, only)
            except UnknownLaw as error:  # of a cell solver, perhaps, when the macro solver has it
                unknown = error
    if unknown is not None and not laws:
        raise unknown
    if as_json:
        from porocore.testing import KIT_VERSION

        document = {"plugin": name, "kit_version": KIT_VERSION, "laws": [asdict(law) for law in laws]}
        typer.echo(json.dumps(document, indent=2, ensure_ascii=False))
    else:
        _show(laws)
    if any(law.result == "failed" for law in laws):
        raise typer.Exit(1)


def _check(offered: Offered, only: str) -> list[Law]:
    """Hold one offer to its laws, and show how far that is."""
    from porocore.console import Console
    from porocore.plugin_check import check_plugin

    title = f"checking {offered.kind} '{offered.offer.name}' of {offered.source}"
    with Console().task(title, "laws") as task:
        done = failed = 0

        def begin(law: str, total: int) -> None:
            task.update(done, total, failed=failed, detail=law)

        def end(law: Law, total: int) -> None:
            nonlocal done, failed
            done, failed = done + 1, failed + (law.result == "failed")
            task.update(done, total, failed=failed)

        return check_plugin(offered, end, only=only, on_start=begin)


def _show(laws: list[Law]) -> None:
    """One table for each suite, and a line that counts."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(highlight=False)
    for kind, suite in dict.fromkeys((law.kind, law.suite) for law in laws):
        table = Table(title=f"{kind}: {suite}", title_justify="left", expand=False)
        for column in ("law", "result", "reason"):
            table.add_column(column, overflow="fold", no_wrap=column == "result")
        for law in laws:
            if (law.kind, law.suite) == (kind, suite):
                table.add_row(Text(law.words), Text(law.result, style=COLOURS[law.result]), Text(law.reason))
        console.print(table)
    counts = {
        result: sum(law.result == result for law in laws)
        for result in ("passed", "failed", "expected failure", "skipped")
    }
    words = [f"{count} {result}" for result, count in counts.items() if count]
    console.print(f"{len(laws)} {'law' if len(laws) == 1 else 'laws'}: {', '.join(words)}")
