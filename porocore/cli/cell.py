"""``porocore cell`` and its command ``state``; results of a state as text."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import typer

from porocore.cli.common import chosen_store, in_units_of, interruptible, located, read_config
from porocore.cli.options import ConfigArgument, FemOption, JsonOption, NoStoreOption, StoreOption
from porocore.cli.parsing import Commands, command_group
from porocore.cli.states import (
    STATE_HELP,
    AtOption,
    CellOption,
    GradUOption,
    ParametersOption,
    PressureOption,
    one_cell,
    read_state,
)
from porocore.core.console import Console
from porocore.core.echo import did_you_mean, echo, joined
from porocore.core.files.plain_data import json_ready
from porocore.core.files.reading import obstacle

if TYPE_CHECKING:
    from porocore.core.units import ResultUnits
    from porocore.study.config.config import RunConfig

#: Anything smaller is printed as 0 for reading; the cell solver's tolerance is of this size.
ZERO = 1e-12
#: To which configuration of the cell results belong, said of a state that is not at rest.
BELONGS = {
    "porosity": "of the undeformed cell",
    "conductivity": "of the undeformed cell",
    "fluid_volume": "volume of fluid in this state / volume of the undeformed cell; "
    "equals the porosity if H = 0 and p = 0",
    "deformed_conductivity": "in this state, for the flux through undeformed area",
}


class _StateByDefault(Commands):
    """``porocore cell [CONFIG] …`` is short for ``porocore cell state [CONFIG] …``."""

    panels = MappingProxyType(dict.fromkeys(("rev", "state", "fields", "show"), "Commands"))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        first = args[0] if args else ""
        if first in ("-h", "--help") or self.find(first) is not None:
            return super().parse_args(ctx, args)
        if (
            re.fullmatch(r"[\w-]*[A-Za-z]\w*", first)
            and not first.startswith("-")
            and not Path(first).exists()
        ):
            if link := obstacle(Path(first)):
                ctx.fail(f"{first}: {link}; a configuration is a file such as my.yaml.")
            known = self.list_commands(ctx)
            question = did_you_mean(first, known)
            ctx.fail(
                f"There is no command and no file {echo(first)}; {question + ' ' if question else ''}the commands are "
                f"{joined(known)}, and a configuration is a file such as my.yaml."
            )
        return super().parse_args(ctx, ["state", *args])


cell = command_group(
    "Print the properties of a cell, or solve one state of it (state, the default), write its local fields, show its "
    f"pores, or find how large a part of an image it must be.\n\n{STATE_HELP}",
    cls=_StateByDefault,
)


@cell.command()
def state(
    config: ConfigArgument = None,
    at: AtOption = None,
    grad_u: GradUOption = None,
    p: PressureOption = None,
    parameters: ParametersOption = None,
    cell: CellOption = None,
    fem: FemOption = None,
    as_json: JsonOption = False,
    store: StoreOption = None,
    no_store: NoStoreOption = False,
) -> None:
    """Print the properties of the undeformed cell, or solve the cell for one macroscopic state.

    Without a state: porosity, permeability, conductivity, moduli, Biot's coefficients, consolidation coefficients and
    drained stiffness, and the reasons to mistrust them. With a state: the responses of the cell with their derivatives,
    those of fourth order with --json only. The file needs no more than cell:, and scales: for units (modulus, pore or
    the voxel size of an image); the JSON object has all digits, and both. The slopes by its parameters are
    dimensionless. The status of a state without solution tells why there is none; its responses are null in the JSON
    object.
    """
    kept = chosen_store(store, no_store)
    path, settings = read_config(config, fem, cell_only=True)
    units, file = settings.result_units, settings
    with interruptible(), located(path), in_units_of(settings.result_units):
        settings = one_cell(settings, cell, parameters)
        found = read_state(at, grad_u, p, settings.cell.modulus, {}, settings.scales)
        from porocore.core.inputs import NAMES
        from porocore.report.dimensional import figures_with_units
        from porocore.study.notes.cell_alone import DIMENSIONLESS, notes, table_of_cell
        from porocore.study.run import pipeline

        row = [found.get(name, 0.0) for name in NAMES]
        asked = ([row[:3], row[3:6], row[6:9]], row[9])
        solved = pipeline.solve_cell(settings, *asked, store=kept, tell=Console().note)
        properties, warnings = solved.pop("properties", None), solved.pop("warnings", [])
        # A slope is by one unit of its parameter, which may have a dimension of its own.
        slopes = {"slopes": solved.pop("slopes")} if "slopes" in solved else {}
        result = json_ready(figures_with_units(solved, units) | slopes)
        which = _which(file, cell, parameters)
        if as_json:
            if properties is not None:
                result["properties"] = properties.in_units(units, settings.cell_length)
                result["notes"] = [*warnings, *notes(settings.cell, settings.cell_length, settings.scales)]
            result["cell"] = which | {"description": settings.cell.geometry.description}
            typer.echo(json.dumps(result, allow_nan=False))
            return
        for name, said in which.items():
            typer.echo(f"{name}: {said}")
        if any(row) and units.given:
            typer.echo(f"state: {_state_text(found, units, [*(at or []), f'p={p}'])}")
        if properties is None:
            typer.echo(as_text(result, BELONGS if any(row) else {}))
            if not units.given:
                typer.echo(DIMENSIONLESS)
            return
        for line in table_of_cell(settings, properties):
            typer.echo(line)
        for warning in warnings:
            typer.echo(f"note: {warning}")
        if slopes:
            typer.echo(as_text(json_ready(slopes)))
        typer.echo("the responses at rest and all derivatives: --json; another state: --at H22=-0.1,p=0.05")


def _state_text(state: Mapping[str, float], units: ResultUnits, given: Iterable[str]) -> str:
    """Return a state with the unit of p, and what a p counts as that is given without one."""
    named = [f"{name} = {value:g}" for name, value in state.items() if name != "p"]
    if "p" not in state:
        return ", ".join(named)
    text = ", ".join([*named, f"p = {units.text(state['p'], 'stress', 4)}"])
    bare = [
        plain
        for part in ",".join(given).split(",")
        if (plain := re.fullmatch(r"\s*p\s*=\s*([-+.\deE]+)\s*", part))
    ]
    if not bare:
        return text
    one = units.text(1.0, "stress", 4)
    written = f"p={bare[0][1]} {one.split()[-1]}"
    return f"{text}; a p without a unit is a multiple of {one}: write '{written}' if that is meant"


def _which(file: RunConfig, cell: str | None, parameters: list[str] | None) -> dict[str, str]:
    """Return which of several cells, and which member of a family, the results belong to."""
    found = {}
    if file.cells:
        others = ", ".join(f"--cell {name}" for name in file.cells if name != cell)
        own = "of 'cell:'" if cell is None else f"of 'cells.{cell}:'"
        found["cell"] = f"{own}; the file has others, too: {others}" if others else own
    if parameters:
        found["member"] = ", ".join(parameters)
    return found


def as_text(result: Mapping[str, Any], belongs: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return a result as text, without fourth-order derivatives; ``belongs`` is said behind some names.

    A state without values shows only its status and what does not depend on it. Numbers that are below :data:`ZERO`
    without their unit are 0.
    """
    from porocore.core.units import MULTIPLES
    from porocore.report.dimensional import FIGURES
    from porocore.report.text import status_in_words

    lines = []
    for name, given in result.items():
        value: Any = given if isinstance(given, Mapping) else _rounded(given, given)
        if name in FIGURES and not isinstance(given, Mapping) and given is not None:
            name = f"{name} [{MULTIPLES[FIGURES[name]]}]"
        if isinstance(given, Mapping) and "unit" in given:
            name, value = f"{name} [{given['unit']}]", _rounded(given["value"], given["dimensionless"])
        name += f" ({belongs[name.split()[0]]})" if name.split()[0] in belongs else ""
        if name == "status":
            lines.append(f"status: {status_in_words(value)}")
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


def _is_empty(value: Any) -> bool:
    """Return True for data that hold nothing but null, such as the responses of a state without values."""
    if isinstance(value, Mapping):
        return all(_is_empty(each) for key, each in value.items() if key != "unit")
    return all(map(_is_empty, value)) if isinstance(value, list) else value is None


def _rounded(value: Any, dimensionless: Any) -> Any:
    """Return values with 0 for each whose dimensionless number is below :data:`ZERO`."""
    if isinstance(value, list):
        return [_rounded(*pair) for pair in zip(value, dimensionless, strict=True)]
    return 0.0 if isinstance(dimensionless, float) and abs(dimensionless) < ZERO else value


def _number(value: Any) -> str:
    return f"{value:13.6g}" if isinstance(value, int | float) else f"{'-' if value is None else value!s:>13}"


def _depth(value: Any) -> int:
    depth = 0
    if isinstance(value, Mapping) and "unit" in value:
        value = value["value"]
    while isinstance(value, list):
        depth += 1
        value = value[0] if value else None
    return depth
