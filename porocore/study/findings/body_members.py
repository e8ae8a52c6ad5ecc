"""Linear poroelasticity of a body of a family's cells, by a few undeformed members that are like its cells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from porocore.core.files.store import ResultStore
from porocore.interfaces.law import MacroLaw
from porocore.macro.composition.kept_cells import cells_of_elements
from porocore.macro.composition.linearised_law import RestCoefficients, coefficients_of_elements
from porocore.macro.composition.member_law import NearestMemberLaw
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.macro.problem import body_mesh
from porocore.report.format import number
from porocore.states import Array
from porocore.study.config.body_parameters import values_in_body
from porocore.study.config.config import RunConfig
from porocore.study.stages.reference import undeformed

#: Members that are solved at most.
MOST = 6
#: So near to the next member, as a share of the ranges, cells count as it.
NEAR = 0.05


@dataclass(frozen=True, eq=False)
class BodyMembers:
    """Undeformed members of a family that are like the cells of a body.

    Attributes
    ----------
    values : (k, m)
        Their parameters.
    coefficients
        Linear poroelasticity of each.
    """

    names: tuple[str, ...]
    values: Array
    coefficients: tuple[LinearCoefficients, ...]
    law: MacroLaw

    @classmethod
    def solved(
        cls, config: RunConfig, store: ResultStore | None, most: int = MOST, cell: str | None = None
    ) -> BodyMembers:
        """Solve the members, or take them from the store; ``most`` of them, and no more than :data:`MOST`.

        ``cell`` is the name of the family; None names that of the rest of the body.

        Raises
        ------
        ConfigurationError
            Fields do not suit the body, or a member is no cell.
        PorocoreError
            A member cannot be solved.
        """
        family = config.of_cell(cell).cell
        ranges = {each.name: (each.lower, each.upper) for each in family.parameters}
        end = config.macro.time.end
        there = np.concatenate(list(values_in_body(config, cell, (0.0, end / 2, end))))
        values = spread(there, ranges, min(most, MOST))
        found = []
        for row in values:
            member = family.at(row)
            at = undeformed(member, config.fem, config.conductivity, store)
            found.append(
                LinearCoefficients.from_reference(
                    at.response, at.solid_fraction, member.solid, at.conductivity
                )
            )
        law = NearestMemberLaw([*map(LinearPoroelasticity, found)], values, ranges)
        return cls(tuple(ranges), values, tuple(found), law)

    def as_lines(self, config: RunConfig) -> Iterator[str]:
        """Yield the parameters of the members and their least and largest moduli and conductivities."""
        ends = ", ".join(f"{name} {_from_to(self.values[:, k])}" for k, name in enumerate(self.names))
        count = len(self.values)
        yield (
            f"over the body, by {count} of its cells with {ends}:"
            if count > 1
            else f"in the body, with {ends}:"
        )
        units = config.result_units
        moduli = np.array([np.einsum("iiii->i", c.stiffness) for c in self.coefficients])
        K = np.array([np.diag(c.conductivity) for c in self.coefficients])
        E = units.name("stress") if units.given else "E"
        conducted = f" {units.name('conductivity')}" if units.given else ""
        yield (
            f"  confined modulus {_from_to(moduli * units.factor('stress'))} {E}; conductivity K "
            f"{_from_to(K * units.factor('conductivity'))}{conducted}"
        )


def linear_in_body(
    config: RunConfig, law: MacroLaw, coefficients: LinearCoefficients
) -> LinearCoefficients | RestCoefficients:
    """Return linear poroelasticity of the elements of a body at first; of one cell everywhere its ``coefficients``."""
    cells = cells_of_elements(config.macro, body_mesh(config.macro), law, [0.0])
    return coefficients if cells is None else coefficients_of_elements(law, cells)


def spread(values: Array, ranges: dict[str, tuple[float, float]], most: int) -> Array:
    """Return rows of ``values`` (n, m) near which all others lie, ``most`` of them: the middle one, then the farthest.

    Distances are shares of the ranges.
    """
    low, high = np.array(list(ranges.values())).T
    unit = (values - low) / (high - low)
    chosen = [int(np.linalg.norm(unit - unit.mean(axis=0), axis=1).argmin())]
    away = np.full(len(unit), np.inf)
    while True:
        away = np.minimum(away, np.linalg.norm(unit - unit[chosen[-1]], axis=1))
        if len(chosen) >= most or away.max() <= NEAR:
            return values[chosen]
        chosen.append(int(away.argmax()))


def _from_to(values: Array) -> str:
    """Return the least and the largest value, or the only one."""
    low, high = (number(float(end(values)), 3) for end in (np.min, np.max))
    return low if low == high else f"{low} to {high}"
