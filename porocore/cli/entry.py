"""The application with its commands."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from porocore.cli.commands import (
    cell,
    crosscheck,
    data,
    plugins,
    reproduce,
    sensitivity,
    stability,
    start,
    study,
    tune,
    units,
    verify,
)
from porocore.cli.ending import ending
from porocore.core.echo import without_long_words
from porocore.core.parallel import launched
from porocore.errors import PorocoreError

HELP = """
Two-scale finite-strain poroelasticity.

A study solves the periodic cell of a porous solid for sampled deformations and pore pressures, trains a
surrogate on the solved states, and solves a macroscopic consolidation problem with it, beside linear
poroelasticity from the same cell. Numbers without a unit are dimensionless: stresses and pressures are multiples of one
reference modulus, which is Young's modulus of the solid where that is neo-Hookean. Configurations with `scales` take
values with units.
"""
EPILOG = """
Examples:

* `porocore run` – the benchmark of Dehghani & Zilian, into runs/dehghani2022
* `porocore init` – configurations to start from
* `porocore run my.yaml --out runs/mine` – your own study; `--resume` continues it
* `porocore cell my.yaml --grad-u "0 0 0; 0 -0.1 0; 0 0 0" --p 0.05` – one state of the cell
"""


class _Commands(TyperGroup):
    """Group of commands that cuts long words in the messages of the parser."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except Exception as error:
            message = getattr(error, "message", None)
            if isinstance(message, str) and hasattr(error, "format_message"):
                error.message = without_long_words(message, sys.argv[1:])  # type: ignore[attr-defined]
            raise


app = typer.Typer(
    cls=_Commands,
    help=HELP,
    epilog=EPILOG,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)

_BEGIN, _WHOLE, _STEPS, _LOOK = (
    "Your own configuration",
    "A whole study",
    "A study in steps, each from the files of the one before",
    "Cells, data, plugins and checks",
)
app.command(rich_help_panel=_BEGIN)(start.init)
app.command(rich_help_panel=_BEGIN)(start.check)
app.command(rich_help_panel=_BEGIN)(start.schema)
app.command(rich_help_panel=_WHOLE)(study.run)
app.command(rich_help_panel=_WHOLE)(reproduce.reproduce)
app.command(rich_help_panel=_STEPS)(study.sample)
app.command(rich_help_panel=_STEPS)(study.train)
app.command(rich_help_panel=_STEPS)(study.solve)
app.command(rich_help_panel=_STEPS)(study.report)
app.command(rich_help_panel=_STEPS)(tune.tune)
app.add_typer(cell.cell, name="cell", rich_help_panel=_LOOK)
app.add_typer(data.data, name="data", rich_help_panel=_LOOK)
app.command(rich_help_panel=_LOOK)(sensitivity.sensitivity)
app.command(rich_help_panel=_LOOK)(stability.stability)
app.command(rich_help_panel=_LOOK)(units.units)
app.command(rich_help_panel=_LOOK)(plugins.plugins)
app.add_typer(plugins.plugin, name="plugin", rich_help_panel=_LOOK)
app.command(rich_help_panel=_LOOK)(crosscheck.crosscheck)
app.command(rich_help_panel=_LOOK)(verify.verify)


def _version(wanted: bool) -> None:
    if wanted:
        import porocore

        typer.echo(f"porocore {porocore.__version__}")
        raise typer.Exit


#: Commands whose work several MPI processes can share.
_SHARED = ("solve",)


@app.callback()
def _options(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and end.")
    ] = False,
) -> None:
    _, size = launched()
    if size > 1 and context.invoked_subcommand not in _SHARED:
        raise PorocoreError(
            f"'porocore {context.invoked_subcommand}' was started as {size} MPI processes, which would do the same "
            "work side by side; start it without mpirun (only 'porocore solve' shares its work)"
        )


def main() -> None:
    """Entry point of the ``porocore`` command."""
    with ending():
        app(prog_name="porocore")
