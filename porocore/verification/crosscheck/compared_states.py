"""States of a crosscheck: three of the cell solver, and samples shared by all surrogates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from porocore.core.console import Console
from porocore.errors import DataError
from porocore.interfaces.sampler import Sampler
from porocore.interfaces.surrogate import MORE_STATES, TrainingSet, least_states
from porocore.macro.reference import CellReference
from porocore.sampling.campaign import CampaignProgress, run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.samplers.random_states import RandomStates, random_requests
from porocore.states import CellResponse, MacroState
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.run_folder.provenance import versions
from porocore.study.stages.exploration import inform
from porocore.study.stages.stage_files import prepare_cell
from porocore.verification.crosscheck.attempt import attempt
from porocore.verification.crosscheck.comparison import Comparison

_SHEAR = np.array([[0, 0.1, 0], [0, -0.05, 0], [0, 0, 0]])
#: The states at which cell solvers are compared; the last needs the whole cell.
STATES: dict[str, MacroState] = {
    "at rest": MacroState.zeros(1),
    "H₂₂ = −0.15, p = 0.1": MacroState.single(np.diag([0.0, -0.15, 0.0]), 0.1),
    "H₁₂ = 0.1, H₂₂ = −0.05, p = 0.05": MacroState.single(_SHEAR, 0.05),
}
#: States between the samples, at which surrogates are compared with each other; nothing is solved there.
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

    def between(self, seed: int) -> MacroState:
        """Return the :data:`BETWEEN` random states of the sampled box at which surrogates are compared."""
        inputs = self.training.inputs
        return inputs.scatter([request.x for request in random_requests(inputs, BETWEEN, seed + 1)])


def share_samples(
    config: RunConfig, backends: Sequence[str], console: Console
) -> tuple[SharedSamples | None, list[Comparison]]:
    """Return samples of the configured backend if it takes part, else of the first that can."""
    failures: list[Comparison] = []
    for name in sorted(backends, key=lambda name: name != config.fem.backend):
        outcome = attempt(solve_samples, config, name, console)
        if outcome.value is not None:
            return outcome.value, failures
        failures.append(Comparison.failure("cell", "", "samples", name, outcome.reason))
    return None, failures


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
                    failed, seconds = progress.failed, progress.seconds
                    task.update(progress.done, progress.expected, failed=failed, seconds=seconds)

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
