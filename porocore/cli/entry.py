"""Entry point of ``porocore``: the application with its groups of commands and its version."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType
from typing import Annotated, Any

import typer

from porocore.cli import cell, data, plugins, start, store, study, units
from porocore.cli.ending import ending
from porocore.cli.parsing import Program, command_group
from porocore.core.console import quieten_libraries
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
* `porocore cell my.yaml --at H22=-0.1,p=0.05` – one state of the cell
"""


_LOOK = "Cells, data, plugins and checks"
_STEPS = "A study in steps, each from the files of the one before"
_GROUPS = {"cell": cell.cell, "data": data.data, "store": store.store, "plugin": plugins.plugin}
#: Commands in the order of the help page; those that are only named here are offered by plugins.
_PANELS: dict[str, tuple[Callable[..., None] | str, ...]] = {
    "Your own configuration": (start.init, start.check, start.schema),
    "A whole study": (study.run, "sweep", "calibrate", "reproduce"),
    _STEPS: (study.sample, study.train, study.solve, study.report, "tune"),
    _LOOK: ("sensitivity", "stability", units.units, plugins.plugins, "crosscheck", "verify", *_GROUPS),
}


class _Porocore(Program):
    panels = MappingProxyType(
        {
            one if isinstance(one, str) else one.__name__: panel
            for panel, commands in _PANELS.items()
            for one in commands
        }
    )


app = command_group(HELP, cls=_Porocore, epilog=EPILOG, add_completion=False, no_args_is_help=True)
for _panel, _commands in _PANELS.items():
    for _command in _commands:
        if not isinstance(_command, str):
            app.command(rich_help_panel=_panel)(_command)
for _name, _group in _GROUPS.items():
    app.add_typer(_group, name=_name, rich_help_panel=_LOOK)


def whole_program() -> Any:
    """Return the application as it is parsed, with every command of porocore loaded, for documents."""
    program: Any = typer.main.get_command(app)
    program.load()
    return program


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
        quieten_libraries()
        app(prog_name="porocore")
