"""``porocore plugins``: what is installed, what is not, and what to do about it."""

from __future__ import annotations

import typer


def plugins() -> None:
    """List the backends, their state, and how to mend what is missing or broken."""
    from porocore.registry import plugins_table

    header = ("kind", "name", "state", "from")
    rows = plugins_table()
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
