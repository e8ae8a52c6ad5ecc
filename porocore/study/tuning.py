"""Search of the smallest network that is good enough: candidates, training side by side, tables.

The error of each candidate is measured on the held-out states. The smallest network whose error is within a margin of
the best is chosen. The run folder keeps finished candidates, so that an interrupted search continues.
"""

from __future__ import annotations

import csv
import itertools
import json
import math
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.console import Console, duration
from porocore.core.echo import cut, echo
from porocore.core.files.atomic import atomic_path
from porocore.core.files.plain_data import stable_hash, write_json
from porocore.core.files.reading import read_json
from porocore.core.files.store import ResultStore
from porocore.core.parallel.children import begin_child, require_children, starting_children
from porocore.errors import ConfigurationError, DataError, PorocoreError
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Array, CellResponse, MacroState
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.run_folder import RunFolder
from porocore.study.stages.stage_files import training_set
from porocore.study.store import arrays_hash, training_key
from porocore.surrogates.network.options import MOST_LAYERS, MOST_WIDTH

#: More networks than this are not tried.
MOST_CANDIDATES = 1000
DEPTHS, WIDTHS = (1, 2, 3), (8, 16, 24, 40)
#: Tried in this order; a backend takes those that its model knows.
ACTIVATIONS = ("sigmoid", "tanh", "softplus", "relu", "gelu", "silu", "elu")


@dataclass(frozen=True)
class Candidate:
    """One architecture: ``depth`` hidden layers of ``width``."""

    depth: int
    width: int
    activation: str

    @property
    def hidden(self) -> list[int]:
        """Return the widths of the hidden layers, as in the configuration."""
        return [self.width] * self.depth

    @property
    def key(self) -> str:
        """Name of the candidate's file."""
        return f"{self.depth}x{self.width}-{self.activation}"

    def parameters(self, inputs: int, outputs: int) -> int:
        """Return the number of weights and biases."""
        widths = [inputs, *self.hidden, outputs]
        return sum((a + 1) * b for a, b in itertools.pairwise(widths))


def candidates(
    config: RunConfig,
    depths: Sequence[int] = DEPTHS,
    widths: Sequence[int] = WIDTHS,
    activations: Sequence[str] | None = None,
) -> list[Candidate]:
    """Return all combinations; without ``activations`` those with every activation of the model.

    Raises
    ------
    ConfigurationError
        The surrogate has no options ``hidden`` and ``activation``, or does not take these values; or the cell is a
        family.
    PluginError
        The surrogate is unknown or missing.
    """
    config.cell.require_member("the architecture is chosen for one cell: give one number")
    make_backend("surrogate", config)  # reports any other fault first
    known = [name for name in ACTIVATIONS if _takes(config, Candidate(1, 4, name))]
    if not known:
        name = config.surrogate.backend
        raise ConfigurationError(
            f"surrogate.backend: '{name}' has no options hidden and activation, so there is no architecture to "
            "choose; choose another surrogate, such as --surrogate torch"
        )
    chosen = known if activations is None else list(activations)
    for activation in chosen:
        if activation not in known:
            raise ConfigurationError(
                f"--activations: expected some of {', '.join(known)}, got {echo(activation)}; leave it out to try all"
            )
    for option, values in (("--depths", depths), ("--widths", widths)):
        most = MOST_LAYERS if option == "--depths" else MOST_WIDTH
        if not values or min(values) < 1 or max(values) > most:
            raise ConfigurationError(
                f"{option}: expected whole numbers from 1 to {most}, such as 1,2,3, got {cut(_listed(values))}"
            )
    if (count := len(set(depths)) * len(set(widths)) * len(set(chosen))) > MOST_CANDIDATES:
        raise ConfigurationError(
            f"--depths, --widths and --activations make {count} candidates; at most {MOST_CANDIDATES} are trained"
        )
    grid = itertools.product(dict.fromkeys(depths), dict.fromkeys(widths), dict.fromkeys(chosen))
    return [Candidate(depth, width, activation) for depth, width, activation in grid]


def with_architecture(config: RunConfig, candidate: Candidate) -> RunConfig:
    """Return the configuration whose surrogate has this architecture."""
    return with_options(config, {"hidden": candidate.hidden, "activation": candidate.activation})


