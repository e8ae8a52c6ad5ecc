"""Entry point of ``porocore``: the application with its groups of commands and its version."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

import typer

from porocore.cli.calibrate import calibrate
from porocore.cli.commands import (
    cell,
    crosscheck,
    data,
    plugins,
    sensitivity,
    stability,
    start,
    store,
    study,
    tune,
    units,
    verify,
)
from porocore.cli.common import command_group
from porocore.cli.ending import ending
from porocore.cli.parsing import Program
from porocore.cli.sweep import sweep
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


app = command_group(HELP, cls=Program, epilog=EPILOG, add_completion=False, no_args_is_help=True)

_LOOK = "Cells, data, plugins and checks"
_STEPS = (study.sample, study.train, study.solve, study.report, tune.tune)
_ALONG = (sensitivity.sensitivity, stability.stability)
_PANELS: dict[str, tuple[Callable[..., None], ...]] = {
    "Your own configuration": (start.init, start.check, start.schema),
    "A whole study": (study.run, sweep, calibrate, verify.reproduce),
    "A study in steps, each from the files of the one before": _STEPS,
    _LOOK: (*_ALONG, units.units, plugins.plugins, crosscheck.crosscheck, verify.verify),
}
for _panel, _commands in _PANELS.items():
    for _command in _commands:
        app.command(rich_help_panel=_panel)(_command)
_GROUPS = {"cell": cell.cell, "data": data.data, "store": store.store, "plugin": plugins.plugin}
for _name, _group in _GROUPS.items():
    app.add_typer(_group, name=_name, rich_help_panel=_LOOK)


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
