"""Which network is large enough: every architecture of a grid trained on the samples of a run (Dehghani & Zilian).

The error of each is measured on the held-out states, and the smallest network whose error is within a margin of
the best is chosen. Finished candidates are kept in the run folder, so an interrupted search goes on where it was.
"""

from __future__ import annotations

import csv
import hashlib
import itertools
import json
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.echo import cut, echo
from porocore.core.files.atomic import atomic_path
from porocore.core.files.reading import read_json
from porocore.errors import ConfigurationError, DataError
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.sampling.datasets.dataset import Dataset
from porocore.states import Array, CellResponse, MacroState
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.run_folder.folder import RunFolder
from porocore.study.stages.stage_files import training_set
from porocore.study.tuning.workers import Task, run_tasks
from porocore.surrogates.network.options import MOST_LAYERS, MOST_WIDTH

FORMAT, VERSION = "porocore-tune", 1
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
        """As in the configuration."""
        return [self.width] * self.depth

    @property
    def key(self) -> str:
        """Name of its file."""
        return f"{self.depth}x{self.width}-{self.activation}"

    def parameters(self, inputs: int, outputs: int) -> int:
        """Weights and biases."""
        widths = [inputs, *self.hidden, outputs]
        return sum((a + 1) * b for a, b in itertools.pairwise(widths))


