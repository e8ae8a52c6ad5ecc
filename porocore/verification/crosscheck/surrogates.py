"""The surrogates: each trained on the same states, held against states that it never saw and against the others."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt

from porocore.core.console import Console
from porocore.errors import DataError
from porocore.interfaces.sampler import Sampler
from porocore.interfaces.surrogate import (
    MORE_STATES,
    Surrogate,
    TrainingProgress,
    TrainingSet,
    least_states,
)
from porocore.macro.reference import CellReference
from porocore.plugins.border import prediction_of
from porocore.plugins.registry import registry
from porocore.sampling.campaign import CampaignProgress, run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.samplers.random_states import RandomStates, random_requests
from porocore.states import Array, CellResponse, MacroState
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.run_folder.provenance import versions
from porocore.study.stages.exploration import inform
from porocore.study.stages.stage_files import prepare_cell
from porocore.verification.crosscheck.attempt import attempt
from porocore.verification.crosscheck.cells import RESPONSES
from porocore.verification.crosscheck.comparison import SPREAD, Comparison

#: States at which surrogates are compared with each other; nothing is solved there.
BETWEEN = 500


@dataclass(frozen=True, eq=False)
class SharedSamples:
    """The states that one backend solved for all surrogates.

    Attributes
    ----------
    backend
        Which.
    reference
        Its undeformed cell.
    training
        The stable states of the sampler.
    states, solved
        Held-out states with values.
    seconds
        Wall time.
    """

    backend: str
    reference: CellReference
    training: TrainingSet
    states: MacroState
    solved: CellResponse
    seconds: float

    def span(self, response: str) -> float:
        """Range of the component of a response that varies most, over all solved states; 1 if none varies."""
        both = np.concatenate([getattr(self.training.responses, response), getattr(self.solved, response)])
        # A state whose walls touch has no conductivity, and its other responses.
        both = both[np.isfinite(both.reshape(len(both), -1)).all(axis=1)]
        return float(np.ptp(both, axis=0).max()) or 1.0 if len(both) else 1.0

    def has(self, response: str) -> bool:
        """Tell whether the states hold a response."""
        return getattr(self.solved, response) is not None


@dataclass(frozen=True, eq=False)
class SurrogateRun:
    """One trained surrogate.

    Attributes
    ----------
    name
        Its backend.
    surrogate
        None where training or prediction failed.
    errors
        Largest error on the held-out states within its range, by response, as a share of the span.
    seconds
        Of the training.
    failure
        Why there is none.
    """

    name: str
    surrogate: Surrogate | None
    errors: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    failure: str = ""


def solve_samples(config: RunConfig, backend: str, console: Console) -> SharedSamples:
    """The undeformed cell, the sampler's states and the held-out ones.

    Raises
    ------
    DataError
        Too few states converged.
    """
    settings = config.with_backends(fem=backend)
    inputs = settings.sampling.input_space()
    arguments = (backend, settings.fem.options, settings.cell, settings.conductivity)
    solver, prepared = prepare_cell(*arguments)
    reference = CellReference.compute(solver, prepared, settings.cell, settings.stages.cell)
    sampler: Sampler = make_backend("sampler", settings)
    inform(sampler, settings, reference)
    held_out = RandomStates(inputs, count=settings.sampling.test.count, seed=settings.sampling.test.seed)
    datasets: list[tuple[MacroState, CellResponse]] = []
    seconds = 0.0
    with (
        TemporaryDirectory(prefix="porocore-crosscheck-") as folder,
        CellPool(prepare_cell, arguments, workers=settings.sampling.worker_count(), fields=True) as pool,
    ):
        for title, source in (("states to learn from", sampler), ("held-out states", held_out)):
            path = Path(folder) / f"{len(datasets)}.h5"
            dataset = Dataset.create(path, inputs=inputs, identity=settings.stages.sampling, provenance={})
            with console.task(f"{title}, {backend}", "states") as task:

                def show(progress: CampaignProgress, task: Any = task) -> None:
                    task.update(progress.done, progress.expected, failed=progress.failed)

                seconds += run_campaign(source, pool, dataset, on_progress=show).seconds
            datasets.append((dataset.states(), dataset.responses()))
    (states, responses), (unseen, solved) = datasets
    good, valid = np.flatnonzero(responses.stable), np.flatnonzero(solved.valid)
    if len(good) < (least := least_states(len(inputs))) or not len(valid):
        raise DataError(
            f"{len(good)} of {len(responses)} states to learn from are stable, and {len(valid)} held-out ones have "
            f"values: too few; at least {least} and 1 are needed: {MORE_STATES}"
        )
    training = TrainingSet(
        states[good],
        responses[good],
        inputs,
        reference.resting(settings.conductivity),
        settings.stages.cell,
        versions(),
        settings.cell.point_group,
    )
    return SharedSamples(backend, reference, training, unseen[valid], solved[valid], seconds)


def train(config: RunConfig, name: str, samples: SharedSamples, console: Console) -> SurrogateRun:
    """Fit one surrogate and measure it on the held-out states."""
    settings = config.with_backends(surrogate=name)
    with console.task(f"training, {name}", "epochs") as task:

        def show(progress: TrainingProgress) -> None:
            task.update(progress.epoch, progress.epochs, detail=f"loss {progress.loss:.2e}")

        def fit() -> Surrogate:
            surrogate: Surrogate = make_backend("surrogate", settings)
            return surrogate.fit(samples.training, seed=settings.surrogate.seed, on_progress=show)

        fitted = attempt(fit)
    if fitted.value is None:
        return SurrogateRun(name, None, seconds=fitted.seconds, failure=fitted.reason)
    surrogate = fitted.value
    measured = attempt(held_out_errors, surrogate, samples)
    if measured.value is None:
        return SurrogateRun(name, None, seconds=fitted.seconds, failure=measured.reason)
    return SurrogateRun(name, surrogate, measured.value, fitted.seconds)


def load_libraries(names: tuple[str, ...]) -> None:
    """Load the libraries before the first cell solve, as a run does; a failure shows again in training."""
    for name in names:
        attempt(_load_libraries, name)


def _load_libraries(name: str) -> None:
    registry().get("surrogate", name).load_libraries()


def held_out_errors(surrogate: Surrogate, samples: SharedSamples) -> dict[str, float]:
    """Largest error of each response that it predicts, in the range that it knows, as a share of the span."""
    predicted = prediction_of(surrogate, samples.states, tangent=False)
    inside = _inside(predicted)
    errors = {}
    for response in RESPONSES:
        values, solved = getattr(predicted, response), getattr(samples.solved, response)
        if values is not None and solved is not None:
            known = inside & np.isfinite(solved.reshape(len(solved), -1)).all(axis=1)
            errors[response] = _largest(values[known] - solved[known], samples.span(response))
    return errors


def compare_surrogates(runs: list[SurrogateRun], samples: SharedSamples, seed: int) -> list[Comparison]:
    """Each with the held-out states, and each pair at states between them."""
    found = []
    for run in runs:
        if run.surrogate is None:
            found.append(Comparison.failure("surrogate", "", "training", run.name, run.failure))
        for response, error in run.errors.items():
            found.append(
                Comparison(
                    "surrogate",
                    "held-out states",
                    RESPONSES[response],
                    run.name,
                    "cell solves",
                    error,
                    type(run.surrogate).expected_error if run.surrogate is not None else 0.0,
                )
            )
    inputs = samples.training.inputs
    between = inputs.scatter([request.x for request in random_requests(inputs, BETWEEN, seed + 1)])
    for one, other in combinations([run for run in runs if run.surrogate is not None], 2):
        found += _compare_pair(one, other, between, samples)
    return found


def _compare_pair(
    one: SurrogateRun, other: SurrogateRun, between: MacroState, samples: SharedSamples
) -> list[Comparison]:
    case, found = "between the states", []
    predicted = []
    for run in (one, other):
        assert run.surrogate is not None
        outcome = attempt(run.surrogate.predict, between, tangent=False)
        if outcome.value is None:
            return [Comparison.failure("surrogate", case, "prediction", run.name, outcome.reason)]
        predicted.append(outcome.value)
    a, b = predicted
    expected = [type(run.surrogate).expected_error for run in (one, other) if run.surrogate is not None]
    # What approximates says so; the others are held to what they were measured to reach.
    declared = sum(expected) if max(expected) > Surrogate.expected_error else 0.0
    inside = _inside(a) & _inside(b)
    for response in RESPONSES:
        if response in one.errors and response in other.errors:
            values = getattr(a, response)[inside] - getattr(b, response)[inside]
            tolerance = max(SPREAD * (one.errors[response] + other.errors[response]), declared)
            found.append(
                Comparison(
                    "surrogate",
                    case,
                    RESPONSES[response],
                    one.name,
                    other.name,
                    _largest(values, samples.span(response)),
                    tolerance,
                )
            )
    return found


def _inside(predicted: CellResponse) -> npt.NDArray[np.bool_]:
    """Rows within the range that the surrogate was trained on."""
    if predicted.outside_training_range is None:
        return np.ones(len(predicted), dtype=bool)
    return ~predicted.outside_training_range


def _largest(difference: Array, span: float) -> float:
    """Return the largest difference as a share of the span; infinite without finite predictions."""
    largest = float(np.abs(difference).max(initial=0.0)) / span
    return largest if len(difference) and np.isfinite(largest) else float("inf")
