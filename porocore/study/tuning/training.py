"""Training of one candidate, and its error on the held-out states."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass

import numpy as np

from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.states import Array, CellResponse, MacroState
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.tuning.candidates import Candidate


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
