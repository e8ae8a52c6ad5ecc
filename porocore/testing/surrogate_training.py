"""Training a surrogate: by a seed alone, interrupted and resumed."""

from __future__ import annotations

import shutil
import time
from dataclasses import replace
from pathlib import Path

import pytest

from porocore.errors import DataError
from porocore.interfaces.surrogate import Surrogate, TrainingProgress, TrainingSet
from porocore.testing.compare import assert_identical, global_random_state
from porocore.testing.surrogate_fitting import Fitting


class _Stop(Exception):
    """Interrupts a training."""


class Trainings(Fitting):
    """Part of :class:`porocore.testing.surrogate.SurrogateSuite`."""

    def test_training_is_seeded(self, fitted: Surrogate, data: TrainingSet, unseen: TrainingSet) -> None:
        before = global_random_state()
        again = self.make_surrogate().fit(data, seed=self.seed)
        other = self.make_surrogate().fit(data, seed=self.seed + 1)
        assert before == global_random_state(), "the training drew from a global random number generator"
        assert_identical(fitted.predict(unseen.states), again.predict(unseen.states))
        if self.random is None:
            return
        one, two = fitted.predict(unseen.states), other.predict(unseen.states)
        if not self.random:
            assert_identical(one, two)
            return
        learned = "mean_grad" if one.potential is None else "potential"
        assert (getattr(one, learned) != getattr(two, learned)).any()

    @pytest.fixture(scope="class")
    @classmethod
    def interruption(
        cls, data: TrainingSet, tmp_path_factory: pytest.TempPathFactory
    ) -> tuple[Path, TrainingProgress]:
        """The checkpoint of a training that was stopped, and its last report. Not to be changed."""
        if not cls.resumable:
            pytest.skip("this training is short and begins anew")
        path = tmp_path_factory.mktemp("interrupted") / "training.h5"
        last, count = TrainingProgress(0, 0, 0.0, 0.0), 0

        def stop(progress: TrainingProgress) -> None:
            nonlocal last, count
            last, count = progress, count + 1
            deadline = time.monotonic() + (0.5 if not path.exists() else 0.0)
            while time.monotonic() < deadline:
                time.sleep(0.05)
            if path.exists() and count >= 3:
                raise _Stop

        with pytest.MonkeyPatch.context() as patch:
            cls().checkpoint_often(patch)
            with pytest.raises(_Stop):
                cls.make_surrogate().fit(data, seed=cls.seed, checkpoint=path, on_progress=stop)
        assert path.exists(), "no checkpoint was written before the training ended"
        return path, last

    @pytest.fixture
    def interrupted(
        self, interruption: tuple[Path, TrainingProgress], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> tuple[Path, TrainingProgress]:
        """A copy, for a training that writes checkpoints as often."""
        kept, last = interruption
        self.checkpoint_often(monkeypatch)
        return Path(shutil.copy(kept, tmp_path)), last

    def test_resumed_training_equals_an_uninterrupted_one(
        self,
        fitted: Surrogate,
        interrupted: tuple[Path, TrainingProgress],
        data: TrainingSet,
        unseen: TrainingSet,
        tmp_path: Path,
    ) -> None:
        checkpoint, last = interrupted
        epochs: list[int] = []

        def report(progress: TrainingProgress) -> None:
            epochs.append(progress.epoch)

        resumed = self.make_surrogate().fit(data, seed=self.seed, checkpoint=checkpoint, on_progress=report)
        assert epochs[0] >= last.epoch, "the training began anew"
        assert_identical(fitted.predict(unseen.states), resumed.predict(unseen.states))

    def test_a_checkpoint_of_another_training_is_refused(
        self, interrupted: tuple[Path, TrainingProgress], data: TrainingSet, tmp_path: Path
    ) -> None:
        checkpoint, _ = interrupted
        kept = shutil.copy(checkpoint, tmp_path / "kept.h5")
        changed = replace(data, states=data.states[:-1], responses=data.responses[:-1])
        for other, seed in ((changed, self.seed), (data, self.seed + 1)):
            with pytest.raises(DataError, match=rf"{checkpoint.name}.*remove"):
                self.make_surrogate().fit(other, seed=seed, checkpoint=checkpoint)
        assert checkpoint.read_bytes() == Path(kept).read_bytes(), "a refused checkpoint was written to"

    def test_a_truncated_checkpoint_is_refused(
        self, interrupted: tuple[Path, TrainingProgress], data: TrainingSet
    ) -> None:
        checkpoint, _ = interrupted
        whole = checkpoint.read_bytes()
        checkpoint.write_bytes(whole[: len(whole) // 2])
        with pytest.raises(DataError, match=rf"{checkpoint.name}.*remove"):
            self.make_surrogate().fit(data, seed=self.seed, checkpoint=checkpoint)

    def test_what_is_not_resumable_leaves_no_checkpoint(self, data: TrainingSet, tmp_path: Path) -> None:
        if self.resumable is not False:
            pytest.skip("this training writes checkpoints, or may do so")
        self.make_surrogate().fit(data, seed=self.seed, checkpoint=tmp_path / "training.h5")
        assert list(tmp_path.iterdir()) == []
