"""Shared part of the suite of surrogates: training data, the surrogate fitted once, its file."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import pytest

from porocore.interfaces.surrogate import Surrogate, TrainingSet
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
