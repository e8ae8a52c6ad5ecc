"""The search: trains all architectures, chooses the smallest network that is good enough.

The error of each candidate is measured on the held-out states. The smallest network whose error is within a margin of
the best is chosen. The run folder keeps finished candidates, so that an interrupted search continues.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from porocore.core.console import Console
from porocore.core.files.plain_data import stable_hash, write_json
from porocore.core.files.reading import read_json
from porocore.core.files.store import ResultStore
from porocore.errors import DataError
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import CellResponse, MacroState
from porocore.study.config.config import RunConfig
from porocore.study.run_folder.folder import RunFolder
from porocore.study.stages.stage_files import training_set
from porocore.study.tuning.candidates import Candidate, with_architecture, with_options
from porocore.study.tuning.known import KnownTrainings
from porocore.study.tuning.tables import FORMAT, VERSION, write_tables
from porocore.study.tuning.training import Result, train_candidate
from porocore.study.tuning.workers import Task, run_tasks


@dataclass(frozen=True)
class Tuning:
    """Outcome of a search.

    Attributes
    ----------
    results
        Trained candidates, smallest network first.
    chosen
        Smallest network that is about as good as the best.
    files
        ``tune.json``, ``tune.csv`` and ``tune.png``.
    """

    results: list[Result]
    chosen: Result
    files: tuple[Path, Path, Path]


def tune(
    folder: RunFolder,
    config: RunConfig,
    grid: Sequence[Candidate],
    *,
    console: Console,
    margin: float = 0.1,
    workers: int | None = None,
    store: ResultStore | None = None,
) -> Tuning:
    """Train candidates on the samples of a run, choose one, and write tables and figure.

    Parameters
    ----------
    config
        Configuration of the run or with another surrogate; its options apply except ``hidden`` and ``activation``.
    console
        Display of the progress.
    margin
        Share by which the error of the chosen network may exceed that of the best.
    workers
        Processes; by default as configured for sampling.
    store
        Networks that it knows are not trained.

    Raises
    ------
    RunFolderError, DataError
        Sampling is not finished or gave too few states, all trainings diverged, or the folder cannot be written.
    """
    with console.task("tuning", "candidates") as task:

        def show(done: int, result: Result | None) -> None:
            detail = "" if result is None else result.candidate.key
            if result is not None and result.error is not None:
                detail += f", error {100 * result.error:.2g} %"
            task.update(done, len(grid), detail=detail)

        count = config.sampling.worker_count() if workers is None else workers
        results = train_all(
            folder, config, grid, workers=count, on_result=show, store=store, tell=console.note
        )
    chosen = smallest_good(results, margin)
    return Tuning(results, chosen, write_tables(folder, config, results, chosen, margin))


def train_all(
    folder: RunFolder,
    config: RunConfig,
    grid: Sequence[Candidate],
    *,
    workers: int = 1,
    on_result: Callable[[int, Result | None], None] | None = None,
    store: ResultStore | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> list[Result]:
    """Train all candidates that the folder does not hold; return all results, smallest network first.

    See :func:`tune`; ``on_result`` is called with the number of results and the latest one, first for those that the
    folder and the store hold. The workers have one thread each. ``tell`` is called with what came from the store.
    """
    # No candidate may leave out the states that it flags.
    data = replace(training_set(folder, config), tolerance=None)
    held_out = _held_out(folder, config)
    places = {candidate: _place(folder, config, candidate) for candidate in grid}
    results = {candidate: found for candidate, path in places.items() if (found := _read(path)) is not None}
    missing = [candidate for candidate in grid if candidate not in results]
    known = KnownTrainings(store, config, data, held_out) if store is not None else None
    if known is not None:
        for candidate, result in known.find(missing, tell).items():
            _write(places[candidate], result)
            results[candidate] = result
    if on_result is not None:
        on_result(len(results), None)
    tasks: list[Task] = [
        (candidate.key, (train_candidate, (with_architecture(config, candidate), candidate)))
        for candidate in sorted(grid, key=lambda c: -c.parameters(len(data.inputs), 1))  # the longest first
        if candidate not in results
    ]
    by_key = {candidate.key: candidate for candidate in grid}
    with closing(run_tasks(tasks, (data, *held_out), workers)) as finished:
        for key, result in finished:
            candidate = by_key[key]
            _write(places[candidate], result)
            if known is not None:
                known.keep(candidate, result)
            results[candidate] = result
            if on_result is not None:
                on_result(len(results), result)
    return sorted(results.values(), key=lambda r: (r.parameters, r.depth, r.activation))


def smallest_good(results: Sequence[Result], margin: float) -> Result:
    """Return the first of ``results``, the smallest network, whose error is at most 1 + ``margin`` times the best.

    Raises
    ------
    DataError
        All trainings diverged.
    """
    known = [result.error for result in results if result.error is not None]
    if not known:
        raise DataError("all trainings diverged; change surrogate.options or sample more states")
    limit = (1 + margin) * min(known)
    return next(result for result in results if result.error is not None and result.error <= limit)


def _held_out(folder: RunFolder, config: RunConfig) -> tuple[MacroState, CellResponse]:
    path = folder.require(folder.test_dataset, "sample")
    dataset = Dataset.open(path, inputs=config.input_space(), identity=config.stages.test)
    responses = dataset.responses()
    good = np.flatnonzero(responses.stable)
    if not len(good):
        raise DataError(
            f"{path}: none of the {len(dataset)} held-out states is stable; narrow sampling.inputs"
        )
    return dataset.states()[good], responses[good]


def _place(folder: RunFolder, config: RunConfig, candidate: Candidate) -> Path:
    """Return the file of a candidate; other samples, held-out states or options give another folder."""
    stages = with_options(config, {}).stages
    identity = stable_hash(f"{stages.training} {stages.test}", length=12)
    return folder.path / "tune" / identity / f"{candidate.key}.json"


def _read(path: Path) -> Result | None:
    """Return a finished candidate, None for one to train again."""
    try:
        document = read_json(path)
        if (document.pop("format"), document.pop("version")) != (FORMAT, VERSION):
            return None
        return Result(**document)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _write(path: Path, result: Result) -> None:
    write_json(path, {"format": FORMAT, "version": VERSION, **asdict(result)}, allow_nan=False)
