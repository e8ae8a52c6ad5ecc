"""One solved state, and how batches of responses are laid out as named arrays in a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.errors import PluginError
from porocore.interfaces.cell import CellField
from porocore.states import Array, CellPeaks, CellResponse, CellTangent, MacroState

#: Shape of one row of every response that a file may hold; ``group/name`` is an attribute of a nested batch.
LAYOUT: dict[str, tuple[int, ...]] = {
    "mean_grad": (3, 3),
    "potential": (),
    "stress": (3, 3),
    "fluid_volume": (),
    "conductivity": (3, 3),
    "min_fluid_jacobian": (),
    "tangent/mean_grad_grad_u": (3, 3, 3, 3),
    "tangent/mean_grad_p": (3, 3),
    "tangent/stress_grad_u": (3, 3, 3, 3),
    "tangent/stress_p": (3, 3),
    "tangent/fluid_volume_grad_u": (3, 3),
    "tangent/fluid_volume_p": (),
    "peaks/grad": (3, 3),
    "peaks/energy": (),
    "peaks/energy_mean": (),
    "peaks/min_jacobian": (),
    "peaks/min_gap": (),
    "peaks/contact_share": (),
    "peaks/negative_pivots": (),
}


@dataclass(frozen=True, eq=False)
class Record:
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
    """The provided responses of n states by their names in :data:`LAYOUT`, without the status."""
    arrays: dict[str, Array] = {}
    for name in LAYOUT:
        value: Any = response
        for attribute in name.split("/"):
            value = None if value is None else getattr(value, attribute)
        if value is not None:
            arrays[name] = np.asarray(value, dtype=np.float64)
    return arrays


def build_response(status: Any, arrays: Mapping[str, Array]) -> CellResponse:
    """The inverse of :func:`flatten_response`.

    Raises
    ------
    ValueError
        An array has not the shape that :data:`LAYOUT` says, or a batch of peaks is incomplete.
    """
    status = np.asarray(status, dtype=np.int64)
    for name, array in arrays.items():
        if array.shape != (len(status), *LAYOUT[name]):
            raise ValueError(f"{name}: expected shape {(len(status), *LAYOUT[name])}, got {array.shape}")
    plain: dict[str, Any] = {name: array for name, array in arrays.items() if "/" not in name}
    if "mean_grad" not in plain:
        raise ValueError("mean_grad is missing")
    nested: dict[str, dict[str, Array]] = {"tangent": {}, "peaks": {}}
    for name in arrays.keys() - plain.keys():
        group, attribute = name.split("/")
        nested[group][attribute] = arrays[name]
    lacking = {name for name in LAYOUT if name.startswith("peaks/")} - arrays.keys()
    if nested["peaks"] and lacking:
        raise ValueError(f"{', '.join(sorted(lacking))} missing")
    return CellResponse(
        status=status,
        tangent=CellTangent(**nested["tangent"]) if nested["tangent"] else None,
        peaks=CellPeaks(**nested["peaks"]) if nested["peaks"] else None,
        **plain,
    )


def check_record(record: Record, provided: frozenset[str] | None) -> frozenset[str]:
    """Names of the responses in ``record``, after checking what a cell solver returned.

    Parameters
    ----------
    record
        The finished solve.
    provided
        Names that the other records of the dataset hold; None: this is the first.

    Raises
    ------
    PluginError
        The response is not one row of the documented shapes, or holds other responses than its neighbours.
    """
    arrays = flatten_response(record.response)
    for name, array in arrays.items():
        if array.shape != (1, *LAYOUT[name]):
            raise PluginError(
                f"the cell solver returned {name} of shape {array.shape} for state '{record.key}'; "
                f"expected {(1, *LAYOUT[name])}: report this to the author of the backend"
            )
    names = frozenset(arrays)
    if provided is not None and names != provided:
        raise PluginError(
            f"the cell solver returned other responses for state '{record.key}' than before (difference: "
            f"{', '.join(sorted(names ^ provided))}); a failed state must hold NaN in every response: "
            "report this to the author of the backend"
        )
    return names
