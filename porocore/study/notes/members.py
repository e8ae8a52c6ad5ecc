"""Cells of the body of a run: members that are like them, their linear law, what they cost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from porocore.cell.family.family import parameter_quantities
from porocore.core.files.store import ResultStore
from porocore.core.units import ResultUnits
from porocore.interfaces.law import CellLaw, MacroLaw
from porocore.interfaces.solution import MacroSolution
from porocore.macro.composition.body_fields import cells_of_elements
from porocore.macro.composition.linearised_law import RestCoefficients, coefficients_of_elements
from porocore.macro.composition.regions import NearestMemberLaw, regions_of_cell
from porocore.macro.laws import CLOSURES
from porocore.macro.laws.direct import direct_records
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.macro.problem import MacroSetup, body_mesh
from porocore.report.context import AdaptiveSurrogateCost, DirectCost
from porocore.report.format import number
from porocore.report.words.parameters import BodyCells, volumes_of
from porocore.states import Array, IntArray, Status
from porocore.study.config.config import RunConfig
from porocore.study.run.composition import macro_laws
from porocore.study.run.folder import RunFiles, direct_law, fallback_law
from porocore.study.run.reference import undeformed
from porocore.study.run.results import RunResults


def body_solution(results: RunResults) -> MacroSolution:
    """Return the solution of the first load with the closure that is shown."""
    return results.solutions[results.config.macro.loads[0]][results.config.closure]


def rest_of_body(results: RunResults) -> LinearCoefficients | RestCoefficients:
    """Return linear poroelasticity at rest of the elements at first; of one cell everywhere that of the cell."""
    cells, config = body_solution(results).element_cells, results.config
    if cells is None:
        return results.coefficients
    with ExitStack() as stack:
        law = macro_laws(results.folder, stack, ("surrogate",))[config.closure].law
        return coefficients_of_elements(law, cells)


def body_cells(results: RunResults, rest: LinearCoefficients | RestCoefficients) -> BodyCells | None:
    """Return the cells of the body; None for a body of one cell without parameters.

    ``rest`` is that of :func:`rest_of_body`.
    """
    solution, config = body_solution(results), results.config
    cells = solution.element_cells
    if cells is None:
        return None
    assert isinstance(rest, RestCoefficients)
    quantities: dict[str, str] = {}
    for each in results.by_cell.values():
        quantities |= parameter_quantities(each.config.cell)
    names = [region.cell for region in config.macro.regions.values()] if config.cells else []
    return BodyCells(
        cells,
        tuple(profile.time for profile in solution.profiles),
        volumes_of(solution),
        rest.conductivity,
        _porosity(results, cells.region),
        quantities,
        tuple(name or "cell" for name in (None, *names)) if config.cells else (),
    )


def _porosity(results: RunResults, region: IntArray) -> Array | None:
    """Return φ_f of the undeformed cells of the elements at first, by their regions; None for a body of one cell."""
    if not results.config.cells and not results.config.cell.is_family:
        return None
    found = np.full(len(region), np.nan)
    for name, each in results.by_cell.items():
        cells = body_solution(each).element_cells
        values = None if cells is None else cells.values_at(0)
        surrogate: CellLaw = each.surrogates[each.config.closure]
        undeformed = None if values is None else surrogate.undeformed(values)
        inside = np.isin(region, regions_of_cell(results.config.macro.regions, name))
        found[inside] = each.reference.porosity if undeformed is None else undeformed.porosity
    return found


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
        there = np.concatenate(list(config.values_in_body(cell, (0.0, end / 2, end))))
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

    def as_lines(self, units: ResultUnits) -> Iterator[str]:
        """Yield the parameters of the members and their least and largest moduli and conductivities."""
        ends = ", ".join(f"{name} {_from_to(self.values[:, k])}" for k, name in enumerate(self.names))
        count = len(self.values)
        yield (
            f"over the body, by {count} of its cells with {ends}:"
            if count > 1
            else f"in the body, with {ends}:"
        )
        moduli = np.array([np.einsum("iiii->i", c.stiffness) for c in self.coefficients])
        K = np.array([np.diag(c.conductivity) for c in self.coefficients])
        E = units.name("stress") if units.given else "E"
        conducted = f" {units.name('conductivity')}" if units.given else ""
        yield (
            f"  confined modulus {_from_to(moduli * units.factor('stress'))} {E}; conductivity K "
            f"{_from_to(K * units.factor('conductivity'))}{conducted}"
        )


def linear_in_body(
    macro: MacroSetup, law: MacroLaw, coefficients: LinearCoefficients
) -> LinearCoefficients | RestCoefficients:
    """Return linear poroelasticity of the elements of a body at first; of one cell everywhere its ``coefficients``."""
    cells = cells_of_elements(macro, body_mesh(macro), law, [0.0])
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


def direct_costs(results: RunResults) -> tuple[DirectCost, ...]:
    """Return the cost of every solution by direct FE² whose cost was recorded."""
    timings, found = results.seconds, []
    for closure, law, load, work in _recorded(results, lambda files: files.direct_work, direct_law):
        seconds = timings.get(f"macro, {law}, load {load:g}")
        if seconds is not None:
            failed = sum(work.get(status.name, 0) for status in Status if not status.has_values)
            counts = (int(work["points"]), int(work["solves"]), int(failed))
            of_surrogate = timings.get(f"macro, {closure}, load {load:g}")
            found.append(DirectCost(law, load, *counts, work["seconds"], seconds, of_surrogate))
    return tuple(found)


def fallbacks_done(results: RunResults) -> tuple[AdaptiveSurrogateCost, ...]:
    """Return the work of the fallback in every solution that has one."""
    found = []
    for _, law, load, work in _recorded(results, lambda files: files.fallback_work, fallback_law):
        solves, failed, learned, refits = (
            int(work[name]) for name in ("solves", "failed", "learned", "refits")
        )
        seconds = work["solve_seconds"], work["fit_seconds"]
        found.append(AdaptiveSurrogateCost(law, load, solves, failed, learned, refits, *seconds))
    return tuple(found)


def _recorded(
    results: RunResults, record: Callable[[RunFiles], Path], law_with: Callable[[str], str]
) -> Iterator[tuple[str, str, float, dict[str, float]]]:
    """Yield closure, law, load and work, of all cells together, of every solution with a law that solves cells."""
    records = [direct_records(record(each.folder)) for each in results.by_cell.values()]
    for load, solutions in results.solutions.items():
        for closure in CLOSURES:
            law = law_with(closure)
            stem = results.folder.solution(law, load).stem
            found = [each[stem] for each in records if stem in each]
            if found and law in solutions:
                names = dict.fromkeys(name for each in found for name in each)
                yield closure, law, load, {name: sum(each.get(name, 0) for each in found) for name in names}
