"""Values of a cell's parameters that the fields of the body take: at all of its points, and told apart."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from porocore.core.inputs.used_values import MOST, farthest
from porocore.macro.composition.body_fields import BodyFields, field_times
from porocore.macro.composition.regions import regions_of_cell
from porocore.macro.problem import body_mesh
from porocore.states import Array, IntArray
from porocore.study.config.cells import cell_of, cell_ranges

if TYPE_CHECKING:
    from porocore.study.config.config import RunConfig

#: A parameter that varies is told apart in so many steps of its range, so that another mesh gives the same values.
LATTICE = 40
#: Digits of a share of a range to which a value that is one everywhere is kept.
DIGITS = 9
#: Answers that are kept.
KEPT = 16
#: The last answers, by all that they depend on.
_known: OrderedDict[str, tuple[tuple[float, ...], ...]] = OrderedDict()


def used_parameters(config: RunConfig, cell: str | None) -> tuple[tuple[float, ...], ...]:
    """Return values of all parameters, one row for each combination, near which the body has some cell.

    A parameter that is one number everywhere keeps it; one that varies is told apart in steps of its range. Of more
    than :data:`~porocore.core.inputs.used_values.MOST` the farthest are kept.

    Parameters
    ----------
    config
        The whole study.
    cell
        Name of the family; None names that of the rest of the body.

    Raises
    ------
    ConfigurationError
        Fields do not suit the body.
    """
    family = cell_of(config, cell)
    ranges = {each.name: (each.lower, each.upper) for each in family.parameters}
    if not _given_everywhere(config, cell, ranges):
        return ()  # a check of the fields tells which one is missing
    all_ranges = [sorted(each.items()) for each in cell_ranges(config).by_region]
    grounds = json.dumps([config.macro.specification(), cell, all_ranges], default=str, sort_keys=True)
    if grounds not in _known:
        times = field_times(config.macro, config.macro.time.end)
        _known[grounds] = told_apart(values_in_body(config, cell, times), ranges)
        while len(_known) > KEPT:
            _known.popitem(last=False)
    _known.move_to_end(grounds)
    return _known[grounds]


def _given_everywhere(config: RunConfig, cell: str | None, names: Mapping[str, object]) -> bool:
    """Return True if the body has a field of each parameter, or each region with the cell has."""
    own = [region for region in config.macro.regions.values() if region.cell == cell]
    return all(
        name in config.macro.fields or (own and all(name in region.fields for region in own))
        for name in names
    )


def values_in_body(config: RunConfig, cell: str | None, times: Sequence[float]) -> Iterator[Array]:
    """Yield the parameters (n, m) of a cell at the n points of the body that have it, at ``times``.

    Where no field changes they are yielded once. None names the cell of the rest of the body.

    Raises
    ------
    ConfigurationError
        Fields do not suit the body.
    """
    fields = BodyFields(config.macro, body_mesh(config.macro), cell_ranges(config))
    columns = [fields.names.index(each.name) for each in cell_of(config, cell).parameters]
    regions = regions_of_cell(config.macro.regions, cell)
    for time in times if fields.varies else (0.0,):
        at = fields.at(time)
        assert at.parameters is not None
        assert at.place is not None
        yield at.parameters[np.isin(at.place.region, regions)][:, columns]


def told_apart(
    values: Iterable[Array], ranges: Mapping[str, tuple[float, float]]
) -> tuple[tuple[float, ...], ...]:
    """Return the rows that differ by steps of the ``ranges`` among values (n, m) at one time after the other.

    Between two times values go on a line from one to the other.
    """
    low, high = np.array(list(ranges.values())).T
    rows, varies = np.zeros((0, len(low)), dtype=np.int64), np.zeros(len(low), dtype=bool)
    first: Array | None = None
    before: IntArray | None = None
    for each in values:
        if not len(each):
            continue
        # Round-off decides nothing, not even half-way between two steps.
        unit = np.clip((each - low) / (high - low), 0, 1).round(DIGITS)
        first = unit[0] if first is None else first
        varies |= (unit != first).any(axis=0)
        here = np.round(unit * LATTICE).astype(np.int64)
        more = here if before is None else _between(before, here)
        rows, before = _distinct(np.concatenate([rows, _distinct(more)])), here
    if first is None:
        return ()
    shares = np.where(varies, rows / LATTICE, first)
    shares = np.unique(shares, axis=0)
    if len(shares) > MOST:
        shares = shares[np.sort(farthest(shares, MOST))]
    found = np.clip(low + (high - low) * shares, low, high)
    return tuple(tuple(float(f"{value:.12g}") for value in row) for row in found.tolist())


def _between(before: IntArray, here: IntArray) -> IntArray:
    """Return the steps (k, m) from ``before`` (n, m) to ``here`` (n, m), both included."""
    m = before.shape[1]
    lines = _distinct(np.concatenate([before, here], axis=1))
    start, end = lines[:, :m], lines[:, m:]
    count = max(int(np.abs(end - start).max(initial=0)), 1)
    shares = np.arange(count + 1)[:, None, None] / count
    steps: IntArray = np.round(start + shares * (end - start)).astype(np.int64)
    return steps.reshape(-1, m)


def _distinct(rows: IntArray) -> IntArray:
    """Return the different rows (k, m) of numbers below 256, as np.unique but for large bodies."""
    packed = np.ascontiguousarray(rows.astype(np.uint8)).view(f"V{rows.shape[1]}").reshape(-1)
    found: IntArray = np.unique(packed).view(np.uint8).reshape(-1, rows.shape[1]).astype(np.int64)
    return found
