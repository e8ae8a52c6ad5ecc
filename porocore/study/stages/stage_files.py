"""Files that stages hand on, read and checked: prepared cell, reference, surrogate, training set."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.family.mesh import UnstressedFamily, rest_data, undeformed_count
from porocore.core.files.store import ResultStore
from porocore.core.inputs import InputSpace, SampledRange
from porocore.errors import DataError
from porocore.interfaces.cell import CellSolver
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.records import RestData
from porocore.interfaces.sampler import Sampler
from porocore.interfaces.solution import MacroSolution
from porocore.interfaces.surrogate import MORE_STATES, Surrogate, TrainingSet, least_states
from porocore.macro.laws.linear import LinearCoefficients, LinearPoroelasticity
from porocore.macro.reference import CellReference
from porocore.plugins.registry import registry
from porocore.sampling.campaign import is_complete
from porocore.sampling.datasets.dataset import Dataset, describe
from porocore.sampling.execution.members import (
    MOST_MEMBERS,
    MemberSolver,
    PreparedFamily,
    UndeformedMemberSolver,
)
from porocore.sampling.execution.solved_store import SolvedStore, StoringSolver
from porocore.sampling.execution.tasks import Factory
from porocore.sampling.samplers.candidates import UndeformedMembers
from porocore.sampling.samplers.designs import RandomStates
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig, with_fields_of
from porocore.study.notes.abilities import require_conductivity
from porocore.study.run_folder import RunFolder, versions
from porocore.study.stages.exploration import BodyAround, inform
from porocore.study.store import solved_states


def prepare_cell(
    backend: str, options: dict[str, Any], cell: Cell, conductivity: str = "piola"
) -> tuple[CellSolver, Any]:
    """Return a cell solver and the cell that it has prepared; worker processes call this once.

    Raises
    ------
    ConfigurationError
        The solver cannot compute the conductivity of a deformed pore, or not of this cell; or the cell is a family.
    """
    cell.require_member()
    solver: Any = registry().get("cell solver", backend)(**options)
    require_conductivity(type(solver), backend, conductivity)
    return solver, solver.prepare(cell, **_how(conductivity))


def prepare_stored(
    store: ResultStore | None, backend: str, options: dict[str, Any], cell: Cell, conductivity: str = "piola"
) -> tuple[CellSolver, Any, SolvedStore | None]:
    """Return a cell solver that takes from a store what that holds, the prepared cell, and its states in the store."""
    solver, prepared = prepare_cell(backend, options, cell, conductivity)
    known = solved_states(store, backend, options, cell, conductivity)
    return solver if known is None else StoringSolver(solver, known), prepared, known


def prepare_family(
    backend: str,
    options: dict[str, Any],
    cell: Cell,
    conductivity: str = "piola",
    kept: int = MOST_MEMBERS,
) -> tuple[MemberSolver, PreparedFamily]:
    """Return a solver that keeps some members of a family, and the family; worker processes call this once.

    Raises
    ------
    ConfigurationError
        The solver cannot compute the conductivity of a deformed pore, or not of this cell.
    """
    solver: CellSolver = registry().get("cell solver", backend)(**options)
    require_conductivity(type(solver), backend, conductivity)
    members = MemberSolver(solver, kept)
    return members, members.prepare(cell, **_how(conductivity))


def prepare_undeformed(
    backend: str, options: dict[str, Any], cell: Cell
) -> tuple[UndeformedMemberSolver, PreparedFamily]:
    """Return a solver of the undeformed members of a family, and the family; worker processes call this once.

    Raises
    ------
    ConfigurationError
        The solver computes no conductivity.
    """
    solver: CellSolver = registry().get("cell solver", backend)(**options)
    require_conductivity(type(solver), backend, "piola")
    members = UndeformedMemberSolver(solver)
    return members, members.prepare(UnstressedFamily(cell))


def factory_of(cell: Cell) -> Factory:
    """Return the function that prepares a cell, or a family of cells, in each worker."""
    return prepare_family if cell.is_family else prepare_cell


def _how(conductivity: str) -> dict[str, Any]:
    """Return the keywords with which a solver prepares a cell."""
    return {"deformed": True} if conductivity == "deformed" else {}


def load_reference(folder: RunFolder) -> CellReference:
    """Return the undeformed cell of the run."""
    return CellReference.load(folder.require(folder.reference, "sample"), folder.config.stages.cell)


def load_undeformed(folder: RunFolder) -> Dataset:
    """Return the undeformed members of the run's family: responses with derivatives and K; failed ones have NaN.

    Raises
    ------
    RunFolderError
        They are not solved yet.
    DataError
        The file is damaged, belongs to another family, or lacks members.
    """
    path, members = folder.require(folder.undeformed, "sample"), undeformed_members(folder.config.cell)
    dataset = Dataset.open(path, inputs=members.inputs, identity=folder.config.stages.cell)
    if not is_complete(members, dataset):
        raise DataError(f"{path}: members are missing; run porocore sample {folder.whole.path}")
    return dataset


def undeformed_members(family: Cell) -> UndeformedMembers:
    """Return the sampler of the undeformed members of a family."""
    ranges = {each.name: (each.lower, each.upper) for each in family.parameters}
    return UndeformedMembers(InputSpace.from_ranges({}, ranges), undeformed_count(family))


def informed_sampler(folder: RunFolder) -> Sampler:
    """Return the configured sampler with the facts of the study, if it takes them."""
    sampler: Sampler = make_backend("sampler", folder.config)

    def around() -> BodyAround | None:
        whole = folder.whole.written
        if not whole.cells:
            return None
        others: dict[str | None, MacroLaw] = {}
        for name in whole.cell_names:
            if name != folder.cell:
                others[name] = LinearPoroelasticity(linear_coefficients(folder.whole.of_cell(name)))
        return BodyAround(with_fields_of(whole, folder.cell), folder.cell, others)

    # Another closure than the one that the run began with learns from the same states.
    inform(
        sampler, folder.written, load_reference(folder), folder.remembered(), around, partial(_rests, folder)
    )
    return sampler


def linear_coefficients(folder: RunFolder) -> LinearCoefficients:
    """Return linear poroelasticity of the run's cell."""
    return load_reference(folder).coefficients(folder.config.cell, folder.config.conductivity)


