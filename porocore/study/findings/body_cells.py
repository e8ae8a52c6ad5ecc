"""Cells of the body of a run for its report, and linear poroelasticity at rest of its elements."""

from __future__ import annotations

from contextlib import ExitStack

import numpy as np

from porocore.cell.family.parameters import parameter_quantities
from porocore.interfaces.law import CellLaw
from porocore.interfaces.solution import MacroSolution
from porocore.macro.composition.linearised_law import RestCoefficients, coefficients_of_elements
from porocore.macro.composition.regions import regions_of_cell
from porocore.macro.laws.linear import LinearCoefficients
from porocore.report.words.body_cells import BodyCells, volumes_of
from porocore.states import Array, IntArray
from porocore.study.stages.laws import macro_laws
from porocore.study.stages.results import RunResults


def body_solution(results: RunResults) -> MacroSolution:
    """Return the solution of the first load with the closure that is shown."""
    return results.solutions[results.config.macro.loads[0]][results.config.closure]


def rest_of_body(results: RunResults) -> LinearCoefficients | RestCoefficients:
    """Return linear poroelasticity at rest of the elements at first; of one cell everywhere that of the cell."""
    cells, config = body_solution(results).element_cells, results.config
    if cells is None:
        return results.coefficients
    with ExitStack() as stack:
        law = macro_laws(results.folder, config, stack, ("surrogate",))[config.closure].law
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
