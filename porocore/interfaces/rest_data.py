"""Undeformed members of a family of cells (RestData), by which a surrogate is exact at rest for every θ."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from porocore.states import Array, CellResponse, MacroState

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
