"""Cells of a calibration (FamilyCells): families that experiments share, sampled and learned once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path

from porocore.calibration.forward.experiment import ExperimentModel
from porocore.calibration.plan import CalibrationPlan
from porocore.core.console import Console
from porocore.core.echo import reason
from porocore.core.files.plain_data import json_hash, write_json
from porocore.core.files.reading import read_json, set_aside
from porocore.core.files.store import ResultStore
from porocore.core.units.results import speaking
from porocore.errors import DataError, RunFolderError
from porocore.interfaces.law import MacroLaw
from porocore.macro.composition.linearised_law import LinearisedLaw
from porocore.macro.laws import AdaptiveLaw, ClosedLaw
from porocore.macro.laws.effective import EffectiveProperties
from porocore.plugins.border import body_solution_of
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Array, MacroState
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.run_folder.folder import RunFolder
from porocore.study.stages import pipeline
from porocore.study.stages.laws import RunLaw, macro_laws, porosity_of
from porocore.study.stages.solving import body_progress, prepared_body
from porocore.study.stages.stage_files import load_reference

#: Record of the further cells that each round has solved, in the folder of a family.
ROUNDS = "rounds.json"


class FamilyCells:
    """Cells that some experiments share, in a run folder.

    Parameters
    ----------
    folder
        The run folder, which is locked.
    config
        Study of the first of these experiments.
    experiments
        Names of all of them.
    console, store
        Progress, and results of other studies.
    """

    def __init__(
        self,
        folder: RunFolder,
        config: RunConfig,
        experiments: Sequence[str],
        console: Console,
        store: ResultStore | None,
    ) -> None:
        self.folder, self.config, self.experiments = folder, config, tuple(experiments)
        self._console, self._store = console, store

    def learn(self) -> None:
        """Solve and learn the cells that the folder does not hold."""
        with speaking(self.config.result_units):
            pipeline.learn(self.folder, self.config, console=self._console, store=self._store)

    def keep_rounds(self, count: int) -> None:
        """Keep the further cells of so many rounds, and forget those of one that was not finished."""
        if self.rounds > count:
            write_json(self.folder.path / ROUNDS, self._rounds()[:count])
        further, kept = self._further(), set(self._known())
        if further is not None and (unfinished := [key for key in further.keys if key not in kept]):
            further.drop(unfinished)

    def _known(self) -> list[str]:
        """Return the keys of the further cells of all rounds."""
        return [key for keys in self._rounds() for key in keys]

    def _rounds(self) -> list[list[str]]:
        """Return the keys of the further cells of each round."""
        path = self.folder.path / ROUNDS
        if not path.exists():
            return []
        try:
            return [[str(key) for key in keys] for keys in read_json(path)]
        except (OSError, ValueError, TypeError) as error:
            raise RunFolderError(
                f"{path} is damaged ({reason(error)}); {set_aside(path, 'start again')}"
            ) from error

    def _further(self) -> Dataset | None:
        path = self.folder.fallback
        return Dataset.open(path) if path.exists() else None

    @property
    def rounds(self) -> int:
        """Number of rounds in which further cells were solved."""
        return len(self._rounds())

    @property
    def identity(self) -> str:
        """Hash of all cells that the present law has learned from."""
        return self.identity_after(self.rounds)

    def identity_after(self, round_: int) -> str:
        """Return the hash of the cells that are known after so many rounds."""
        known = [key for keys in self._rounds()[:round_] for key in keys]
        return json_hash([self.config.stages.training, self.config.closure, *known])

    def law(self) -> MacroLaw:
        """Return the law that knows the further cells of all rounds."""
        with ExitStack() as stack:
            if self._known():
                return _fixed(self._adaptive(stack)[1], self.identity)
            (run,) = macro_laws(self.folder, self.config, stack, ("surrogate",)).values()
            return run.law

    def at_rest(self) -> Callable[[Array], EffectiveProperties] | None:
        """Return the properties of the undeformed cell by the values (m,) of its parameters, as they were learned.

        None where the body has several cells.
        """
        config = self.config
        if config.cells:
            return None
        reference = load_reference(self.folder, config)
        if not config.cell.is_family:
            return lambda parameters: reference.properties(config.cell, config.conductivity)
        law, names = self.law(), [each.name for each in config.cell.parameters]
        porosity = porosity_of(law, reference)
        assert callable(porosity)

        def of(parameters: Array) -> EffectiveProperties:
            points = MacroState.zeros(1).with_parameters(parameters[None])
            given = dict(zip(names, parameters, strict=True))
            viscosity = float(given.get("viscosity", config.cell.viscosity))
            found = LinearisedLaw(law).coefficients(points).at(0)
            return EffectiveProperties.of(found, float(porosity(parameters[None])[0]), viscosity)

        return of

    def _adaptive(self, stack: ExitStack) -> tuple[RunLaw, AdaptiveLaw]:
        """Return the law that learns on the way, with its solves, and the same as what it is."""
        (run,) = macro_laws(self.folder, self.config, stack, ("fallback",), store=self._store).values()
        law = run.law
        if not isinstance(law, AdaptiveLaw):
            raise DataError(
                "the body has several cells, beyond whose sampled states none are solved; sample wider ranges"
            )
        return run, law

    def extend(self, models: Sequence[ExperimentModel], values: Array) -> list[str]:
        """Solve cells where bodies with these values of the unknowns leave the sampled states; return their keys."""
        before = set(self._known())
        with ExitStack() as stack:
            run, law = self._adaptive(stack)
            for model in models:
                units, body = model.config.result_units, model.body(values)
                stack.enter_context(speaking(units))
                solver, problem = make_backend("macro solver", model.config), body.problem
                prepared, name = prepared_body(solver, model.config, problem), model.experiment.name
                title = f"further cells{f' of {name}' if name else ''}"
                with body_progress(self._console, title, problem, units, scale=body.scales.factor) as (
                    show,
                    say,
                ):
                    run.tell_work(say)
                    body_solution_of(solver, prepared, law, problem, on_step=show)
        further = self._further()
        new = [] if further is None else [key for key in further.keys if key not in before]
        return new

    def end_round(self, new: Sequence[str]) -> None:
        """Record the further cells of a round, by which it is finished."""
        write_json(self.folder.path / ROUNDS, [*self._rounds(), [*new]])

    @property
    def solves(self) -> int:
        """Number of cells that were solved for the family, whether now or, by the store, for another study."""
        folder = self.folder
        count = 0
        for path in (folder.undeformed, folder.dataset, folder.test_dataset, folder.fallback):
            count += len(Dataset.open(path)) if path.exists() else 0
        return count


def _fixed(law: AdaptiveLaw, identity: str) -> ClosedLaw:
    """Return the law with what it has learned so far, which learns no more."""
    return ClosedLaw(law.cell_law, law.closure, identity=identity, name=law.name)


def families(
    plan: CalibrationPlan, out: Path, stack: ExitStack, console: Console, store: ResultStore | None
) -> list[FamilyCells]:
    """Return the families of a calibration, each in a folder below ``out`` that is held until ``stack`` ends.

    Experiments with the same cells, samples, surrogate and closure share one.

    Raises
    ------
    RunFolderError
        A folder holds other cells.
    """
    groups: dict[tuple[str, str, str], list[int]] = {}
    for k, experiment in enumerate(plan.experiments):
        config = experiment.config
        key = (config.stages.training, config.closure, config.conductivity)
        groups.setdefault(key, []).append(k)
    found = []
    for number, members in enumerate(groups.values()):
        config = plan.experiments[members[0]].config
        name = "cells" if len(groups) == 1 else f"cells-{number + 1}"
        folder = RunFolder.claim(out / name, config, resume=True)
        stack.enter_context(folder)
        names = [plan.experiments[k].name for k in members]
        found.append(FamilyCells(folder, config, names, console, store))
    return found
