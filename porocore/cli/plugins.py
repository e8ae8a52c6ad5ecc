"""``porocore plugins``: what is installed, what is not, and what to do about it."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated, Any

import typer

from porocore.errors import PluginError

if TYPE_CHECKING:
    from porocore.hookspecs import Kind
    from porocore.plugin_table import PluginRow


def plugins(
    as_json: Annotated[bool, typer.Option("--json", help="Everything that is known, as JSON.")] = False,
    load: Annotated[
        bool, typer.Option("--load", help="Import each implementation too, which takes a while.")
    ] = False,
) -> None:
    """List the backends, their state, and how to mend what is missing or broken."""
    from porocore.registry import plugins_table

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
        # What holds for the module of an entry point is told once, not for each of its offers.
        for text in (row.advice, *(note for note in row.notes if note not in told)):
            if text:
                typer.echo(f"{'':{widths[0]}}  {one_line(text)}")
        told.update(row.notes)


def one_line(text: str) -> str:
    """Return a text of a stranger for a line of a table: what does not print becomes a space."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


def _loaded(row: PluginRow) -> PluginRow:
    """With what comes of importing the class, and its suites where pytest is there to import them."""
    from porocore.registry import get

    if row.state != "ready" or not row.kind:
        return row
    try:
        implementation = get(row.kind, row.name)
    except PluginError as error:
        return replace(row, state="broken", advice=str(error))
    return replace(row, notes=(*row.notes, *_suite_faults(row.kind, row.name, implementation)))


def _suite_faults(kind: Kind, name: str, implementation: type[Any]) -> list[str]:
    """Return what is wrong with the suites of ``porocore plugin check``; nothing where there is no pytest."""
    from porocore.foreign_code import attempt, file_of, place_of, reason_of
    from porocore.registry import registry

    if find_spec("pytest") is None:
        return []
    from porocore.testing.installed import suites_of
    from porocore.testing.version import complaint

    offered = registry().find(kind, name)
    found = attempt(suites_of, kind, offered.offer, implementation)
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
