"""``porocore store``: summary, check and clearing of the results that studies share."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli.common import interruptible, page, plain_table
from porocore.cli.options import JsonOption
from porocore.cli.parsing import command_group
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from porocore.core.files.store import ResultStore, StoredFile

#: Meaning of the kinds of results.
KINDS = {
    "states": "solved states of cells",
    "cells": "undeformed cells",
    "surrogates": "trained surrogates",
    "training-curves": "losses of their training",
    "tunings": "networks tried by tune",
}
DAY = 86400.0

FolderOption = Annotated[
    Path | None,
    typer.Option("--store", metavar="DIR", help="The store.", show_default="in the user's cache folder"),
]
store = command_group(
    "List, check or clear the results that studies share: solved states, undeformed cells, surrogates.",
    no_args_is_help=True,
)


@store.command("list")
def list_(folder: FolderOption = None, as_json: JsonOption = False) -> None:
    """Print the number of results and their size, by kind."""
    with interruptible():
        found = _store(folder)
        files = found.files()
    rows = [
        _row(kind, [file for file in files if file.kind == kind]) for kind in sorted({f.kind for f in files})
    ]
    if as_json:
        document = {"folder": str(found.folder), "most_bytes": found.most_bytes, "kinds": rows}
        typer.echo(json.dumps(document, allow_nan=False))
        return
    typer.echo(
        f"{found.folder}: {_size(sum(file.bytes for file in files))} of at most {_size(found.most_bytes)}"
    )
    if rows:
        table = plain_table(("results", "number", "size"), (1, 2))
        for row in rows:
            table.add_row(
                KINDS.get(str(row["kind"]), str(row["kind"])), str(row["number"]), _size(float(row["bytes"]))
            )
        page().print(table)


@store.command()
def check(folder: FolderOption = None) -> None:
    """Read every result, and remove those that were damaged.

    A removed result is computed again when it is needed.
    """
    with interruptible():
        found = _store(folder)
        damaged = found.check()
    for file in damaged:
        typer.echo(f"removed: {file.path}")
    typer.echo(
        f"{found.folder}: {len(found.files())} results are sound, {len(damaged)} were damaged and removed"
    )


@store.command()
def clear(
    folder: FolderOption = None,
    unused: Annotated[
        float,
        typer.Option(
            "--unused", metavar="DAYS", help="Only results that were not used for so long.", min=0.0
        ),
    ] = 0.0,
) -> None:
    """Remove the results, or those that were not used for some days."""
    with interruptible():
        found = _store(folder)
        removed = found.clear(unused * DAY)
    typer.echo(
        f"{found.folder}: {len(removed)} results removed, {_size(sum(file.bytes for file in removed))}"
    )


def _store(folder: Path | None) -> ResultStore:
    from porocore.cli.common import chosen_store
    from porocore.study.store import VARIABLE

    if folder is not None and not os.path.lexists(folder):
        raise ConfigurationError(
            f"--store {folder}: no such folder; give that of a store, or leave --store out"
        )
    found = chosen_store(folder, no_store=False)
    if found is None:
        raise ConfigurationError(f"there is no store, since {VARIABLE} is 'none'; name one by --store DIR")
    return found


def _row(kind: str, files: list[StoredFile]) -> dict[str, str | int]:
    return {"kind": kind, "number": len(files), "bytes": sum(file.bytes for file in files)}


def _size(count: float) -> str:
    return f"{count / 1e6:,.1f} MB" if count < 1e9 else f"{count / 1e9:,.1f} GB"
