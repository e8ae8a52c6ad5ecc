"""Results of a run, loaded from its folder for its report (RunResults)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from porocore.cell.cell import Cell
from porocore.cell.family.mesh import undeformed_count
from porocore.core.inputs import InputSpace
from porocore.errors import DataError
from porocore.interfaces.sampler import Sampler
from porocore.interfaces.solution import MacroSolution
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.composition.regions import regions_of_cell
from porocore.macro.laws.closure import CLOSURES
from porocore.macro.laws.linear import LinearCoefficients
from porocore.macro.reference import CellReference
from porocore.plugins.registry import registry
from porocore.sampling.campaign import is_complete
from porocore.sampling.datasets.dataset import Dataset, describe
from porocore.sampling.samplers.designs import UndeformedMembers
from porocore.study.config.config import RunConfig, with_closure
from porocore.study.run.folder import LINEAR, RunFolder, StageTime, stage_times


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


@dataclass(frozen=True, eq=False)
class RunResults:
    """Results of a finished run.

    Attributes
    ----------
    folder
        The run, with the closure that is shown.
    reference
        The undeformed cell; of several cells, that of the rest of the body, as are the next three.
    dataset, held_out
        Solved states.
    surrogates
        Surrogates by closure: that of the run, and those of the other closures that were solved with.
    solutions
        Macro solutions by load and law.
    timings
        Times of the stages.
    """

    folder: RunFolder
    reference: CellReference
    dataset: Dataset
    held_out: Dataset
    surrogates: dict[str, Surrogate]
    solutions: dict[float, dict[str, MacroSolution]]
    timings: dict[str, StageTime]

    @property
    def config(self) -> RunConfig:
        """Configuration of the run, with the closure that is shown."""
        return self.folder.config

    @property
    def coefficients(self) -> LinearCoefficients:
        """Linear poroelasticity of the undeformed cell."""
        return self.reference.coefficients(self.config.cell, self.config.conductivity)

    @property
    def seconds(self) -> dict[str, float]:
        """Seconds by stage."""
        return {stage: each.seconds for stage, each in self.timings.items()}

    @property
    def all_solutions(self) -> list[MacroSolution]:
        """Solutions, load by load: with the shown closure, linear where it was not left out, others."""
        return [solution for each in self.solutions.values() for solution in each.values()]

    @classmethod
    def load(cls, folder: RunFolder) -> RunResults:
        """Read the results from a run folder.

        Raises
        ------
        RunFolderError
            A stage is missing.
        DataError
            A file is damaged or belongs to another study.
        """
        laws: dict[float, list[str]] = {}
        for load in folder.config.macro.loads:
            linear = (LINEAR,) if folder.solution(LINEAR, load).exists() else ()
            laws[load] = list(dict.fromkeys((folder.config.closure, *linear, *folder.solved(load))))
        solutions = {
            load: {law: load_solution(folder, law, load) for law in each} for load, each in laws.items()
        }
        return cls._of(folder, solutions)

    @classmethod
    def _of(cls, folder: RunFolder, solutions: dict[float, dict[str, MacroSolution]]) -> RunResults:
        """Return these solutions with the results of the cell whose files are in a folder."""
        stages = folder.config.stages
        closures = dict.fromkeys(law for each in solutions.values() for law in each if law in CLOSURES)
        return cls(
            folder,
            load_reference(folder),
            Dataset.open(folder.dataset, identity=stages.sampling),
            Dataset.open(folder.test_dataset, identity=stages.test),
            {
                closure: load_surrogate(folder.with_config(with_closure(folder.config, closure)))
                for closure in closures
            },
            solutions,
            stage_times(folder.timings),
        )

    @cached_property
    def by_cell(self) -> dict[str | None, RunResults]:
        """Results of each cell, with the part of the body that has it; None names that of the rest, or the only one."""
        if not self.config.cells:
            return {None: self}
        found = dict[str | None, RunResults]()
        for files in self.folder.of_each_cell:
            regions = regions_of_cell(self.config.macro.regions, files.cell)
            names = [parameter.name for parameter in files.config.cell.parameters]
            parts = {
                load: {law: solution.of_regions(regions, names) for law, solution in each.items()}
                for load, each in self.solutions.items()
            }
            found[files.cell] = self._of(files, parts)
        return found


def times_of_all_cells(folder: RunFolder) -> dict[str, StageTime]:
    """Return the times of the stages of a run; those of a named cell end with its name."""
    return {
        files.stage_of_cell(stage): time
        for files in folder.of_each_cell
        for stage, time in stage_times(files.timings).items()
    }
