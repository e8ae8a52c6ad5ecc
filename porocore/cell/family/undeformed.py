"""Undeformed members as data to learn from (rest_data): kinds of parameters, moduli of the solid."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from annotated_types import Ge, Gt
from pydantic.fields import FieldInfo

from porocore.cell.materials.energy import SWELLING
from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.core.models.walk import Place, walk
from porocore.core.units.dimensions import Unit
from porocore.interfaces.rest_data import ParameterKind, RestData, rest_count
from porocore.states import CellResponse, MacroState

if TYPE_CHECKING:
    from porocore.cell.cell import Cell
    from porocore.cell.family.parameters import CellParameter

#: Name of Poisson's ratio in a material.
POISSON = "poisson_ratio"


def parameter_kinds(cell: Cell) -> tuple[ParameterKind, ...]:
    """Return the kind of each parameter of a cell, as :class:`~porocore.interfaces.rest_data.RestData` has them."""
    places = {place.path: place for place in walk(type(cell), cell)}
    return tuple(_kind(parameter, places[parameter.path]) for parameter in cell.parameters)


def _kind(parameter: CellParameter, place: Place) -> ParameterKind:
    if parameter.shape:
        unit = place.metadata if place.above is None else place.metadata + place.above.metadata
        length = any(isinstance(each, Unit) for each in unit)
        declared = [each.metadata if isinstance(each, FieldInfo) else [each] for each in place.metadata]
        not_negative = any(isinstance(each, Gt | Ge) for each in chain.from_iterable(declared))
        return "length" if length and not_negative and parameter.lower > 0 else "other"
    if parameter.path == ("viscosity",):
        return "viscosity"
    if parameter.path[-1] == POISSON:
        return "poisson_ratio"
    return "swelling" if parameter.path[-1] == SWELLING and parameter.region is None else "other"


def isotropic_solid(cell: Cell) -> tuple[float | None, float | str | None]:
    """Return Young's modulus [E] and Poisson's ratio of small strains, or the parameter that this is; None, None.

    They are known where the solid is isotropic and the same everywhere, and varies in Poisson's ratio alone.
    """
    material = cell.material
    if cell.materials is not None or material is None or not material.isotropic:
        return None, None
    varied = [each for each in cell.parameters if each.solid_key and each.solid_key != (SWELLING,)]
    if not varied:
        young, shear = material.mean_moduli()
        return young, young / (2 * shear) - 1
    only = varied[0]
    if len(varied) == 1 and isinstance(material, NeoHookean) and only.solid_key == (POISSON,):
        return material.mean_moduli()[0], only.name
    return None, None


def undeformed_count(cell: Cell) -> int:
    """Return how many undeformed members describe a family; a swelling and the viscosity need none of their own."""
    learned = [kind for kind in parameter_kinds(cell) if kind not in ("swelling", "viscosity")]
    return rest_count(len(learned), isotropic=isotropic_solid(cell)[1] is not None)


@dataclass(frozen=True)
class UnstressedFamily:
    """Family of the members as they are before their whole solid swells, which is no parameter of theirs.

    Where regions have swelling stretches of their own they stay, and the members have a stress.

    Attributes
    ----------
    family
        The family, whose values of parameters choose the members.
    """

    family: Cell

    @property
    def parameters(self) -> tuple[CellParameter, ...]:
        """Parameters of the family."""
        return self.family.parameters

    def at(self, values: npt.ArrayLike) -> Cell:
        """Return the member with the parameters (m,), without stress if there is such a state.

        Raises
        ------
        ConfigurationError
            There is none.
        """
        return self.family.at(values).unstressed


def rest_data(cell: Cell, states: MacroState, responses: CellResponse) -> RestData:
    """Return the solved undeformed members of a family, and what the cell tells of its parameters.

    Parameters
    ----------
    cell
        The family.
    states, responses
        Its undeformed members, before their whole solid swells, with their conductivity and the slopes of the
        Hessian; those without a stable response are left out.
    """
    good = np.flatnonzero(responses.stable)
    states, responses = states[good], responses[good]
    hessian = None if responses.slopes is None else responses.slopes.hessian
    kinds, (young, poisson) = parameter_kinds(cell), isotropic_solid(cell)
    theta, fluid = states.parameters, responses.fluid_volume
    assert theta is not None
    assert fluid is not None
    stressed = cell.materials is not None and (cell.solid.swells or any(map(_swells, cell.parameters)))
    dry = theta.copy()
    dry[:, [kind == "swelling" for kind in kinds]] = 1.0
    varied = "swelling" in kinds or cell.material is None
    return RestData(
        states.with_parameters(dry),
        responses,
        np.array([cell.at(values).mesh_porosity for values in theta]) if stressed else fluid,
        kinds,
        young,
        poisson,
        hessian if hessian is None or np.isfinite(hessian).all() else None,
        1.0 if varied or cell.material is None else cell.material.swelling,
    )


def _swells(parameter: CellParameter) -> bool:
    return parameter.path[-1] == SWELLING
