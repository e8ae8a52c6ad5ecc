"""Crosscheck of surrogates: training, errors on held-out states, pairs compared between states."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
import numpy.typing as npt

from porocore.core.console import Console
from porocore.interfaces.surrogate import Surrogate, TrainingProgress
from porocore.plugins.border import prediction_of
from porocore.plugins.registry import registry
from porocore.states import Array, CellResponse, MacroState
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.verification.crosscheck.attempt import attempt
from porocore.verification.crosscheck.cells import RESPONSES
from porocore.verification.crosscheck.compared_states import SharedSamples
from porocore.verification.crosscheck.comparison import SPREAD, Comparison


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


def train(config: RunConfig, name: str, samples: SharedSamples, console: Console) -> SurrogateRun:
    """Fit one surrogate and measure it on the held-out states."""
    settings = config.with_backends(surrogate=name)
    with console.task(f"training, {name}", "epochs") as task:

        def show(progress: TrainingProgress) -> None:
            task.unit, work = progress.unit, (progress.epoch, progress.left)
            task.update(progress.epoch, progress.epochs, detail=f"loss {progress.loss:.2e}", work=work)

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
            allowed = type(run.surrogate).expected_error if run.surrogate is not None else 0.0
            found.append(
                Comparison(
                    "surrogate",
                    "held-out states",
                    RESPONSES[response],
                    run.name,
                    "cell solves",
                    error,
                    allowed,
                )
            )
    between = samples.between(seed)
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
            difference = _largest(values, samples.span(response))
            symbol = RESPONSES[response]
            found.append(Comparison("surrogate", case, symbol, one.name, other.name, difference, tolerance))
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
