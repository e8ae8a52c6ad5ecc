"""One way to give a state on the command line: ``--at``, ``--grad-u`` and ``--p``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli.common import parse_inputs, parse_pressure
from porocore.core.echo import comma_within, cut, echo
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from porocore.cell.cell import Cell
    from porocore.core.units import Scales
    from porocore.study.config.config import RunConfig

#: Its text in the help of a group.
STATE_HELP = (
    "A state is H = grad u (H_ij = du_i/dX_j) and the pore pressure p, by name as `--at H22=-0.1,p=0.05`, or H row by "
    'row as `--grad-u "0 0 0; 0 -0.1 0; 0 0 0" --p 0.05`. What is not given is 0.'
)
AtOption = Annotated[
    list[str] | None,
    typer.Option(
        "--at",
        metavar="NAME=VALUE,…",
        help="State: those of H11 … H33 and p that are not zero; once with commas, or several times.",
        show_default=False,
    ),
]
GradUOption = Annotated[
    str | None,
    typer.Option(
        "--grad-u",
        metavar='"a b c; d e f; g h i"',
        help="H = grad u, row by row, H_ij = du_i/dX_j.",
        show_default=False,
    ),
]
PressureOption = Annotated[
    str | None,
    typer.Option(
        "--p",
        metavar="P",
        help="Pore pressure, positive in compression: a multiple of E, or with scales a value such as '1 kPa'.",
        show_default=False,
    ),
]
ParametersOption = Annotated[
    list[str] | None,
    typer.Option(
        "--parameters",
        metavar="NAME=VALUE,…",
        help="Values of the cell's parameters: of each that the configuration gives as a range; a number that it gives "
        "may be replaced, too.",
        show_default=False,
    ),
]

CellOption = Annotated[
    str | None,
    typer.Option("--cell", metavar="NAME", help="The cell of that name in cells:.", show_default="cell:"),
]


def named_cell(settings: RunConfig, name: str | None) -> RunConfig:
    """Return the study of the cell of ``--cell``.

    Raises
    ------
    ConfigurationError
        There is no such cell, or the file gives none without a name.
    """
    from porocore.core.echo import joined, suggestion

    known = settings.cells
    if name is not None and name not in known:
        listed = (
            suggestion(name, known, "the names are") if known else "the file has no 'cells:'; leave it out"
        )
        raise ConfigurationError(f"--cell: there is no cell {echo(name)}; {listed}")
    if name not in settings.own_cells:
        raise ConfigurationError(f"cells: expected the name of a cell with --cell: {joined(known)}")
    return settings.of_cell(name)


def one_cell(settings: RunConfig, name: str | None, parameters: Sequence[str] | None) -> RunConfig:
    """Return the study of the cell of ``--cell``, at the values of ``--parameters``.

    Raises
    ------
    ConfigurationError
        See :func:`named_cell` and :func:`read_parameters`.
    """
    one = named_cell(settings, name)
    with settings.keys_of(name):
        return one.model_copy(update={"cell": read_parameters(one.cell, parameters)})


def read_parameters(cell: Cell, given: Sequence[str] | None) -> Cell:
    """Return the member of a cell at the values of ``--parameters``.

    Raises
    ------
    ConfigurationError
        The text cannot be read, a range has no value, or a name is unknown.
    """
    from porocore.cell.family.family import member_with

    if not given:
        cell.require_member(
            f"give its value with --parameters {','.join(f'{p.name}={p.base:g}' for p in cell.parameters)}"
        )
        return cell
    values = parse_inputs("--parameters", "values such as radius=0.22,poisson_ratio=0.3", ",".join(given))
    try:
        return member_with(cell, values)
    except ConfigurationError as error:
        raise ConfigurationError(f"--parameters: {error}") from None


def read_state(
    at: Sequence[str] | None,
    grad_u: str | None,
    p: str | float | None,
    modulus: float,
    usual: Mapping[str, float],
    scales: Scales | None = None,
) -> dict[str, float]:
    """Return the components of a state by name, without those that are zero; ``usual`` if no option is given.

    Parameters
    ----------
    at, grad_u, p
        The options.
    modulus
        Young's modulus of the stiffest solid [E].
    scales
        With which p may have a unit.

    Raises
    ------
    ConfigurationError
        An option cannot be read, a component is given twice, or no cell can be in the state.
    """
    from porocore.core.inputs import NAMES, named_state, require_possible

    given = {"--at": at, "--grad-u": grad_u, "--p": p}
    options = [option for option, value in given.items() if value is not None and value != []]
    if not options:
        return dict(usual)
    found = parse_inputs("--at", "a state such as H22=-0.2,p=0.1", ",".join(at), scales) if at else {}
    try:
        named_state(found)
    except ConfigurationError as error:
        raise ConfigurationError(f"--at: {error}") from None
    if grad_u is not None:
        if twice := [name for name in found if name != "p"]:
            raise ConfigurationError(f"--grad-u: --at gives {twice[0]}, too; leave out one of the two")
        rows = parse_grad_u(grad_u)
        found |= dict(zip(NAMES, (x for row in rows for x in row), strict=False))
    if p is not None:
        if "p" in found:
            raise ConfigurationError("--p: --at gives p, too; leave out one of the two")
        found["p"] = parse_pressure("--p", str(p), scales)
    row = named_state(found)
    require_possible(row[:9], row[9], modulus, " and ".join(options))
    return {name: value for name, value in found.items() if value}


def parse_grad_u(text: str) -> list[list[float]]:
    """Return the three rows of a text such as ``"a b c; d e f; g h i"``; commas may stand for spaces.

    Raises
    ------
    ConfigurationError
        The text is not nine finite numbers in three rows.
    """
    try:
        rows = [[float(word) for word in row.replace(",", " ").split()] for row in text.split(";")]
        reason = f"rows of {', '.join(str(len(row)) for row in rows)}{comma_within(text)}"
    except ValueError:
        rows, reason = [], f"not all are numbers{comma_within(text)}"
    if [len(row) for row in rows] == [3, 3, 3] and not all(math.isfinite(x) for row in rows for x in row):
        reason = "not all are finite"
    elif [len(row) for row in rows] == [3, 3, 3]:
        return rows
    raise ConfigurationError(
        f"--grad-u: expected nine finite numbers as 'a b c; d e f; g h i', got {echo(text)} ({cut(reason)})"
    )
