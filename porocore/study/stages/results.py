"""Results of a run, loaded from its folder for its report (RunResults)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from porocore.interfaces.solution import MacroSolution
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.composition.regions import regions_of_cell
from porocore.macro.laws import CLOSURES
from porocore.macro.laws.linear import LinearCoefficients
from porocore.macro.reference import CellReference
from porocore.sampling.datasets.dataset import Dataset
from porocore.study.backends import with_closure
from porocore.study.config.config import RunConfig
from porocore.study.run_folder import LINEAR, RunFolder, StageTime, stage_times
from porocore.study.stages.stage_files import (
    load_reference,
    load_solution,
    load_surrogate,
)


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
