"""Check of a batch of responses against its declared fields: types, shapes, numbers, NaN, statuses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.core.fields import RowField, parameter_count, provided_fields
from porocore.states import RESPONSE_FIELDS, CellExtrema, CellResponse, CellSlopes, CellTangent, Status


def response_fault(response: Any, n: int, parameters: int | None = None) -> str | None:
    """Return what is wrong with a response of n states, as a clause that names field and row; None: nothing.

    Rows with values are finite where the declaration says so, the others hold NaN throughout, and every status is a
    :class:`Status`. Slopes are those by ``parameters`` parameters; None: by as many as the first of them says.
    """
    return shape_fault(response, n, parameters) or number_fault(response)


def shape_fault(response: Any, n: int, parameters: int | None = None) -> str | None:
    """Return which field is missing, or has not the shape or type that n states must have; None: none."""
    if not isinstance(response, CellResponse):
        return f"expected a CellResponse, got {type(response).__name__}"
    nested = {CellTangent: response.tangent, CellSlopes: response.slopes, CellExtrema: response.extrema}
    for kind, batch in nested.items():
        if batch is not None and not isinstance(batch, kind):
            return f"expected a {kind.__name__}, got {type(batch).__name__}"
    found = provided_fields(response)
    m = parameter_count(RESPONSE_FIELDS, found) if parameters is None else parameters
    for name, array in found.items():
        declared = RESPONSE_FIELDS[name]
        expected = (n, *declared.row_shape(m or 0))
        if not isinstance(array, np.ndarray):
            return f"{name}: expected an array of shape {expected}, got {type(array).__name__}"
        if array.shape != expected:
            return f"{name}: expected shape {expected}, got {array.shape}"
        if not np.can_cast(array.dtype, declared.dtype, "same_kind"):
            return f"{name}: expected numbers of type {np.dtype(declared.dtype).name}, got {array.dtype}"
    for name in ("status", "mean_grad"):
        if name not in found:
            return f"{name}: is missing"
    return None


def number_fault(response: CellResponse) -> str | None:
    """Return which row of which field, all of the right shape, holds what does not belong there; None: none."""
    unknown = ~known_statuses(response.status)
    if unknown.any():
        at = int(unknown.argmax())
        return f"status: {int(response.status[at])} of row {at} is no status"
    found, valid = provided_fields(response), response.valid
    unstable = response.status == Status.unstable
    for name, array in found.items():
        # Most rows are as they should be: one pass over the numbers shows it.
        if valid.all() and np.isfinite(array).all():
            continue
        wrong = ~rows_as_declared(RESPONSE_FIELDS[name], array, valid, unstable)
        if wrong.any():
            at = int(wrong.argmax())
            status = Status(int(response.status[at])).name
            what = "numbers that are not finite" if valid[at] else "values, and NaN belongs there"
            return f"{name}: row {at}, with status '{status}', holds {what}"
    return None


def rows_as_declared(
    declared: RowField, array: npt.NDArray[Any], valid: npt.NDArray[np.bool_], unstable: npt.NDArray[np.bool_]
) -> npt.NDArray[np.bool_]:
    """Return which rows of a field hold numbers where they should and NaN where none belong, (n,).

    The derivatives and slopes of an unstable state may be missing: a solver for definite matrices does not find them.
    """
    if not np.issubdtype(array.dtype, np.floating):
        return np.ones(len(array), dtype=bool)
    flat = array.reshape(len(array), math.prod(array.shape[1:]))
    missing = np.isnan(flat).all(axis=1)
    numbers = np.isfinite(flat).all(axis=1)
    if declared.gaps:
        numbers |= missing
    elif declared.flag in ("tangent", "slopes"):
        numbers |= missing & unstable
    return np.where(valid, numbers, missing)


def known_statuses(status: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Return which codes (n,) are a :class:`Status`."""
    return np.isin(status, [int(known) for known in Status])
