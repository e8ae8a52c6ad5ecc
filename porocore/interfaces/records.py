"""One solved state (SolvedState), responses as named arrays for files, check of a record."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.core.fields.check import response_fault
from porocore.core.fields.declaration import parameter_count, provided_fields
from porocore.errors import PluginError
from porocore.interfaces.cell import CellField
from porocore.states import (
    CELL_FIELDS,
    Array,
    CellExtrema,
    CellResponse,
    CellSlopes,
    CellTangent,
    MacroState,
    Status,
)


@dataclass(frozen=True, eq=False)
class SolvedState:
    """One finished solve.

    Attributes
    ----------
    key
        Name of the state within the run.
    x
        Values of the sampled inputs, d of them.
    state
        The whole macroscopic state, one row.
    response
        What the cell answered, one row; NaN where its status has no values.
    seconds
        Wall time of the solve.
    start
        Key of the state whose field the solve started from; None: the undeformed cell.
    field
        u¹ at the solution; None where it failed or was not asked for.
    """

    key: str
    x: tuple[float, ...]
    state: MacroState
    response: CellResponse
    seconds: float
    start: str | None = None
    field: CellField | None = None


def flatten_response(response: CellResponse) -> dict[str, Array]:
    """Return the provided responses of n states by their names in ``CELL_FIELDS``, without the status."""
    provided = provided_fields(response)
    return {name: np.asarray(provided[name], dtype=np.float64) for name in CELL_FIELDS if name in provided}


def build_response(status: Any, arrays: Mapping[str, Array]) -> CellResponse:
    """Return the response of n states that :func:`flatten_response` took apart.

    Raises
    ------
    ValueError
        A name or the shape of an array is not that of ``CELL_FIELDS``, or the batch of extrema is incomplete.
    """
    status = np.asarray(status, dtype=np.int64)
    if unknown := [name for name in arrays if name not in CELL_FIELDS]:
        raise ValueError(f"'{unknown[0]}' is no response")
    m = parameter_count(CELL_FIELDS, arrays)
    for name, array in arrays.items():
        expected = (len(status), *CELL_FIELDS[name].row_shape(m or 0))
        if array.shape != expected:
            raise ValueError(f"{name}: expected shape {expected}, got {array.shape}")
    plain: dict[str, Any] = {name: array for name, array in arrays.items() if "/" not in name}
    if "mean_grad" not in plain:
        raise ValueError("mean_grad is missing")
    nested: dict[str, dict[str, Array]] = {"tangent": {}, "slopes": {}, "peaks": {}}
    for name in arrays.keys() - plain.keys():
        group, attribute = name.split("/")
        nested[group][attribute] = arrays[name]
    lacking = {name for name in CELL_FIELDS if name.startswith("peaks/")} - arrays.keys()
    if nested["peaks"] and lacking:
        raise ValueError(f"{', '.join(sorted(lacking))} missing")
    return CellResponse(
        status=status,
        tangent=CellTangent(**nested["tangent"]) if nested["tangent"] else None,
        slopes=CellSlopes(**nested["slopes"]) if nested["slopes"] else None,
        extrema=CellExtrema(**nested["peaks"]) if nested["peaks"] else None,
        **plain,
    )


def failed_response(
    status: Status,
    *,
    tangent: bool = True,
    deformed: bool = False,
    parameters: int | None = None,
    names: Iterable[str] | None = None,
    like: CellResponse | None = None,
) -> CellResponse:
    """Return the row of a state without values: NaN in every response.

    Parameters
    ----------
    status
        Why there are none.
    tangent
        Also in the derivatives.
    deformed
        Also in the conductivity of the deformed pore.
    parameters
        Number of the cell's parameters: also in the slopes by them; None: the response has no slopes.
    names
        The responses instead, by their names in ``porocore.states.CELL_FIELDS``.
    like
        A response of the same cell, whose fields it shall hold instead.
    """
    if like is not None:
        found = flatten_response(like)
        names, parameters = found, parameter_count(CELL_FIELDS, found)
    if names is None:
        asked = {"": True, "tangent": tangent, "deformed": deformed, "slopes": parameters is not None}
        names = [name for name, declared in CELL_FIELDS.items() if asked.get(declared.flag)]
    shapes = {name: (1, *CELL_FIELDS[name].row_shape(parameters)) for name in names}
    return build_response([int(status)], {name: np.full(shape, np.nan) for name, shape in shapes.items()})


def check_record(record: SolvedState, provided: frozenset[str] | None) -> frozenset[str]:
    """Return the names of the responses in ``record``, after checking what a cell solver returned.

    Parameters
    ----------
    record
        The finished solve.
    provided
        Names that the other records of the dataset hold; None: this is the first.

    Raises
    ------
    PluginError
        The response is not one row of the declared fields, has slopes by another number of parameters than its state,
        or holds other responses than its neighbours.
    """
    if fault := response_fault(record.response, 1, record.state.parameter_count or None):
        raise PluginError(
            f"the cell solver returned a wrong response for state '{record.key}': {fault}; report this to the author "
            "of the backend"
        )
    names = frozenset(flatten_response(record.response))
    if provided is not None and names != provided:
        raise PluginError(
            f"the cell solver returned other responses for state '{record.key}' than before (difference: "
            f"{', '.join(sorted(names ^ provided))}); a failed state must hold NaN in every response: "
            "report this to the author of the backend"
        )
    return names
