"""Surrogates that break one law of their training each."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import ClassVar

import numpy as np

from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingProgress
from tests.testing.wrong.polynomials import Altered, Law


class TestChance(Law):
    caught_by = "test_training_is_seeded"

    class surrogate(Altered):
        def fit(self, data, **how):
            self.bias = 1e-9 * np.random.default_rng().random()
            return super().fit(data, **how)

        def alter(self, response, states):
            return replace(response, potential=response.potential + self.bias)


class TestGlobalRandomNumbers(Law):
    caught_by = "test_training_is_seeded"

    class surrogate(Altered):
        def fit(self, data, **how):
            np.random.random()  # noqa: NPY002
            return super().fit(data, **how)


class TestSeedIsIgnored(Law):
    caught_by = "test_training_is_seeded"
    random: ClassVar = True


class Stepwise(Altered):
    """Ten steps, of which each is noted in the checkpoint."""

    def fit(self, data, *, seed, checkpoint=None, on_progress=None):
        first = self.begin(checkpoint, [len(data.states), seed]) if checkpoint and checkpoint.exists() else 0
        for step in range(first, 10):
            if checkpoint:
                checkpoint.write_text(json.dumps([len(data.states), seed, step]))
            if on_progress:
                on_progress(TrainingProgress(step, 10, 1.0, 1.0))
        return super().fit(data, seed=seed)

    def begin(self, checkpoint, owner):
        try:
            *found, step = json.loads(checkpoint.read_text())
        except (ValueError, TypeError) as error:
            raise DataError(f"{checkpoint.name}: move it away") from error
        if found != owner:
            raise DataError(f"{checkpoint.name}: of another training; move it away")
        return step


class TestStepwise(Law):
    resumable: ClassVar = True
    surrogate = Stepwise
    caught_by = ""


class TestBeginsAnew(Law):
    resumable: ClassVar = True
    caught_by = "test_resumed_training_equals_an_uninterrupted_one"

    class surrogate(Stepwise):
        def begin(self, checkpoint, owner):
            super().begin(checkpoint, owner)
            return 0


class TestTakesOtherCheckpoints(Law):
    resumable: ClassVar = True
    caught_by = "test_a_checkpoint_of_another_training_is_refused"

    class surrogate(Stepwise):
        def begin(self, checkpoint, owner):
            return json.loads(checkpoint.read_text())[-1]


class TestTakesTruncatedCheckpoints(Law):
    resumable: ClassVar = True
    caught_by = "test_a_truncated_checkpoint_is_refused"

    class surrogate(Stepwise):
        def begin(self, checkpoint, owner):
            try:
                return super().begin(checkpoint, owner)
            except DataError as error:
                if "another" in str(error):
                    raise
                return 0


class TestLeavesACheckpoint(Law):
    surrogate = Stepwise
    caught_by = "test_what_is_not_resumable_leaves_no_checkpoint"


# ---- potentials -----------------------------------------------------------------------------------
