"""Cells of the body of a run for its report, and linear poroelasticity at rest of its elements."""

from __future__ import annotations

from contextlib import ExitStack

from porocore.cell.family.parameters import parameter_quantities
from porocore.interfaces.law import CellLaw
from porocore.interfaces.solution import MacroSolution
from porocore.macro.composition.linearised_law import RestCoefficients, coefficients_of_elements
from porocore.macro.laws.linear import LinearCoefficients
from porocore.report.words.body_cells import BodyCells, volumes_of
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
    surrogate: CellLaw = results.surrogates[config.closure]
    values = cells.values_at(0)
    undeformed = None if values is None else surrogate.undeformed(values)
    return BodyCells(
        cells,
        tuple(profile.time for profile in solution.profiles),
        volumes_of(solution),
        rest.conductivity,
        None if undeformed is None else undeformed.porosity,
        parameter_quantities(config.cell),
    )
