"""``porocore plugins``: what is installed, what is not, and what to do about it."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from porocore.errors import PluginError

if TYPE_CHECKING:
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
    for row, line in zip(rows, cells, strict=True):
        padded = [text.ljust(width) for text, width in zip(line, widths, strict=True)]
        padded[2] = typer.style(padded[2], fg=colours.get(row.state, typer.colors.RED))
        typer.echo("  ".join([*padded, row.summary]).rstrip())
        if row.advice:
            typer.echo(f"{'':{widths[0]}}  {row.advice}")


def _loaded(row: PluginRow) -> PluginRow:
    """With what comes of importing the class."""
    from porocore.registry import get

    if row.state == "ready" and row.kind:
        try:
            get(row.kind, row.name)
        except PluginError as error:
            return replace(row, state="broken", advice=str(error))
    return row


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
        "state": row.state,
        "works": row.state == "ready",
        "advice": row.advice or None,
    }
