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
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.console import Console
from porocore.core.echo import cut, echo
from porocore.core.files.atomic import atomic_path
from porocore.core.files.plain_data import stable_hash, write_json
from porocore.core.files.reading import read_json
from porocore.core.files.store import ResultStore
from porocore.core.parallel.calls import Tell
from porocore.errors import ConfigurationError, DataError
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Array, CellResponse, MacroState
from porocore.study.config.config import RunConfig
from porocore.study.run.composition import make_backend, training_set
from porocore.study.run.folder import RunFolder
from porocore.study.series import Case, RunSeries
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

    def size(self, inputs: int, outputs: int) -> int:
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
        given = ",".join(map(str, values)) or "nothing"
        if not values or min(values) < 1 or max(values) > most:
            raise ConfigurationError(
                f"{option}: expected whole numbers from 1 to {most}, such as 1,2,3, got {cut(given)}"
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


@dataclass(frozen=True)
class Result(Candidate):
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

    parameters: int
    error: float | None
    errors: dict[str, float]
    seconds: float


def train_candidate(
    tell: Tell,
    config: RunConfig,
    candidate: Candidate,
    data: TrainingSet,
    states: MacroState,
    truth: CellResponse,
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
    # An output of the network is W, or a component that is learned.
    spread: Array = np.ptp(truth.mean_grad.reshape(len(truth), -1), axis=0)
    learned = int((spread > 1e-6 * spread.max()).sum()) or 1
    outputs = 1 if predicted.potential is not None else learned
    size = candidate.size(len(data.inputs), outputs)
    finite = {name: value for name, value in errors.items() if math.isfinite(value)}
    error = worst if math.isfinite(worst) else None
    return Result(**asdict(candidate), parameters=size, error=error, errors=finite, seconds=round(seconds, 3))


def held_out_errors(predicted: CellResponse, truth: CellResponse, data: TrainingSet) -> dict[str, float]:
    """Return the root-mean-square error of the worst component over the largest range, for each predicted response.

    Only those components of the stress count that do work on the sampled inputs; the others are not learned.
    """
    flagged = predicted.flagged
    inside = flagged if flagged.all() else ~flagged
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


#: Kind of these results in the store.
TUNINGS = "tunings"


class TuningSeries(RunSeries[Result]):
    """Candidates that are trained on the samples of a run, and measured on its held-out states.

    The run folder keeps each in a file; other samples, held-out states or options give another folder.

    Parameters
    ----------
    folder, config
        The run, and its configuration or one with another surrogate.
    store
        Networks that it knows are not trained.
    """

    title, unit = "tuning", "candidates"
    function = train_candidate

    def __init__(self, folder: RunFolder, config: RunConfig, store: ResultStore | None) -> None:
        super().__init__({})
        # No candidate may leave out the states that it flags.
        self._data = replace(training_set(folder.with_config(config)), tolerance=None)
        self._held_out, self._config, self._store = _held_out(folder, config), config, store
        self._measured = arrays_hash(*self._held_out)
        stages = with_options(config, {}).stages
        self._folder = folder.path / "tune" / stable_hash(f"{stages.training} {stages.test}", length=12)

    def cases(self, grid: Sequence[Candidate]) -> list[Case]:
        """Return the candidates as cases, those first that take longest."""
        longest_first = sorted(grid, key=lambda each: -each.size(len(self._data.inputs), 1))
        return [
            Case(
                each.key,
                (with_architecture(self._config, each), each, self._data, *self._held_out),
                f"the network {each.key}",
            )
            for each in longest_first
        ]

    def find(self, case: Case) -> Result | None:
        """Return a finished candidate, None for one to train again."""
        try:
            document = read_json(self._place(case))
            if (document.pop("format"), document.pop("version")) != (FORMAT, VERSION):
                return None
            return Result(**document)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None

    def save(self, case: Case, result: Result) -> None:
        """Save a candidate in the folder and in the store."""
        document = {"format": FORMAT, "version": VERSION, **asdict(result)}
        write_json(self._place(case), document, allow_nan=False)
        if self._store is not None:
            payload = json.dumps(asdict(result)).encode()
            self._store.keep(TUNINGS, self._key(case), payload, {"seconds": result.seconds})

    def stored(self, case: Case) -> tuple[Result, float] | None:
        """Return a candidate that the store knows."""
        found = None if self._store is None else self._store.find(TUNINGS, self._key(case))
        result = None if found is None else Result(**json.loads(found.payload))
        return None if result is None else (result, result.seconds)

    def describe(self, case: Case, result: Result) -> str:
        """Return the candidate and its error."""
        return case.key if result.error is None else f"{case.key}, error {100 * result.error:.2g} %"

    def _place(self, case: Case) -> Path:
        return self._folder / f"{case.key}.json"

    def _key(self, case: Case) -> str:
        """Return the hash of all that the result depends on."""
        surrogate, model = case.arguments[0].surrogate, self._config.surrogate_model
        options = surrogate.options | {"model": model, "measured on": self._measured}
        return training_key(surrogate.backend, options, surrogate.seed, self._data)


FORMAT, VERSION = "porocore-tune", 1


def write_tables(
    folder: RunFolder, config: RunConfig, results: Sequence[Result], chosen: Result, margin: float
) -> tuple[Path, Path, Path]:
    """Write ``tune.json``, ``tune.csv`` and the figure ``tune.png`` into the run folder; return their paths."""
    from porocore.report.figures.sampling import tuning_figure
    from porocore.report.figures.style import write_pictures

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
        rows.writerows(
            [r.depth, r.width, r.activation, r.parameters, r.error, *map(r.errors.get, names), r.seconds]
            for r in results
        )
    points = [(r.activation, r.parameters, r.error) for r in results if r.error is not None]
    assert chosen.error is not None
    limit = (1 + margin) * min(error for _, _, error in points)
    write_pictures(tuning_figure(points, (chosen.parameters, chosen.error), limit), paths[2])
    return paths[0], paths[1], paths[2]


def text_table(results: Sequence[Result], chosen: Result) -> Iterator[str]:
    """Yield the lines of the table, smallest network first."""
    yield f"{'hidden':<16}{'activation':<12}{'parameters':>11}{'error':>11}{'training':>11}"
    for r in results:
        error = "diverged" if r.error is None else f"{100 * r.error:.3g} %"
        mark = "  <- chosen" if r == chosen else ""
        yield f"{r.hidden!s:<16}{r.activation:<12}{r.parameters:>11}{error:>11}{r.seconds:>9.1f} s{mark}"


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
    count = config.sampling.worker_count() if workers is None else workers
    trainings = TuningSeries(folder, config, store)
    results = trainings.run(trainings.cases(grid), console, count)
    results.sort(key=lambda r: (r.parameters, r.depth, r.activation))
    chosen = smallest_good(results, margin)
    return Tuning(results, chosen, write_tables(folder, config, results, chosen, margin))


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