@dataclass(frozen=True)
class Result:
    """A trained candidate.

    Attributes
    ----------
    parameters
        Size: weights and biases.
    error
        Root mean square on the held-out states of the worst response, a share of its range; None where the
        training went astray.
    errors
        The same for each response.
    seconds
        Of training [s].
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
        """What was trained."""
        return Candidate(self.depth, self.width, self.activation)


def candidates(
    config: RunConfig,
    depths: Sequence[int] = DEPTHS,
    widths: Sequence[int] = WIDTHS,
    activations: Sequence[str] | None = None,
) -> list[Candidate]:
    """The grid, with all activations of the model unless some are given.

    Raises
    ------
    ConfigurationError
        The surrogate has no options ``hidden`` and ``activation``, or does not take these values.
    PluginError
        The surrogate is unknown or missing.
    """
    make_backend("surrogate", config)  # whatever else is wrong is said first
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


def tune(
    folder: RunFolder,
    config: RunConfig,
    grid: Sequence[Candidate],
    *,
    workers: int = 1,
    on_result: Callable[[int, Result | None], None] | None = None,
) -> list[Result]:
    """Train all candidates that the folder does not hold; the results, smallest network first.

    Parameters
    ----------
    config
        That of the run, perhaps with another surrogate; its options apply but for ``hidden`` and ``activation``.
    workers
        Number of processes, one thread each.
    on_result
        Called with the number of results so far, first with what was there already, and the latest one.

    Raises
    ------
    RunFolderError, DataError
        Sampling is not finished or gave too few states, or the folder cannot be written.
    """
    # All candidates are compared at the same states, not each where it trusts itself.
    data = replace(training_set(folder, config), tolerance=None)
    held_out = _held_out(folder, config)
    places = {candidate: _place(folder, config, candidate) for candidate in grid}
    results = {candidate: found for candidate, path in places.items() if (found := _read(path)) is not None}
    if on_result is not None:
        on_result(len(results), None)
    tasks: list[Task] = [
        (candidate.key, (train_candidate, (with_architecture(config, candidate), candidate)))
        for candidate in sorted(grid, key=lambda c: -c.parameters(len(data.inputs), 1))  # the longest first
        if candidate not in results
    ]
    by_key = {candidate.key: candidate for candidate in grid}
    for key, result in run_tasks(tasks, (data, *held_out), workers):
        candidate = by_key[key]
        _write(places[candidate], result)
        results[candidate] = result
        if on_result is not None:
            on_result(len(results), result)
    return sorted(results.values(), key=lambda r: (r.parameters, r.depth, r.activation))


def train_candidate(
    config: RunConfig, candidate: Candidate, data: TrainingSet, states: MacroState, truth: CellResponse
) -> Result:
    """Train one and measure it on the states that it has not seen."""
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
    """Root mean square of the worst component over the largest range of one, for each response that is predicted.

    Of the stress only the components that do work on the sampled inputs count; the others are not learned.
    """
    inside = (
        np.ones(len(truth), dtype=bool)
        if predicted.outside_training_range is None
        else ~predicted.outside_training_range
    )
    if not inside.any():
        inside[:] = True
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


def smallest_good(results: Sequence[Result], margin: float) -> Result:
    """The smallest network whose error is at most 1 + ``margin`` times the best; the first of ``results`` that is.

    Raises
    ------
    DataError
        Every training went astray.
    """
    known = [result.error for result in results if result.error is not None]
    if not known:
        raise DataError("every training went astray; change surrogate.options or sample more states")
    limit = (1 + margin) * min(known)
    return next(result for result in results if result.error is not None and result.error <= limit)


def write_tables(
    folder: RunFolder, config: RunConfig, results: Sequence[Result], chosen: Result, margin: float
) -> tuple[Path, Path, Path]:
    """``tune.json``, ``tune.csv`` and the figure ``tune.png`` in the run folder."""
    from porocore.report.figures.tuning import tuning_figure

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
    with atomic_path(paths[0]) as part:
        part.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")
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


def with_architecture(config: RunConfig, candidate: Candidate) -> RunConfig:
    """The configuration whose surrogate has this architecture."""
    return _with_options(config, {"hidden": candidate.hidden, "activation": candidate.activation})


def _with_options(config: RunConfig, update: dict[str, Any]) -> RunConfig:
    kept = {k: v for k, v in config.surrogate.options.items() if k not in ("hidden", "activation")}
    surrogate = config.surrogate.model_copy(update={"options": {**kept, **update}})
    return config.model_copy(update={"surrogate": surrogate})


def _takes(config: RunConfig, candidate: Candidate) -> bool:
    try:
        make_backend("surrogate", with_architecture(config, candidate))
    except ConfigurationError:
        return False
    return True


def _held_out(folder: RunFolder, config: RunConfig) -> tuple[MacroState, CellResponse]:
    path = folder.require(folder.test_dataset, "sample")
    dataset = Dataset.open(path, inputs=config.sampling.input_space(), identity=config.stages.test)
    responses = dataset.responses()
    good = np.flatnonzero(responses.stable)
    if not len(good):
        raise DataError(
            f"{path}: none of the {len(dataset)} held-out states is stable; narrow sampling.inputs"
        )
    return dataset.states()[good], responses[good]


def _learned_outputs(truth: CellResponse) -> int:
    spread: Array = np.ptp(truth.mean_grad.reshape(len(truth), -1), axis=0)
    return int((spread > 1e-6 * spread.max()).sum()) or 1


def _place(folder: RunFolder, config: RunConfig, candidate: Candidate) -> Path:
    """A change of the samples, of the held-out states or of any other option gives another folder."""
    stages = _with_options(config, {}).stages
    identity = hashlib.sha256(f"{stages.training} {stages.test}".encode()).hexdigest()[:12]
    return folder.path / "tune" / identity / f"{candidate.key}.json"


def _read(path: Path) -> Result | None:
    """A finished candidate; one that cannot be read is trained again."""
    try:
        document = read_json(path)
        if (document.pop("format"), document.pop("version")) != (FORMAT, VERSION):
            return None
        return Result(**document)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _write(path: Path, result: Result) -> None:
    with atomic_path(path) as part:
        document = {"format": FORMAT, "version": VERSION, **asdict(result)}
        part.write_text(json.dumps(document, allow_nan=False) + "\n", encoding="utf-8")


def _listed(values: Sequence[int]) -> str:
    return ",".join(map(str, values)) or "nothing"


def lines(results: Sequence[Result], chosen: Result) -> Iterator[str]:
    """The table as text, smallest network first."""
    yield f"{'hidden':<16}{'activation':<12}{'parameters':>11}{'error':>11}{'training':>11}"
    for r in results:
        error = "astray" if r.error is None else f"{100 * r.error:.3g} %"
        mark = "  <- chosen" if r == chosen else ""
        hidden = str(r.candidate.hidden)
        yield f"{hidden:<16}{r.activation:<12}{r.parameters:>11}{error:>11}{r.seconds:>9.1f} s{mark}"
