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
from porocore.study.notes.forecast import processes_here, starts_early, trains_beside
from porocore.study.run import reference, sampling, training
from porocore.study.run.composition import USUAL_LAWS, LawKind, cell_pool, law_names
from porocore.study.run.folder import RunFolder, cut_short_timed
from porocore.study.run.reference import solve_cell
from porocore.study.run.reporting import kept_report, report
from porocore.study.run.solving import solve
from porocore.study.run.training import begin_training, training_stage

__all__ = ["learn", "report", "run", "sample", "solve", "solve_cell", "solve_reference", "train"]


def run(
    folder: RunFolder,
    *,
    console: Console,
    laws: Sequence[LawKind] = USUAL_LAWS,
    store: ResultStore | None = None,
) -> Path:
    """Run all stages and return the path of the report.

    What is finished and has not changed since stays, and what ``store`` holds is not computed again.
    """
    solutions = folder.solutions(*law_names(folder.config.closure, laws))
    if all(path.exists() for path in solutions) and kept_report(folder, console=console):
        console.note(f"the run is finished; to write its report again: porocore report {folder.path}")
        return folder.report
    with CallProcesses(processes_here(folder.config.sampling)) as processes:
        first, *others = folder.of_each_cell
        for files in others:  # the body may be explored with the linear laws of all cells
            reference.solve_reference(files, console=console, store=store)
        for files in (first, *others):
            _learn(files, console, store, processes)
        solve(folder, console=console, laws=laws, store=store, processes=processes)
        return report(folder, console=console, processes=processes)


def _learn(folder: RunFolder, console: Console, store: ResultStore | None, processes: CallProcesses) -> None:
    """Solve one cell, undeformed and for all states, and train its surrogate."""
    config = folder.config
    beside, begun = trains_beside(config.cell, config.sampling), dict[str, Call]()

    def load_libraries() -> None:
        if not (beside or folder.surrogate.exists()):
            registry().get("surrogate", config.surrogate.backend).load_libraries()

    def sampled() -> None:
        if beside and (call := begin_training(folder, processes, store)):
            begun[training_stage(folder)] = call

    with (
        cut_short_timed(folder.timings, begun, processes),
        cell_pool(config, store, on_warning=console.warn, on_start=load_libraries) as pool,
    ):
        begin = pool.start if starts_early(config.cell, config.sampling) else load_libraries
        if folder.cell is None:
            reference.solve_reference(folder, console=console, store=store, begin=begin)
            reference.warn_of_loading(folder.whole, console=console)
        sampling.sample(folder, console=console, store=store, pool=pool, sampled=sampled)
    training.train(folder, console=console, store=store, begun=next(iter(begun.values()), None))


def learn(folder: RunFolder, *, console: Console, store: ResultStore | None = None) -> None:
    """Solve the cells of a study and train their surrogates, unless the folder holds them."""
    if all(files.surrogate.exists() for files in folder.of_each_cell):
        console.note(f"the cells are learned already: {folder.surrogate.name}")
        return
    solve_reference(folder, console=console, store=store)
    sample(folder, console=console, store=store)
    train(folder, console=console, store=store)


def solve_reference(folder: RunFolder, *, console: Console, store: ResultStore | None = None) -> None:
    """Solve every undeformed cell of a study; see :func:`porocore.study.run.reference.solve_reference`."""
    for files in folder.of_each_cell:
        reference.solve_reference(files, console=console, store=store)
    reference.warn_of_loading(folder, console=console)


def sample(
    folder: RunFolder,
    *,
    console: Console,
    retry_lost: bool = False,
    store: ResultStore | None = None,
) -> None:
    """Solve the states of every cell of a study; see :func:`porocore.study.run.sampling.sample`."""
    for files in folder.of_each_cell:
        sampling.sample(files, console=console, retry_lost=retry_lost, store=store)


def train(folder: RunFolder, *, console: Console, store: ResultStore | None = None) -> None:
    """Train the surrogate of every cell of a study; see :func:`porocore.study.run.training.train`."""
    for files in folder.of_each_cell:
        training.train(files, console=console, store=store)