def with_options(config: RunConfig, update: dict[str, Any]) -> RunConfig:
    """Return the configuration with other options for the architecture; the remaining options stay."""
    kept = {k: v for k, v in config.surrogate.options.items() if k not in ("hidden", "activation")}
    surrogate = config.surrogate.model_copy(update={"options": {**kept, **update}})
    return config.model_copy(update={"surrogate": surrogate})


def _takes(config: RunConfig, candidate: Candidate) -> bool:
    try:
        make_backend("surrogate", with_architecture(config, candidate))
    except ConfigurationError:
        return False
    return True


def _listed(values: Sequence[int]) -> str:
    return ",".join(map(str, values)) or "nothing"


@dataclass(frozen=True)
class Result:
    """A trained candidate.

    Attributes
    ----------
    parameters
        Number of weights and biases.
    error
        Root-mean-square error of the worst response on the held-out states, a share of its range; None if the
        training diverged.
    errors
        The same for each response.
    seconds
        Training time [s].
    """

    depth: int
    width: int
    activation: str
    parameters: int
    error: float | None
    errors: dict[str, float]
    seconds: float

    @property
    def candidate(self) -> Candidate:
        """The architecture that was trained."""
        return Candidate(self.depth, self.width, self.activation)


def train_candidate(
    config: RunConfig, candidate: Candidate, data: TrainingSet, states: MacroState, truth: CellResponse
) -> Result:
    """Train a candidate and return its error on the held-out states."""
    surrogate: Surrogate = make_backend("surrogate", config)
    began = time.perf_counter()
    surrogate.fit(data, seed=config.surrogate.seed)
    seconds = time.perf_counter() - began
    with np.errstate(all="ignore"):
        predicted = surrogate.predict(states, tangent=False)
        errors = held_out_errors(predicted, truth, data)
    worst = max(errors.values())
    outputs = 1 if predicted.potential is not None else _learned_outputs(truth)
    size = candidate.parameters(len(data.inputs), outputs)
    finite = {name: value for name, value in errors.items() if math.isfinite(value)}
    return Result(**asdict(candidate), parameters=size, error=worst if math.isfinite(worst) else None,
                  errors=finite, seconds=round(seconds, 3))  # fmt: skip


def held_out_errors(predicted: CellResponse, truth: CellResponse, data: TrainingSet) -> dict[str, float]:
    """Return the root-mean-square error of the worst component over the largest range, for each predicted response.

    Only those components of the stress count that do work on the sampled inputs; the others are not learned.
    """
    beyond = predicted.outside_training_range
    inside = np.ones(len(truth), dtype=bool) if beyond is None or beyond.all() else ~beyond
    moved = [column for column in data.inputs.columns if column < 9]
    errors = {}
    for name in ("mean_grad", "stress", "fluid_volume"):
        found, known = getattr(predicted, name), getattr(truth, name)
        if found is None or known is None:
            continue
        found, known = (array.reshape(len(truth), -1)[inside] for array in (found, known))
        if name == "stress":
            found, known = found[:, moved], known[:, moved]
        spread = float(np.ptp(known, axis=0).max(initial=0.0))
        if spread > 0:
            errors[name] = float(np.sqrt(((found - known) ** 2).mean(axis=0)).max() / spread)
    return errors


def _learned_outputs(truth: CellResponse) -> int:
    spread: Array = np.ptp(truth.mean_grad.reshape(len(truth), -1), axis=0)
    return int((spread > 1e-6 * spread.max()).sum()) or 1


#: Kind of these results in the store.
TUNINGS = "tunings"


class KnownTrainings:
    """Results of candidates in the store, by all that they depend on.

    Parameters
    ----------
    data, held_out
        Samples that the candidates are trained on, and states with responses that they are measured on.
    """

    def __init__(
        self,
        store: ResultStore,
        config: RunConfig,
        data: TrainingSet,
        held_out: tuple[MacroState, CellResponse],
    ) -> None:
        self._store, self._config, self._data = store, config, data
        self._measured = arrays_hash(*held_out)

    def find(self, grid: Sequence[Candidate], tell: Callable[[str], None]) -> dict[Candidate, Result]:
        """Return the results that the store holds, and tell how many they are."""
        stored = {candidate: self._store.find(TUNINGS, self._key(candidate)) for candidate in grid}
        found = {
            candidate: Result(**json.loads(each.payload))
            for candidate, each in stored.items()
            if each is not None
        }
        if found:
            took = duration(sum(result.seconds for result in found.values()))
            tell(f"tuning: {len(found)} trained networks came from the store, which saved {took}")
        return found

    def keep(self, candidate: Candidate, result: Result) -> None:
        """Keep the result of a candidate."""
        payload = json.dumps(asdict(result)).encode()
        self._store.keep(TUNINGS, self._key(candidate), payload, {"seconds": result.seconds})

    def _key(self, candidate: Candidate) -> str:
        surrogate = with_architecture(self._config, candidate).surrogate
        options = surrogate.options | {"model": self._config.surrogate_model, "measured on": self._measured}
        return training_key(surrogate.backend, options, surrogate.seed, self._data)


