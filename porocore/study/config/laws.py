"""Faults of laws with memory that show only beside the cells: parameters that evolve, names, fields."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from porocore.core.echo import choices, echo, joined, suggestion
from porocore.core.files.yaml_document import Location, dotted
from porocore.errors import ConfigurationError
from porocore.macro.composition.fields import AXES, as_field
from porocore.macro.composition.law_numbers import FIRST_PARTS, is_of_the_law
from porocore.macro.composition.regions import sections
from porocore.study.config.config import RunConfig


def law_faults(config: RunConfig) -> Iterator[tuple[Location, str]]:
    """Yield faults of names of parameters, of rates, and of fields of parameters that evolve."""
    parameters = {
        name: [each.name for each in config.cell_named(name).parameters] for name in config.cell_names
    }
    for cell, names in parameters.items():
        yield from _taken_names(cell, names)
    everything = list(dict.fromkeys(name for names in parameters.values() for name in names))
    for name, evolution in config.macro.evolution.items():
        at = ("macro", "evolution", name)
        if name not in everything:
            advice = suggestion(
                name,
                everything,
                "the parameters are",
                "there are none; a number of the cell becomes one by {range: [lower, upper]} in its place",
            )
            yield at, f"{dotted(at)}: no cell has the parameter {echo(name)}; {advice}"
            continue
        for names in parameters.values():
            if name in names:
                try:
                    rate = evolution.rate_of(name, names)
                except ConfigurationError as error:
                    yield at, str(error)
                    break
                if rate.follows_state and config.closure == "mean-gradient":
                    yield at, _needs_the_potential(at)
                    break
    yield from _moving_fields(config)
    yield from _baths(config)


def _needs_the_potential(at: Location) -> str:
    """Return why a rate that follows the state does not go with the closure mean-gradient."""
    return (
        f"{dotted(at)}: the rate follows the state of the body, and closure 'mean-gradient' does not know how the "
        "fluid that it sums over the steps changes with the cell; choose closure: potential"
    )


def _baths(config: RunConfig) -> Iterator[tuple[Location, str]]:
    """Yield baths of surfaces that are not drained, and drained surfaces without a bath."""
    macro = config.macro
    if macro.charges is None or not isinstance(baths := macro.charges.bath, dict):
        return
    drained = [name for name, face in macro.boundary.items() if face.pressure is not None]
    at, listed = ("macro", "charges", "bath"), "the drained surfaces are"
    for name in baths:
        here = (*at, name)
        if name in macro.boundary and name not in drained:
            advice = f"give macro.boundary.{name} a 'pressure:', or remove it; {choices(drained, listed)}"
            yield here, f"{dotted(here)}: expected a drained surface, but {echo(name)} is none; {advice}"
        elif name not in drained:
            advice = suggestion(name, drained, listed)
            yield here, f"{dotted(here)}: no drained surface is called {echo(name)}; {advice}"
    for name in drained:
        if name not in baths:
            here = (*at, name)
            told = f"missing; the surface {echo(name)} is drained, but has no bath: add '{name}:' under '{dotted(at)}:'"
            yield at, f"{dotted(here)}: {told}; {choices(drained, listed)}"


def _taken_names(cell: str | None, names: Sequence[str]) -> Iterator[tuple[Location, str]]:
    at = ("cell",) if cell is None else ("cells", cell)
    for name in names:
        if is_of_the_law(name):
            yield (
                at,
                f"{dotted(at)}: the parameter '{name}' is called like a number of a law, which begin with "
                f"{joined(FIRST_PARTS)}; give the region another name",
            )


def _moving_fields(config: RunConfig) -> Iterator[tuple[Location, str]]:
    """Yield fields that change with time of parameters that evolve."""
    for prefix, entries in sections(config.macro):
        for name, entry in entries.items():
            if name == AXES or name not in config.macro.evolution or not as_field(entry).varies:
                continue
            at = (*prefix.split("."), name)
            yield (
                at,
                f"{dotted(at)}: expected the value at the beginning, since the parameter evolves by "
                f"macro.evolution.{name}, got a field that changes with time; leave t and 'over:' out of one, or "
                "remove the other",
            )
