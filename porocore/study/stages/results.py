"""Results of a run, loaded from its folder for its report (RunResults)."""

from __future__ import annotations

from dataclasses import dataclass

from porocore.interfaces.solution import MacroSolution
from porocore.interfaces.surrogate import Surrogate
from porocore.macro.laws import CLOSURES
from porocore.macro.laws.linear import LinearCoefficients
from porocore.macro.reference import CellReference
from porocore.sampling.datasets.dataset import Dataset
from porocore.study.backends import with_closure
from porocore.study.config.config import RunConfig
from porocore.study.run_folder.files import LINEAR
from porocore.study.run_folder.folder import RunFolder
from porocore.study.run_folder.stage_times import StageTime, stage_times
from porocore.study.stages.stage_files import (
    linear_coefficients,
    load_reference,
    load_solution,
    load_surrogate,
)


@dataclass(frozen=True, eq=False)
class RunResults:
    """Results of a finished run.

    Attributes
    ----------
    folder, config
        The run, with the closure that is shown.
    reference, coefficients
        The undeformed cell, and linear poroelasticity from it.
    dataset, held_out
        Solved states.
    surrogates
        Surrogates by closure: that of ``config``, and those of the other closures that were solved with.
    solutions
        Macro solutions by load and law.
    timings
        Times of the stages.
    """

    folder: RunFolder
    config: RunConfig
    reference: CellReference
    coefficients: LinearCoefficients
    dataset: Dataset
    held_out: Dataset
    surrogates: dict[str, Surrogate]
    solutions: dict[float, dict[str, MacroSolution]]
    timings: dict[str, StageTime]

    @property
    def seconds(self) -> dict[str, float]:
        """Seconds by stage."""
        return {stage: each.seconds for stage, each in self.timings.items()}

    @property
    def all_solutions(self) -> list[MacroSolution]:
        """Solutions, load by load: with the shown closure, linear where it was not left out, others."""
        return [solution for each in self.solutions.values() for solution in each.values()]

    @classmethod
    def load(cls, folder: RunFolder, config: RunConfig) -> RunResults:
        """Read the results from a run folder.

        Raises
        ------
        RunFolderError
            A stage is missing.
        DataError
            A file is damaged or belongs to another study.
        """
        reference = load_reference(folder, config)
        laws: dict[float, list[str]] = {}
        for load in config.macro.loads:
            linear = (LINEAR,) if folder.solution(LINEAR, load).exists() else ()
            laws[load] = list(dict.fromkeys((config.closure, *linear, *folder.solved(load))))
        closures = dict.fromkeys(law for each in laws.values() for law in each if law in CLOSURES)
        surrogates = {closure: load_surrogate(folder, with_closure(config, closure)) for closure in closures}
        return cls(
            folder,
            config,
            reference,
            linear_coefficients(reference, config),
            Dataset.open(folder.dataset, identity=config.stages.sampling),
            Dataset.open(folder.test_dataset, identity=config.stages.test),
            surrogates,
            {load: {law: load_solution(folder, law, load) for law in each} for load, each in laws.items()},
            stage_times(folder.timings),
        )