def load_surrogate(folder: RunFolder) -> Surrogate:
    """Return the surrogate that the closure of the run needs.

    Raises
    ------
    RunFolderError
        It is not trained yet.
    DataError
        The file is damaged, or was trained for another cell or on other inputs.
    """
    config = folder.config
    path = folder.require(folder.surrogate, train_command(folder))
    surrogate: Surrogate = registry().get("surrogate", config.surrogate.backend).load(path)
    if surrogate.identity != config.stages.cell:
        raise DataError(
            f"{path}: trained for another cell (identity {surrogate.identity}, expected {config.stages.cell}); "
            f"move it elsewhere and run porocore train {folder.whole.path}"
        )
    expected = config.input_space()
    if surrogate.inputs != expected:
        raise DataError(
            f"{path}: trained on other inputs ({describe(surrogate.inputs)}, expected {describe(expected)}); "
            f"move it elsewhere and run porocore train {folder.whole.path}"
        )
    return surrogate


def require_samples(folder: RunFolder) -> None:
    """Refuse a run without the samples of one of its cells."""
    for files in folder.of_each_cell:
        files.require(files.dataset, "sample")


def require_surrogates(folder: RunFolder) -> None:
    """Refuse a run without the surrogate of one of its cells."""
    for files in folder.of_each_cell:
        files.require(files.surrogate, train_command(files))


def train_command(folder: RunFolder) -> str:
    """Return the command that trains the surrogate of a run, without the folder."""
    closure = folder.config.closure
    return "train" if closure == folder.written.closure else f"train --closure {closure}"


def load_solution(folder: RunFolder, law: str, load: float) -> MacroSolution:
    """Return a macro solution of the run.

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
            f"'{law}' under {load:g}; move it elsewhere and run porocore solve {folder.whole.path}"
        )
    return solution


def held_out_states(config: RunConfig, samples: Dataset) -> RandomStates:
    """Return the sampler of the held-out states; where ``samples`` do not fill the ranges, they lie between those."""
    test, within = config.sampling.test, None
    together = {"states_per_member": test.together} if config.cell.is_family else {}
    if not registry().get("sampler", config.sampling.sampler).fills_ranges:
        within = SampledRange.around(samples.inputs, samples.x()[samples.responses().stable])
    return RandomStates(config.input_space(), count=test.count, seed=test.seed, within=within, **together)


def drop_misplaced(held_out: Dataset, states: RandomStates) -> None:
    """Empty a data set whose held-out states lie elsewhere than ``states`` asks for: the samples have changed."""
    known = [request for request in states.ask() if request.key in held_out]
    if any(held_out.inputs_of(request.key) != request.x for request in known):
        held_out.drop(held_out.keys)


def training_set(folder: RunFolder) -> TrainingSet:
    """Return the stable states of the run, in contact or not.

    Raises
    ------
    DataError
        Sampling is not finished, or there are too few of them.
    """
    sampler, reference, config = informed_sampler(folder), load_reference(folder), folder.config
    dataset = finished(folder, folder.dataset, config.stages.sampling, sampler)
    responses = dataset.responses()
    good = np.flatnonzero(responses.stable)
    if len(good) < (least := least_states(len(dataset.inputs))):
        raise DataError(
            f"{folder.dataset}: {len(good)} of {len(dataset)} states are stable, too few to train on; at least {least} "
            f"are needed: {MORE_STATES}"
        )
    return TrainingSet(
        dataset.states()[good],
        responses[good],
        dataset.inputs,
        reference.resting(config.conductivity),
        config.stages.cell,
        versions(),
        config.cell.point_group,
        config.surrogate.tolerance,
        _rests(folder),
    )


def _rests(folder: RunFolder) -> RestData | None:
    """Return the undeformed members of the run's family; None for a cell without parameters."""
    if not folder.config.cell.is_family:
        return None
    dataset = load_undeformed(folder)
    return rest_data(folder.config.cell, dataset.states(), dataset.responses())


def finished(folder: RunFolder, path: Path, identity: str, sampler: Sampler) -> Dataset:
    """Return the data set at ``path`` if it holds every state that its sampler asks for.

    Raises
    ------
    DataError
        A state is missing.
    """
    dataset = Dataset.open(path, inputs=folder.config.input_space(), identity=identity)
    if not is_complete(sampler, dataset):
        raise DataError(
            f"{path}: sampling was interrupted and is not finished; run porocore sample {folder.whole.path}"
        )
    return dataset
