"""``porocore cell``: one state of the cell, solved and shown."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Annotated, Any

import typer

from porocore.cli.common import ConfigArgument, FemOption, interruptible, read_config
from porocore.errors import ConfigurationError
from porocore.plain_data import json_ready

#: Anything smaller is printed as 0 for reading; the cell solver's tolerance is of this size.
ZERO = 1e-12


def cell(
    config: ConfigArgument = None,
    fem: FemOption = None,
    grad_u: Annotated[
        str,
        typer.Option(
            "--grad-u", metavar='"a b c; d e f; g h i"', help="H = grad u, row by row, H_ij = du_i/dX_j."
        ),
    ] = "0 0 0; 0 0 0; 0 0 0",
    p: Annotated[float, typer.Option("--p", help="Pore pressure, positive in compression, E = 1.")] = 0.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
) -> None:
    """Solve the cell for one macroscopic state.

    Prints porosity, conductivity and the responses of the cell with their derivatives, those of fourth order
    with --json only. A state that has no solution is an answer too: its status tells why, and in the JSON object
    its responses are null.
    """
    _, settings = read_config(config, fem)
    state = parse_grad_u(grad_u)
    if not math.isfinite(p):
        raise ConfigurationError(f"--p: expected a finite number, got {p}")
    with interruptible():
        from porocore import pipeline

        result = json_ready(pipeline.solve_cell(settings, state, p))
    typer.echo(json.dumps(result, allow_nan=False) if as_json else as_text(result))


def parse_grad_u(text: str) -> list[list[float]]:
    """``"a b c; d e f; g h i"`` → three rows; commas may stand for spaces.

    Raises
    ------
    ConfigurationError
        It is not nine finite numbers in three rows.
    """
    try:
        rows = [[float(word) for word in row.replace(",", " ").split()] for row in text.split(";")]
    except ValueError as error:
        rows = []
        reason = str(error)
    else:
        reason = f"rows of {', '.join(str(len(row)) for row in rows)}"
    if [len(row) for row in rows] != [3, 3, 3] or not all(math.isfinite(x) for row in rows for x in row):
        raise ConfigurationError(
            f"--grad-u: expected nine finite numbers as 'a b c; d e f; g h i', got '{text}' ({reason})"
        )
    return rows


def as_text(result: Mapping[str, Any]) -> str:
    """The same for reading.

    The fourth-order derivatives are in the JSON only. A state without values shows what does not depend on
    it, and its status in words; numbers below :data:`ZERO` are shown as 0.
    """
    lines = []
    for name, value in result.items():
        if name == "status":
            lines.append(f"status: {_described(value)}")
        elif _is_empty(value):
            continue
        elif isinstance(value, Mapping):
            nested = {key: item for key, item in value.items() if not _depth(item) > 2}
            lines += [f"{name}:", *(f"  {line}" for line in as_text(nested).splitlines())]
        elif _depth(value) == 2:
            lines += [f"{name}:", *("  " + "  ".join(_number(x) for x in row) for row in value)]
        else:
            lines.append(f"{name}: {_number(value).strip() if not isinstance(value, str) else value}")
    return "\n".join(lines)


def _described(status: str) -> str:
    """Its name, and what it means unless all is well."""
    from porocore.report.words import MEANINGS
    from porocore.states import Status

    known = Status[status]
    return status if known is Status.converged else f"{status} – {MEANINGS[known]}"


def _is_empty(value: Any) -> bool:
    """Whether it holds nothing but null, as the responses of a state without values do."""
    if isinstance(value, Mapping):
        return all(map(_is_empty, value.values()))
    return all(map(_is_empty, value)) if isinstance(value, list) else value is None


def _number(value: Any) -> str:
    if isinstance(value, float) and abs(value) < ZERO:
        value = 0.0
    return f"{value:13.6g}" if isinstance(value, int | float) else f"{'-' if value is None else value!s:>13}"


def _depth(value: Any) -> int:
    depth = 0
    while isinstance(value, list):
        depth += 1
        value = value[0] if value else None
    return depth
