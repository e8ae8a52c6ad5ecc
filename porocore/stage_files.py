"""What one stage of a run hands to the next: read from the run folder, and checked to belong to it."""

from __future__ import annotations

from typing import Any

from porocore.cell.cell import Cell
from porocore.config import RunConfig
from porocore.dataset import describe
from porocore.errors import DataError
from porocore.interfaces.cell import CellSolver
from porocore.interfaces.surrogate import Surrogate
from porocore.linear import LinearCoefficients
from porocore.reference import CellReference
from porocore.registry import registry
from porocore.runfolder import RunFolder
from porocore.solution import MacroSolution


def prepare_cell(backend: str, options: dict[str, Any], cell: Cell) -> tuple[CellSolver, Any]:
    """A cell solver and what it has prepared; worker processes call this once."""
    solver: CellSolver = registry().get("cell solver", backend)(**options)
    return solver, solver.prepare(cell)


def load_reference(folder: RunFolder, config: RunConfig) -> CellReference:
    """The undeformed cell of the run."""
    return CellReference.load(folder.require(folder.reference, "sample"), config.stages.cell)


def linear_coefficients(reference: CellReference, config: RunConfig) -> LinearCoefficients:
    """Of the run's cell."""
    return LinearCoefficients.from_reference(
        reference.response, reference.solid_fraction, config.cell.material, reference.conductivity
    )


def load_surrogate(folder: RunFolder, config: RunConfig) -> Surrogate:
    """The surrogate that the closure of ``config`` needs.

    Raises
    ------
    RunFolderError
        It is not trained yet.
    DataError
        The file is damaged, or was trained for another cell or on other inputs.
    """
    path = folder.require(folder.surrogate_of(config), train_command(folder, config))
    surrogate: Surrogate = registry().get("surrogate", config.surrogate.backend).load(path)
    if surrogate.identity != config.stages.cell:
        raise DataError(
            f"{path}: trained for another cell (identity {surrogate.identity}, expected {config.stages.cell}); "
            f"delete it and run porocore train {folder.path}"
        )
    expected = config.sampling.input_space()
    if surrogate.inputs != expected:
        raise DataError(
            f"{path}: trained on other inputs ({describe(surrogate.inputs)}, expected {describe(expected)}); "
            f"delete it and run porocore train {folder.path}"
        )
    return surrogate


def train_command(folder: RunFolder, config: RunConfig) -> str:
    """How to train the surrogate that ``config`` needs, but for the folder."""
    own = config.closure == folder.written.closure
    return "train" if own else f"train --closure {config.closure}"


def load_solution(folder: RunFolder, law: str, load: float) -> MacroSolution:
    """A macro solution of the run.

    Raises
    ------
    DataError
        The file is damaged, or holds another law or load than its name says.
    """
    path = folder.solution(law, load)
    solution = MacroSolution.load_file(path)
    if (solution.law, solution.load) != (law, load):
        raise DataError(
            f"{path}: holds the solution of law '{solution.law}' under load {solution.load:g}, expected "
            f"'{law}' under {load:g}; delete it and run porocore solve {folder.path}"
        )
    return solution
