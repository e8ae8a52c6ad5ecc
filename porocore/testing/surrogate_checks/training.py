"""Checks of a training: by a seed alone, interrupted and resumed, refused checkpoints."""

from __future__ import annotations

import shutil
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import pytest

from porocore.errors import DataError
from porocore.interfaces.surrogate import Surrogate, TrainingProgress, TrainingSet
from porocore.testing.expect import assert_identical, global_random_state, holds, refused
from porocore.testing.suite import Suite
from porocore.testing.synthetic.cell import synthetic_training_set


class Fitting(Suite):
    """A suite that trains the surrogate under test on the made-up cell, once."""

    #: Options that the constructor must refuse, one after the other.
    invalid_options: ClassVar[tuple[dict[str, Any], ...]] = ({"no_such_option": 1},)
    seed = 5
    #: Whether the training depends on the seed; None: not said, and not tested.
    random: ClassVar[bool | None] = True
    #: Whether the training writes checkpoints; one of seconds may do without, and begin anew. None: not said.
    resumable: ClassVar[bool | None] = True

    @classmethod
    def make_surrogate(cls) -> Surrogate:
        """An untrained surrogate whose training takes seconds and reports progress at least five times."""
        raise cls.undefined("make_surrogate(cls)", "MySurrogate()", "an untrained porocore.Surrogate")

    @classmethod
    def make_invalid(cls, options: dict[str, Any]) -> Surrogate:
        """The surrogate with ``options``, one of :attr:`invalid_options`."""
        return type(cls.make_surrogate())(**options)

    def checkpoint_often(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Make the training write a checkpoint at every opportunity; without it the tests wait for the first."""

    @classmethod
    def training_data(cls) -> TrainingSet:
        """A new copy of what it is trained on."""
        return synthetic_training_set(240, seed=1)

    @staticmethod
    def accuracy(surrogate: Surrogate) -> float:
        """Largest root mean square error on unseen states, over the range of each component: of the declared one."""
        return 0.6 * type(surrogate).expected_error

    @staticmethod
    def derivative_accuracy(surrogate: Surrogate) -> float:
        """The same for the derivatives with respect to the sampled inputs."""
        return 6 * type(surrogate).expected_error

    @pytest.fixture(scope="class")
    @classmethod
    def data(cls) -> TrainingSet:
        return cls.training_data()

    @pytest.fixture(scope="class")
    @classmethod
    def unseen(cls) -> TrainingSet:
        return synthetic_training_set(500, seed=2)

    @pytest.fixture(scope="class")
    @classmethod
    def fitted(cls, data: TrainingSet) -> Surrogate:
        return cls.make_surrogate().fit(data, seed=cls.seed)

    @pytest.fixture
    def saved(self, fitted: Surrogate, tmp_path: Path) -> Path:
        path = tmp_path / "surrogate.h5"
        fitted.save(path)
        return path


class _Stop(Exception):
    """Interrupts a training."""


class Trainings(Fitting):
    """Part of :class:`porocore.testing.surrogate_checks.base.SurrogateSuite`."""

    def test_training_is_seeded(self, fitted: Surrogate, data: TrainingSet, unseen: TrainingSet) -> None:
        before = global_random_state()
        again = self.make_surrogate().fit(data, seed=self.seed)
        other = self.make_surrogate().fit(data, seed=self.seed + 1)
        untouched = before == global_random_state()
        holds(untouched, f"seed {self.seed}", "no draw from a global random number generator", "one")
        one, two = fitted.predict(unseen.states), other.predict(unseen.states)
        assert_identical(again.predict(unseen.states), one, f"trained twice with seed {self.seed}")
        if self.random is None:
            return
        state = f"seeds {self.seed} and {self.seed + 1}"
        if not self.random:
            assert_identical(two, one, f"{state}, random = False")
            return
        learned = "mean_grad" if one.potential is None else "potential"
        differ = (getattr(one, learned) != getattr(two, learned)).any()
        holds(differ, f"{state}, random = True", f"another {learned}", "the same")

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
            with suppress(_Stop):
                cls.make_surrogate().fit(data, seed=cls.seed, checkpoint=path, on_progress=stop)
        state = "interrupted after three reports of progress"
        holds(path.exists(), state, "a checkpoint, since resumable = True", "none")
        holds(count >= 3, state, "at least three reports of progress", count)
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
        state = f"interrupted at epoch {last.epoch} and resumed"
        first = epochs[0] if epochs else None
        holds(first is not None and first >= last.epoch, state, f"to go on at epoch {last.epoch}", first)
        assert_identical(resumed.predict(unseen.states), fitted.predict(unseen.states), state)

    def test_a_checkpoint_of_another_training_is_refused(
        self, interrupted: tuple[Path, TrainingProgress], data: TrainingSet, tmp_path: Path
    ) -> None:
        checkpoint, _ = interrupted
        kept = shutil.copy(checkpoint, tmp_path / "kept.h5")
        changed = replace(data, states=data.states[:-1], responses=data.responses[:-1])
        for other, seed in ((changed, self.seed), (data, self.seed + 1)):
            state = f"the checkpoint of seed {self.seed}, for seed {seed} and {len(other.states)} states"
            with refused(DataError, state=state, naming=(checkpoint.name, "move it")):
                self.make_surrogate().fit(other, seed=seed, checkpoint=checkpoint)
        before, after = Path(kept).read_bytes(), checkpoint.read_bytes()
        holds(after == before, "a refused checkpoint", "the file as it was", "another content")

    def test_a_truncated_checkpoint_is_refused(
        self, interrupted: tuple[Path, TrainingProgress], data: TrainingSet
    ) -> None:
        checkpoint, _ = interrupted
        whole = checkpoint.read_bytes()
        checkpoint.write_bytes(whole[: len(whole) // 2])
        with refused(DataError, state="half of a checkpoint", naming=(checkpoint.name, "move it")):
            self.make_surrogate().fit(data, seed=self.seed, checkpoint=checkpoint)

    def test_what_is_not_resumable_leaves_no_checkpoint(self, data: TrainingSet, tmp_path: Path) -> None:
        if self.resumable is not False:
            pytest.skip("this training writes checkpoints, or may do so")
        self.make_surrogate().fit(data, seed=self.seed, checkpoint=tmp_path / "training.h5")
        left = [path.name for path in tmp_path.iterdir()]
        holds(not left, "resumable = False", "no file left behind", left)
