"""Cell solvers for states of several members of a family, prepared as they come (MemberSolver), and at rest."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from porocore.core.fields import provided_fields
from porocore.core.parallel.calls import CycleCollection
from porocore.errors import ConfigurationError, MemberError
from porocore.interfaces.cell import CellField, CellSolution, CellSolver
from porocore.interfaces.law import UndeformedCells
from porocore.interfaces.records import failed_response
from porocore.plugins.border import conductivity_of, solution_of
from porocore.states import Array, CellResponse, CellSlopes, MacroState, Status

#: Prepared members that are kept, those that were used last: meshes and factors of each take memory.
MOST_MEMBERS = 4


@dataclass(eq=False)
class PreparedFamily:
    """Members of a family that are prepared, and what those have in common.

    Attributes
    ----------
    cell
        The family.
    how
        Keywords with which each member is prepared.
    members
        Prepared members by their parameters, the one used last at the end; or the reason why there is none.
    like
        Response of a member with derivatives and one without, as patterns for those that are missing.
    """

    cell: Any
    how: dict[str, Any]
    members: OrderedDict[bytes, Any] = field(default_factory=OrderedDict)
    like: dict[bool, CellResponse] = field(default_factory=dict)


@dataclass(frozen=True)
class NoMember:
    """Reason why there is no cell with some parameters."""

    reason: str


class MemberSolver(CellSolver[PreparedFamily]):
    """Cell solver that prepares a member of a family for each state that has other parameters.

    It keeps the members that were used last. States at parameters at which there is no cell, or whose mesh cannot
    follow them, have the status ``inverted``.

    Parameters
    ----------
    solver
        Solves the states of one member.
    kept
        Number of prepared members that are kept.
    collection
        Frees the others.
    """

    def __init__(
        self, solver: CellSolver[Any], kept: int = MOST_MEMBERS, collection: CycleCollection | None = None
    ) -> None:
        self._solver, self._kept, self._collection = solver, kept, collection or CycleCollection()

    def prepare(self, cell: Any, **how: Any) -> PreparedFamily:
        """Return the family, of which no member is prepared yet."""
        return PreparedFamily(cell, how)

    def member(self, prepared: PreparedFamily, parameters: Array) -> Any:
        """Return the member with the parameters (m,) as the solver prepares it.

        Raises
        ------
        MemberError
            There is none.
        """
        found = self._member(prepared, parameters)
        if isinstance(found, NoMember):
            raise MemberError(found.reason)
        return found

    def why_missing(self, prepared: PreparedFamily, states: MacroState) -> list[str]:
        """Prepare the members of n states, and return the reasons why some of them are missing."""
        found = (self._member(prepared, values) for values in _different(states)[0])
        return [one.reason for one in found if isinstance(one, NoMember)]

    def conductivity_at(self, prepared: PreparedFamily, parameters: Array) -> Array:
        """Return K (3, 3) of the member with the parameters (m,); errors as in :meth:`member`."""
        return conductivity_of(self._solver, self.member(prepared, parameters))

    def remark(self, prepared: PreparedFamily) -> str:
        """Return the remark of the solver on the member that was used last."""
        last = next(reversed(prepared.members.values()), None)
        return "" if last is None or isinstance(last, NoMember) else self._solver.remark(last)

    def solve(
        self,
        prepared: PreparedFamily,
        states: MacroState,
        *,
        start: Sequence[CellField | None] | None = None,
        tangent: bool = True,
        fields: bool = False,
    ) -> CellSolution:
        """Return the solutions of n states with their parameters; those of one member are solved together.

        Raises
        ------
        ConfigurationError
            The states have no parameters.
        """
        values, of_row = _different(states)
        responses: list[CellResponse | None] = [None] * len(states)
        reached: list[CellField | None] | None = None
        for k, theta in enumerate(values):
            rows = np.flatnonzero(of_row == k)
            member = self._member(prepared, theta)
            if isinstance(member, NoMember):
                continue
            how: dict[str, Any] = {} if start is None else {"start": [start[i] for i in rows]}
            own = states[rows].with_parameters(None)
            solution = solution_of(self._solver, member, own, tangent=tangent, fields=fields, **how)
            prepared.like[tangent] = solution.response[:1]
            if solution.fields is not None and reached is None:
                reached = [None] * len(states)
            for j, i in enumerate(rows):
                responses[i] = solution.response[j : j + 1]
                if reached is not None and solution.fields is not None:
                    reached[i] = solution.fields[j]
        like = self._pattern(prepared, tangent) if not responses or None in responses else None
        whole = [failed_response(Status.inverted, like=like) if one is None else one for one in responses]
        return CellSolution(
            CellResponse.concatenate(whole) if whole else self._pattern(prepared, tangent)[:0], reached
        )

    def _pattern(self, prepared: PreparedFamily, tangent: bool) -> CellResponse:
        """Return a response of a member; that of the middle one at rest where none was solved yet."""
        if tangent not in prepared.like:
            middle = [(one.lower + one.upper) / 2 for one in prepared.cell.parameters]
            member = self._solver.prepare(prepared.cell.at(middle), **prepared.how)
            prepared.like[tangent] = solution_of(
                self._solver, member, MacroState.zeros(1), tangent=tangent
            ).response
        return prepared.like[tangent]

    def _member(self, prepared: PreparedFamily, parameters: Array) -> Any:
        key = np.ascontiguousarray(parameters, dtype=float).tobytes()
        if key not in prepared.members:
            while len(prepared.members) >= self._kept:
                prepared.members.popitem(last=False)
                # Factors and meshes refer to one another; Python would find them when some gigabytes are gone.
                self._collection.offer()
            try:
                member = prepared.cell.at(parameters)
                prepared.members[key] = self._solver.prepare(member, **prepared.how)
            except MemberError as error:
                prepared.members[key] = NoMember(str(error))
        prepared.members.move_to_end(key)
        return prepared.members[key]


class UndeformedMemberSolver(MemberSolver):
    """Cell solver of the members of a family at rest: their responses hold K of the undeformed pore as well.

    Members may lack parameters of the family, which they do not depend on: slopes by those are zero.
    """

    def solve(self, prepared: PreparedFamily, states: MacroState, **how: Any) -> CellSolution:
        """Return the solutions of n undeformed states with their parameters.

        Raises
        ------
        ConfigurationError
            The states have no parameters.
        ValueError
            A state is deformed, or has a pressure.
        """
        if states.grad_u.any() or states.p.any():
            raise ValueError("expected undeformed states, H = 0 and p = 0")
        found = super().solve(prepared, states, **how)
        response, theta = found.response, _parameters(states)
        K, volume = np.full((len(states), 3, 3), np.nan), np.full(len(states), np.nan)
        slopes = response.slopes
        own = self._own(prepared.cell) if slopes is not None else []
        hessian = None if slopes is None else np.full((len(states), 10, 10, len(own)), np.nan)
        for i in np.flatnonzero(response.valid):
            K[i], volume[i] = self.conductivity_at(prepared, theta[i]), 1.0
            if hessian is not None:
                hessian[i] = self._solver.hessian_slopes_at_rest(self.member(prepared, theta[i]))
        if slopes is not None:
            slopes = _among(replace(slopes, hessian=hessian), own, len(prepared.cell.parameters))
        whole = replace(response, conductivity=K, min_fluid_jacobian=volume, slopes=slopes)
        return CellSolution(whole, found.fields)

    @staticmethod
    def _own(family: Any) -> list[int]:
        """Return the places of the parameters of the members among those of the family."""
        names = [one.name for one in family.parameters]
        member = family.at([(one.lower + one.upper) / 2 for one in family.parameters])
        return [names.index(one.name) for one in member.parameters]


class MembersAtRest:
    """Porosity and conductivity of undeformed members, each solved when it is first asked for and then known.

    Parameters
    ----------
    solver, prepared
        Solver of the members, and the family of them as they are before they swell.
    """

    def __init__(self, solver: MemberSolver, prepared: PreparedFamily) -> None:
        self._solver, self._prepared = solver, prepared
        self._known: dict[bytes, tuple[float, Array]] = {}

    def __call__(self, parameters: Array) -> UndeformedCells:
        """Return φ_f and K of the members with ``parameters`` (n, m).

        Raises
        ------
        MemberError
            There is no cell with some of the parameters.
        """
        values, of_row = np.unique(np.asarray(parameters, float), axis=0, return_inverse=True)
        found = [self._of(theta) for theta in values]
        porosity, K = (np.array(each) for each in zip(*found, strict=True))
        rows = of_row.reshape(-1)
        return UndeformedCells(porosity[rows], K[rows])

    def _of(self, theta: Array) -> tuple[float, Array]:
        key = np.ascontiguousarray(theta).tobytes()
        if key not in self._known:
            K = self._solver.conductivity_at(self._prepared, theta)
            state = MacroState.zeros(1).with_parameters(theta)
            rest = solution_of(self._solver, self._prepared, state, tangent=False, fields=False)
            volume = rest.response.fluid_volume
            assert volume is not None
            self._known[key] = float(volume[0]), K
        return self._known[key]


def _among(slopes: CellSlopes, own: Sequence[int], m: int) -> CellSlopes:
    """Return slopes by m parameters from those by some; by the others they are zero, or NaN where there are none."""
    found: dict[str, Array] = {}
    for name, value in provided_fields(slopes).items():
        found[name] = np.zeros(m) * value[..., :1]
        found[name][..., own] = value
    return CellSlopes(**found)


def _parameters(states: MacroState) -> Array:
    """Return the parameters (n, m) of states that have to have some."""
    if states.parameters is None:
        raise ConfigurationError(
            "expected the parameters of the cell with every state, got none; give them with it"
        )
    return states.parameters


def _different(states: MacroState) -> tuple[Array, Array]:
    """Return the different parameters (k, m) of n states in order of appearance, and which each state has (n,)."""
    values, first, of_row = np.unique(_parameters(states), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return values[order], place[of_row.reshape(-1)]
