"""Solved states as records for files (SolvedState), and undeformed members of a family (RestData)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from porocore.core.field_check import response_fault
from porocore.core.fields import parameter_count, provided_fields
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


#: Kinds of parameters. ``length``: positive number of the pores' shape; ``poisson_ratio``: that of a solid;
#: ``modulus``: Young's modulus of the whole solid; ``swelling``: stretch of the whole solid; ``viscosity``: that of the
#: fluid; ``other``: anything else.
ParameterKind = Literal["length", "poisson_ratio", "modulus", "swelling", "viscosity", "other"]
KINDS: tuple[ParameterKind, ...] = get_args(ParameterKind)


@dataclass(frozen=True, eq=False)
class RestData:
    """Solved undeformed members of a family, k of them, and what is known of its m parameters.

    They are linear solves, far cheaper than states. A solid that swells as a whole is solved before it swells, or at
    the stretch at which it is free of stress; one whose regions swell differently is held.

    Attributes
    ----------
    states
        States with H = 0 (or that stretch) and p = 0, and the parameters (k, m).
    responses
        Responses with their derivatives and the conductivity K (k, 3, 3) of the undeformed pore, without a pressure of
        their own. Slopes by the parameters are used where there are some: those of porosity and conductivity too.
    porosity : (k,)
        φ_f of the undeformed cell.
    kinds
        Kind of each parameter.
    young, poisson : float, text or None
        Young's modulus and Poisson's ratio of small strains of the solid, if it is isotropic and the same everywhere; a
        text is the name of the parameter that it is. None: the solid is not so.
    stretch : float
        Swelling stretch of the whole solid of the family where that is a number; the members here are of 1.
    stiffness_slopes : (k, 10, 10, m) or None
        Slopes of the second derivatives of W by H, row by row, and p at fixed (H, p).

    Examples
    --------
    >>> from porocore.testing.synthetic.porous_family import rest_data
    >>> rests = rest_data(12)
    >>> rests.states.parameters.shape, rests.stiffness_slopes.shape
    ((12, 2), (12, 10, 10, 2))
    """

    states: MacroState
    responses: CellResponse
    porosity: Array
    kinds: tuple[ParameterKind, ...]
    young: float | str | None = None
    poisson: float | str | None = None
    stiffness_slopes: Array | None = None
    stretch: float = 1.0

    def __len__(self) -> int:
        return len(self.states)


def rest_count(parameters: int, *, isotropic: bool = True) -> int:
    """Return how many undeformed members describe a family of m parameters: 10, 20, 40, 75, at most 150.

    Twice as many where the solid is not isotropic and the same everywhere, so that <∇u¹> follows from no other data.
    """
    m = parameters
    # Coefficients of a polynomial of degree 4, and five more: with slopes two and more equations for each.
    found = min(5 + (m + 1) * (m + 2) * (m + 3) * (m + 4) // 24, 150)
    return found if isotropic else 2 * found
