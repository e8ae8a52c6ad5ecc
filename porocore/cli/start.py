"""``porocore init``, ``schema`` and ``check``: a configuration before its run."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import Annotated

import typer

from porocore.cli.common import command, interruptible, located, read_config, require_no_result
from porocore.cli.options import ClosureOption, ConfigArgument, FemOption, MacroOption, SurrogateOption
from porocore.errors import ConfigurationError


def init(
    kind: Annotated[
        str | None,
        typer.Argument(metavar="KIND", help="Example to start from.", show_default="lists them"),
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option(
            "--to", metavar="FILE", help="The new file; missing folders are made.", show_default="KIND.yaml"
        ),
    ] = None,
) -> None:
    """Write a commented configuration to start from; without KIND, list the examples.

    Prints the path of the file. An existing file is never overwritten.
    """
    from porocore.study.config.loading import example, examples

    if kind is None:
        if to is not None:
            raise ConfigurationError(f"expected a KIND to write to {to}; 'porocore init' lists them")
        known = examples()
        width = max(map(len, known))
        for name, one in known.items():
            typer.echo(f"{name:{width}}  {one.title}")
        return
    chosen = example(kind)
    path = Path(f"{kind}.yaml") if to is None else to
    _write_new(path, chosen.start(path))
    typer.echo(path)


def schema(
    to: Annotated[
        Path | None,
        typer.Option(
            "--to",
            metavar="FILE",
            help="File of the schema; missing folders are made.",
            show_default="standard output",
        ),
    ] = None,
) -> None:
    """Print the JSON schema of the configuration, with which editors complete and check it.

    --to FILE writes it to a file instead and prints the path; an older schema there is replaced.
    """
    from porocore.core.files.atomic import place_for, write_text
    from porocore.study.config.schema import DIALECT, schema_text

    if to is None:
        typer.echo(schema_text(), nl=False)
        return
    if place_for(to, "--to").exists() and DIALECT not in _beginning(to):
        raise ConfigurationError(f"--to: {to} is no JSON schema; choose another file, or remove it")
    write_text(to, schema_text())
    typer.echo(to)


def check(
    config: ConfigArgument = None,
    fem: FemOption = None,
    macro: MacroOption = None,
    surrogate: SurrogateOption = None,
    closure: ClosureOption = None,
) -> None:
    """Check a configuration and outline its run; no folder is made. A file may also describe a cell alone.

    Meshes the cell and the body, and looks for surfaces, boundary conditions, probes and backends. Solves the
    undeformed cell, unless it is large, and tells what follows from it: moduli, permeability, and the time in which the
    body consolidates. A later run finds that cell in the store. Reads the measured data of a calibration, in a section
    of the study or a file of its own.
    """
    from porocore.core.files.yaml_document import YamlDocument
    from porocore.interfaces.command import FileCheck
    from porocore.study.config.loading import command_of_file, holds_cells_alone
    from porocore.study.notes.at_rest import at_rest
    from porocore.study.notes.cell_alone import outline_of_cells
    from porocore.study.notes.checks import check_backends, check_file, check_section
    from porocore.study.notes.magnitudes import WARNING
    from porocore.study.notes.outline import outline
    from porocore.study.store import user_store

    if config is not None:
        require_no_result(config)
    document = YamlDocument.read(config) if config is not None and config.is_file() else None
    if document is not None and (owner := command_of_file(document)) is not None:
        with interruptible():
            own = check_file(owner, document)
        for line in own.lines:
            typer.echo(line)
        typer.echo(f"no faults; next: {command(owner.offer.name, config, **own.options)}")
        return
    alone = document is not None and holds_cells_alone(document)
    path, settings = read_config(config, fem, surrogate, closure, macro, cell_only=alone)
    with interruptible(), located(path):
        if alone:
            for line in outline_of_cells(settings, user_store()):
                typer.echo(line)
            typer.echo(f"no faults; next: {command('cell', config, cell=settings.own_cells[0])}")
            typer.echo(
                "a run needs more sections: 'sampling:' and 'macro:' (and 'length:' under 'scales:', where there are "
                "scales); 'porocore init' lists examples to copy them from"
            )
            return
        check_backends(settings)
        name, section = check_section(YamlDocument.read(path), settings) or ("run", FileCheck())
        warned = False
        for line in chain(outline(settings), at_rest(settings, user_store()), section.lines):
            typer.echo(line)
            warned |= line.startswith(WARNING)
    if warned:
        typer.echo("no faults, but a run would be wasted: first mend what is said behind 'warning:'")
    else:
        typer.echo(f"no faults; next: {command(name, config, **section.options)}")


def _beginning(path: Path) -> str:
    with path.open("rb") as file:
        return file.read(200).decode(errors="replace")


def _write_new(path: Path, text: str) -> None:
    """Write a file that must not exist."""
    from porocore.core.files.atomic import place_for, write_text

    if place_for(path, "--to").exists():
        raise ConfigurationError(f"{path} exists and is not overwritten; choose another --to")
    write_text(path, text)
