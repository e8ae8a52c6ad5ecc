"""Regions and fields as a set-up has them: their keys, their kinks, their content, their names (ComposedBody)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

from porocore.core.echo import suggestion
from porocore.errors import ConfigurationError
from porocore.macro.composition.axes import AXES
from porocore.macro.composition.regions import Region


class ComposedBody(Protocol):
    """A set-up with regions and fields."""

    @property
    def regions(self) -> Mapping[str, Region]:
        """Regions by name."""

    @property
    def fields(self) -> Mapping[str, Any]:
        """Fields of the whole body by the name of the parameter, and the axes."""


class NeedsParameters(Protocol):
    """A law, as far as its parameters matter; see :class:`~porocore.interfaces.law.MacroLaw`."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters."""

    def parameters_of(self, region: int) -> tuple[str, ...]:
        """Return the names of those that a region needs."""


def require_names(setup: ComposedBody, law: NeedsParameters) -> None:
    """Refuse a field of what is no parameter of any cell, or in a region, of its own.

    Raises
    ------
    ConfigurationError
        There is one; the message names it and the parameters.
    """
    cells = [None, *(region.cell for region in setup.regions.values())]
    for k, (prefix, entries) in enumerate(sections(setup)):
        names = law.parameters_of(k) if k else law.parameters
        of = "the cell" if cells[k] is None else f"the cell '{cells[k]}'"
        for name in entries:
            if name not in names and name != AXES:
                told = suggestion(
                    name,
                    names,
                    "the parameters are",
                    "there are none; a number of the cell becomes one by {range: [lower, upper]} in its place",
                )
                raise ConfigurationError(f"{prefix}.{name}: '{name}' is no parameter of {of}; {told}")


def composition(setup: ComposedBody) -> dict[str, Any]:
    """Return regions and fields as plain data, as far as there are any; files count by content, not by path."""
    regions = {name: _without_paths(region.model_dump()) for name, region in setup.regions.items()}
    fields = {
        name: entry if isinstance(entry, float | str) else _without_paths(entry.model_dump())
        for name, entry in setup.fields.items()
    }
    return {key: value for key, value in (("regions", regions), ("fields", fields)) if value}


def _without_paths(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _without_paths(value) for key, value in data.items() if key != "path"}
    return data


def field_corners(setup: ComposedBody) -> Iterator[float]:
    """Yield the times at which a field or the axes have a kink."""
    for _, entries in sections(setup):
        for entry in entries.values():
            if not isinstance(entry, float | str):
                yield from entry.corners


def sections(setup: ComposedBody) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the keys of all mappings of fields, with these: that of the body, then those of the regions."""
    yield "macro.fields", setup.fields
    for name, region in setup.regions.items():
        yield f"macro.regions.{name}.fields", region.fields


def by_region(setup: ComposedBody, name: str, present: Sequence[int]) -> Iterator[tuple[str, list[int], Any]]:
    """Yield key, numbers of the regions and value of each field of that name; regions without have the body's."""
    own = {
        k: (f"macro.regions.{region}.fields.{name}", settings.fields[name])
        for k, (region, settings) in enumerate(setup.regions.items(), start=1)
        if name in settings.fields
    }
    if name in setup.fields:
        yield f"macro.fields.{name}", [k for k in present if k not in own], setup.fields[name]
    for k, (key, value) in own.items():
        yield key, [k], value


def without_a_value(setup: ComposedBody, name: str, missing: Sequence[int]) -> str:
    """Return the complaint that a parameter has no value in the regions of these numbers."""
    regions = ["the rest of the body", *(f"the region '{region}'" for region in setup.regions)]
    where = ", ".join(regions[k] for k in missing) if setup.regions else "the body"
    return (
        f"macro.fields.{name}: missing; the cell has the parameter '{name}', which has no value in {where}: add "
        f"'{name}:' with a number or a field"
    )
