"""All stages of a run one after another: cell, samples, surrogate, macroscale, report.

Each stage reads the files of the one before it from the run folder, continues where an earlier process stopped, and
adds its wall time to the folder's record.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from porocore.core.console import Console
from porocore.core.files.store import ResultStore
from porocore.core.parallel.calls import Call, CallProcesses
from porocore.plugins.registry import registry
from porocore.study.config.config import RunConfig
from porocore.study.notes.guess import processes_here, starts_early, trains_beside
from porocore.study.run_folder import RunFolder, cut_short_timed
from porocore.study.stages import reference, sampling, training
from porocore.study.stages.reference import solve_cell
from porocore.study.stages.reporting import kept_report, report
from porocore.study.stages.sampling import cell_pool
from porocore.study.stages.solving import USUAL_LAWS, LawKind, law_names, solve
from porocore.study.stages.training import begin_training, training_stage

__all__ = ["learn", "report", "run", "sample", "solve", "solve_cell", "solve_reference", "train"]


def run(
    folder: RunFolder,
    config: RunConfig,
    *,
    console: Console,
    laws: Sequence[LawKind] = USUAL_LAWS,
    store: ResultStore | None = None,
) -> Path:
    """Run all stages and return the path of the report.

    What is finished and has not changed since stays, and what ``store`` holds is not computed again.
    """
    solutions = folder.solutions(*law_names(config, laws, config.closure))
    if all(path.exists() for path in solutions) and kept_report(folder, config, console=console):
        console.note(f"the run is finished; to write its report again: porocore report {folder.path}")
        return folder.report
    with CallProcesses(processes_here(config)) as processes:
        first, *others = folder.of_each_cell(config)
        for files, one in others:  # the body may be explored with the linear laws of all cells
            reference.solve_reference(files, one, console=console, store=store)
        for files, one in (first, *others):
            _learn(files, one, config, console, store, processes)
        solve(folder, config, console=console, laws=laws, store=store, processes=processes)
        return report(folder, config, console=console, processes=processes)


def _learn(
    folder: RunFolder,
    config: RunConfig,
    whole: RunConfig,
    console: Console,
    store: ResultStore | None,
    processes: CallProcesses,
) -> None:
    """Solve one cell, undeformed and for all states, and train its surrogate; ``whole`` is the study of all cells."""
    beside, begun = trains_beside(config), dict[str, Call]()

    def load_libraries() -> None:
        if not (beside or folder.surrogate_of(config).exists()):
            registry().get("surrogate", config.surrogate.backend).load_libraries()

    def sampled() -> None:
        if beside and (call := begin_training(folder, config, processes, store)):
            begun[training_stage(folder, config)] = call

    with (
        cut_short_timed(folder.timings, begun, processes),
        cell_pool(config, console=console, store=store, begin=load_libraries) as pool,
    ):
        begin = pool.start if starts_early(config) else load_libraries
        if folder.cell is None:
            reference.solve_reference(folder, config, console=console, store=store, begin=begin)
            reference.warn_of_loading(folder.whole, whole, console=console)
        sampling.sample(folder, config, console=console, store=store, pool=pool, sampled=sampled)
    training.train(folder, config, console=console, store=store, begun=next(iter(begun.values()), None))


def learn(
    folder: RunFolder, config: RunConfig, *, console: Console, store: ResultStore | None = None
) -> None:
    """Solve the cells of a study and train their surrogates, unless the folder holds them."""
    if all(files.surrogate_of(one).exists() for files, one in folder.of_each_cell(config)):
        console.note(f"the cells are learned already: {folder.surrogate_of(config).name}")
        return
    solve_reference(folder, config, console=console, store=store)
    sample(folder, config, console=console, store=store)
    train(folder, config, console=console, store=store)


def solve_reference(
    folder: RunFolder, config: RunConfig, *, console: Console, store: ResultStore | None = None
) -> None:
    """Solve every undeformed cell of a study; see :func:`porocore.study.stages.reference.solve_reference`."""
    for files, one in folder.of_each_cell(config):
        reference.solve_reference(files, one, console=console, store=store)
    reference.warn_of_loading(folder, config, console=console)


def sample(
    folder: RunFolder,
    config: RunConfig,
    *,
    console: Console,
    retry_lost: bool = False,
    store: ResultStore | None = None,
) -> None:
    """Solve the states of every cell of a study; see :func:`porocore.study.stages.sampling.sample`."""
    for files, one in folder.of_each_cell(config):
        sampling.sample(files, one, console=console, retry_lost=retry_lost, store=store)


def train(
    folder: RunFolder, config: RunConfig, *, console: Console, store: ResultStore | None = None
) -> None:
    """Train the surrogate of every cell of a study; see :func:`porocore.study.stages.training.train`."""
    for files, one in folder.of_each_cell(config):
        training.train(files, one, console=console, store=store)