FORMAT, VERSION = "porocore-tune", 1


def write_tables(
    folder: RunFolder, config: RunConfig, results: Sequence[Result], chosen: Result, margin: float
) -> tuple[Path, Path, Path]:
    """Write ``tune.json``, ``tune.csv`` and the figure ``tune.png`` into the run folder; return their paths."""
    from porocore.report.figures.sampling import tuning_figure

    paths = tuple(folder.path / f"tune.{ending}" for ending in ("json", "csv", "png"))
    document = {
        "format": FORMAT,
        "version": VERSION,
        "backend": config.surrogate.backend,
        "model": config.surrogate_model,
        "margin": margin,
        "chosen": asdict(chosen),
        "candidates": [asdict(result) for result in results],
    }
    write_json(paths[0], document, indent=2, allow_nan=False)
    names = sorted({name for result in results for name in result.errors})
    with atomic_path(paths[1]) as part, open(part, "w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["depth", "width", "activation", "parameters", "error", *names, "seconds"])
        for r in results:
            rows.writerow(
                [r.depth, r.width, r.activation, r.parameters, r.error, *map(r.errors.get, names), r.seconds]
            )
    with atomic_path(paths[2]) as part:
        points = [(r.activation, r.parameters, r.error) for r in results if r.error is not None]
        assert chosen.error is not None
        best = min(error for _, _, error in points)
        part.write_bytes(tuning_figure(points, (chosen.parameters, chosen.error), (1 + margin) * best))
    return paths[0], paths[1], paths[2]


def text_table(results: Sequence[Result], chosen: Result) -> Iterator[str]:
    """Yield the lines of the table, smallest network first."""
    yield f"{'hidden':<16}{'activation':<12}{'parameters':>11}{'error':>11}{'training':>11}"
    for r in results:
        error = "diverged" if r.error is None else f"{100 * r.error:.3g} %"
        mark = "  <- chosen" if r == chosen else ""
        hidden = str(r.candidate.hidden)
        yield f"{hidden:<16}{r.activation:<12}{r.parameters:>11}{error:>11}{r.seconds:>9.1f} s{mark}"


#: Key, and a function at the top level of a module with its first arguments.
Task = tuple[str, tuple[Callable[..., Any], tuple[Any, ...]]]

_shared: tuple[Any, ...] = ()


def run_tasks(
    tasks: list[Task], shared: tuple[Any, ...], workers: int
) -> Generator[tuple[str, Any], None, None]:
    """Yield (key, result) of each task, called with its arguments followed by ``shared``, in the order of completion.

    With one worker, or one task, they run in this process. Workers ignore Ctrl-C and end when this generator is
    left or this process ends.

    Raises
    ------
    PorocoreError
        A worker died, or this process may not have workers; an exception of a task is raised as it is.
    """
    workers = min(workers, len(tasks))
    if workers <= 1:
        for key, (function, arguments) in tasks:
            yield key, function(*arguments, *shared)
        return
    require_children()
    others = set(active_children())
    executor = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_start, initargs=(shared,))
    try:
        with starting_children():  # a worker starts as its task is submitted
            futures = {
                executor.submit(_call, function, arguments): key for key, (function, arguments) in tasks
            }
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BrokenProcessPool as error:
        raise PorocoreError(
            "a worker process ended without a message; if memory ran out, use fewer with --workers"
        ) from error
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
        for process in set(active_children()) - others:
            process.terminate()
            process.join()


def _start(shared: tuple[Any, ...]) -> None:
    global _shared
    _shared = shared
    begin_child()


def _call(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    return function(*arguments, *_shared)


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
