"""Needs of a study against abilities that its plugins declare: conductivity, parts of a problem."""

from __future__ import annotations

import numpy as np

from porocore.cell.cell import Cell
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import CellSolver
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.sampler import Sampler
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.body.mesh import BodyMesh
from porocore.macro.composition.body_fields import require_composition
from porocore.macro.composition.regions import region_numbers, regions_of_cell
from porocore.macro.problem import MacroSetup
from porocore.study.config.cells import cell_ranges
from porocore.study.config.config import RunConfig


def offers_conductivity(solver: type[CellSolver], which: str) -> bool:
    """Return True if a cell solver computes what the law ``which`` of the conductivity needs."""
    return ("deformed" if which == "deformed" else "piola") in solver.conductivities


def require_conductivity(solver: type[CellSolver], name: str, which: str) -> None:
    """Refuse a cell solver that does not compute a conductivity.

    Parameters
    ----------
    solver, name
        Class and name of the solver.
    which
        Law of the conductivity, as the configuration has it; all but ``deformed`` rest on K of the undeformed cell.

    Raises
    ------
    ConfigurationError
        The conductivity is not among :attr:`~porocore.CellSolver.conductivities`.
    """
    if offers_conductivity(solver, which):
        return
    if not solver.conductivities:
        raise ConfigurationError(
            f"fem.backend: the cell solver '{name}' computes no conductivity, without which no body can be solved; "
            "choose another fem.backend"
        )
    raise ConfigurationError(
        f"conductivity: the cell solver '{name}' does not compute that of the deformed pore; choose "
        f"conductivity: {solver.conductivities[0]} or another fem.backend"
    )


def lacking(solver: type[MacroSolver], problem: MacroSetup) -> str:
    """Return in words what a problem needs and a macro solver does not offer; empty if it offers all."""
    kinds = solver.bodies
    column = kinds is not None and "column" in kinds and problem.is_column
    if kinds is not None and problem.body.kind not in kinds and not column:
        other = "a box that is no confined column" if "column" in kinds and problem.body.kind == "box" else ""
        return f"{other or f'the body {problem.body.kind!r}'} (bodies = {', '.join(kinds)})"
    missing = sorted(problem.parts - solver.parts)
    return f"{' and '.join(missing)} (parts = {', '.join(sorted(solver.parts)) or 'none'})" if missing else ""


def require_parts(solver: type[MacroSolver], name: str, problem: MacroSetup) -> None:
    """Refuse a macro solver that does not offer what a problem needs.

    Raises
    ------
    ConfigurationError
        The solver does not declare the body's kind, or a part of the problem.
    """
    missing = lacking(solver, problem)
    if missing:
        raise ConfigurationError(
            f"macro: this problem needs {missing.partition(' (')[0]}, which the macro solver '{name}' does not offer; "
            "choose another macro.backend, or leave it out"
        )


def require_parameters_sampled(sampler: type[Sampler], name: str, cell: Cell) -> None:
    """Refuse a sampler that draws no parameters for a cell that has some.

    Raises
    ------
    ConfigurationError
        A number of the cell is a range, and the sampler draws no parameters.
    """
    if cell.is_family and not sampler.samples_parameters:
        raise ConfigurationError(
            f"sampling.sampler: '{name}' does not sample cells with parameters, but {cell.parameters[0].key} is a "
            "range; choose another, such as sobol, or give one number"
        )


def require_learner(surrogate: Surrogate, name: str, cell: Cell) -> None:
    """Refuse a surrogate that cannot learn a cell with parameters.

    Parameters
    ----------
    surrogate, name
        The surrogate, and its name.
    cell
        The cell.

    Raises
    ------
    ConfigurationError
        A number of the cell is a range, and the surrogate learns no parameters.
    """
    if surrogate.learns_parameters or not cell.is_family:
        return
    key, model = cell.parameters[0].key, surrogate.model
    if len(type(surrogate).models) > 1:
        raise ConfigurationError(
            f"surrogate.model: {model} of '{name}' learns no cells with parameters, but {key} is a range; set "
            "surrogate.model: potential, or give one number"
        )
    raise ConfigurationError(
        f"surrogate.backend: '{name}' learns no cells with parameters, but {key} is a range; choose one that does, "
        "such as --surrogate polynomial, or give one number"
    )


def require_cells(config: RunConfig, problem: MacroSetup, mesh: BodyMesh) -> None:
    """Refuse a body of which no part has the cell of the rest.

    Raises
    ------
    ConfigurationError
        Every element lies in a region with another cell; or regions are empty or overlap.
    """
    rest = regions_of_cell(problem.regions, None)
    if config.cells and not np.isin(region_numbers(mesh, problem.regions), rest).any():
        raise ConfigurationError(
            "cell: no part of the body has it, since every element lies in a region with another cell; give one of "
            "'cells:' here, at the top level, and leave 'cell:' of its regions out"
        )


def require_fields(config: RunConfig, problem: MacroSetup, mesh: BodyMesh) -> None:
    """Refuse regions and fields that do not suit the mesh or the parameters of the cells.

    Raises
    ------
    ConfigurationError
        A field is of no parameter, leaves its range or has no value; a parameter has no field; regions are empty or
        overlap; a file does not cover the body.
    """
    require_composition(problem, mesh, cell_ranges(config), problem.time.end)
