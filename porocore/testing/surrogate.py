"""The laws that every surrogate obeys, as tests that a plugin author subclasses.

.. code-block:: python

    class TestMySurrogate(SurrogateConformance):
        @classmethod
        def make_surrogate(cls):
            return MySurrogate(epochs=500)

The cell that is learned is :mod:`porocore.testing.synthetic_cell`, known in closed form. A surrogate that derives
stress and fluid volume from a potential subclasses :class:`PotentialConformance`.
"""

from __future__ import annotations

import random
import shutil
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import h5py
import numpy as np
import pytest

from porocore.errors import ConfigurationError, DataError
from porocore.interfaces.surrogate import Surrogate, TrainingProgress, TrainingSet
from porocore.states import Array, MacroState
from porocore.testing.compare import RESPONSES, assert_identical, moved, provided
from porocore.testing.synthetic_cell import INPUTS, synthetic_training_set

__all__ = ["PotentialConformance", "SurrogateConformance", "synthetic_training_set"]


class _Stop(Exception):
    """Interrupts a training."""


class SurrogateConformance:
    """Subclass it, name the class ``Test…`` and give it ``make_surrogate``."""

    #: Root mean square error on states that were not trained on, over the range of each component.
    accuracy = 3e-3
    #: The same for the derivatives with respect to the sampled inputs.
    slope_accuracy = 3e-2
    #: Options that the constructor must refuse, one after the other.
    invalid_options: ClassVar[tuple[dict[str, Any], ...]] = ({"no_such_option": 1},)
    seed = 5
    #: Whether the training depends on the seed.
    random = True
    #: Whether the training writes checkpoints; one of seconds may do without, and begin anew.
    resumable = True

    @classmethod
    def make_surrogate(cls) -> Surrogate:
        """An untrained surrogate whose training takes seconds and reports progress at least five times."""
        raise NotImplementedError

    @classmethod
    def make_invalid(cls, options: dict[str, Any]) -> Surrogate:
        """The surrogate with ``options``, one of :attr:`invalid_options`."""
        return type(cls.make_surrogate())(**options)

    def checkpoint_often(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Make the training write a checkpoint at every opportunity; without it the tests wait for the first."""

    @pytest.fixture(scope="class")
    @classmethod
    def data(cls) -> TrainingSet:
        return synthetic_training_set(240, seed=1)

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

    def test_shapes(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        response = fitted.predict(unseen.states)
        n = len(unseen.states)
        assert (response.status == 0).all()
        assert response.outside is not None
        assert response.outside.shape == (n,)
        assert response.mean_grad.shape == (n, 3, 3)
        for name, slopes in provided(response):
            value = getattr(response, name)
            assert slopes[0].shape == (*value.shape, 3, 3)
            assert slopes[1].shape == value.shape
        assert len(fitted.predict(MacroState.zeros(0)).mean_grad) == 0

    def test_learns_the_map(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        predicted = fitted.predict(unseen.states, tangent=False)
        assert predicted.tangent is None
        for name in RESPONSES:
            values, truth = getattr(predicted, name), getattr(unseen.responses, name)
            if values is not None:
                if name == "stress":  # a potential over the inputs knows the stress that works on them
                    values, truth = values[:, 1, 1], truth[:, 1, 1]
                self._compare(name, values, truth, self.accuracy)

    def test_learns_the_slopes(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        predicted = fitted.predict(unseen.states)
        known = dict(provided(unseen.responses))
        for name, (by_H, by_p) in provided(predicted):
            H22 = (..., 1, 1)
            pairs = ((f"d{name}/dH22", by_H[H22], known[name][0][H22]), (f"d{name}/dp", by_p, known[name][1]))
            for what, slopes, truth in pairs:
                if name == "stress":
                    slopes, truth = slopes[:, 1, 1], truth[:, 1, 1]
                self._compare(what, slopes, truth, self.slope_accuracy)

    @staticmethod
    def _compare(what: str, values: Array, truth: Array, accuracy: float) -> None:
        """A component that does not vary must be right to a thousandth of what the largest may be wrong by.

        Where none varies, their size takes the place of the range.
        """
        values, truth = values.reshape(len(values), -1), truth.reshape(len(truth), -1)
        error = np.sqrt(((values - truth) ** 2).mean(axis=0))
        extent = np.ptp(truth, axis=0)
        if extent.max() < 1e-9 * np.abs(truth).max():
            extent = np.abs(truth).max(axis=0)
        assert (error <= accuracy * np.maximum(extent, 1e-3 * extent.max())).all(), (
            f"{what}: {error / extent.max()}"
        )

    def test_derivatives_are_the_slopes(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        """In all ten directions, those that were not sampled included.

        At states that the differences do not carry across the end of the range, where a surrogate may change its
        ways as long as its derivatives go on.
        """
        x = INPUTS.gather(unseen.states)
        inside = ((x > np.array(INPUTS.lower) + 0.01) & (x < np.array(INPUTS.upper) - 0.01)).all(axis=1)
        states = unseen.states[np.flatnonzero(inside)[:40]]
        response = fitted.predict(states)
        slopes = dict(provided(response))
        assert slopes, "no response comes with its derivatives"
        if (
            response.potential is not None
            and response.stress is not None
            and response.fluid_volume is not None
        ):
            slopes["potential"] = response.stress, -response.fluid_volume
        h = 1e-3
        for column in range(10):
            values = [fitted.predict(moved(states, column, k * h), tangent=False) for k in (-2, -1, 1, 2)]
            for name, (by_H, by_p) in slopes.items():
                m2, m1, p1, p2 = (getattr(value, name) for value in values)
                difference = (m2 - 8 * m1 + 8 * p1 - p2) / (12 * h)
                slope = by_p if column == 9 else by_H[..., column // 3, column % 3]
                assert np.abs(difference - slope).max() < 1e-6 * max(np.abs(slope).max(), 1e-3), (
                    name,
                    column,
                )

    def test_rows_do_not_depend_on_the_batch(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        together = fitted.predict(unseen.states[:20])
        for row in range(20):
            alone = fitted.predict(unseen.states[row : row + 1])
            np.testing.assert_allclose(alone.mean_grad[0], together.mean_grad[row], rtol=0, atol=1e-12)

    def test_reference_state_is_exact(self, fitted: Surrogate, data: TrainingSet) -> None:
        at_rest = fitted.predict(MacroState.zeros(1))
        known = dict(provided(data.reference))
        for name, slopes in provided(at_rest):
            np.testing.assert_allclose(
                getattr(at_rest, name), getattr(data.reference, name), rtol=0, atol=1e-12, err_msg=name
            )
            for slope, expected in zip(slopes, known[name], strict=True):
                np.testing.assert_allclose(slope, expected, rtol=0, atol=1e-11, err_msg=name)

    def test_training_is_seeded(self, fitted: Surrogate, data: TrainingSet, unseen: TrainingSet) -> None:
        before = _global_random_state()
        again = self.make_surrogate().fit(data, seed=self.seed)
        other = self.make_surrogate().fit(data, seed=self.seed + 1)
        assert before == _global_random_state(), "the training drew from a global random number generator"
        assert_identical(fitted.predict(unseen.states), again.predict(unseen.states))
        one, two = fitted.predict(unseen.states), other.predict(unseen.states)
        if not self.random:
            assert_identical(one, two)
            return
        learned = "mean_grad" if one.potential is None else "potential"
        assert (getattr(one, learned) != getattr(two, learned)).any()

    def test_saved_and_loaded_it_is_the_same(
        self, fitted: Surrogate, saved: Path, data: TrainingSet, unseen: TrainingSet
    ) -> None:
        loaded = type(fitted).load(saved)
        assert_identical(fitted.predict(unseen.states), loaded.predict(unseen.states))
        for surrogate in (fitted, loaded):
            assert surrogate.identity == data.identity
            assert surrogate.inputs == data.inputs
            assert surrogate.provenance == data.provenance
        assert [path.name for path in saved.parent.iterdir()] == [saved.name]

    @pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.7, 0.999])
    def test_a_truncated_file_is_refused(self, fitted: Surrogate, saved: Path, share: float) -> None:
        whole = saved.read_bytes()
        saved.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(DataError, match=saved.name):
            type(fitted).load(saved)

    def test_a_damaged_file_is_refused_or_harmless(
        self, fitted: Surrogate, saved: Path, unseen: TrainingSet
    ) -> None:
        """A byte may lie in a part of the file that means nothing; it must never change a number."""
        whole, refused = bytearray(saved.read_bytes()), 0
        places = np.random.default_rng(0).integers(len(whole), size=60)
        for place in places:
            damaged = whole.copy()
            damaged[place] ^= 0x55
            saved.write_bytes(damaged)
            try:
                loaded = type(fitted).load(saved)
            except DataError:
                refused += 1
            else:
                assert_identical(fitted.predict(unseen.states), loaded.predict(unseen.states))
        assert refused > len(places) / 3

    def test_a_foreign_file_is_refused(self, fitted: Surrogate, tmp_path: Path) -> None:
        text, other, missing = tmp_path / "notes.txt", tmp_path / "other.h5", tmp_path / "missing.h5"
        text.write_text("not a surrogate")
        with h5py.File(other, "w") as file:
            file["numbers"] = np.arange(3.0)
        for path in (text, other, missing):
            with pytest.raises(DataError, match=path.name):
                type(fitted).load(path)

    def test_reading_executes_nothing(self, fitted: Surrogate, tmp_path: Path) -> None:
        """A file whose unpickling would make a folder; written by hand, as pickle would."""
        made, path = tmp_path / "made", tmp_path / "surrogate.h5"
        path.write_bytes(b"cos\nmkdir\n(V" + str(made).encode() + b"\ntR.")
        with pytest.raises(DataError):
            type(fitted).load(path)
        assert not made.exists()

    def test_outside_is_flagged(self, fitted: Surrogate, data: TrainingSet) -> None:
        x = np.array([[-0.1, 0.1], [-0.2001, 0.1], [-0.1, 0.2401], [0.0, 0.0], [0.1, 0.3]])
        states = INPUTS.scatter(x)
        states.grad_u[3, 0, 1] = 0.01
        outside = fitted.predict(states, tangent=False).outside
        assert outside is not None
        assert outside.tolist() == [False, True, True, True, True]
        trained = fitted.predict(data.states, tangent=False).outside
        assert trained is not None
        assert not trained.any()

    @pytest.fixture
    def interrupted(
        self, data: TrainingSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> Iterator[tuple[Path, TrainingProgress]]:
        """The checkpoint of a training that was stopped, and its last report."""
        if not self.resumable:
            pytest.skip("this training is short and begins anew")
        path, last, count = tmp_path / "training.h5", TrainingProgress(0, 0, 0.0, 0.0), 0

        def stop(progress: TrainingProgress) -> None:
            nonlocal last, count
            last, count = progress, count + 1
            deadline = time.monotonic() + (0.5 if not path.exists() else 0.0)
            while time.monotonic() < deadline:
                time.sleep(0.05)
            if path.exists() and count >= 3:
                raise _Stop

        with monkeypatch.context() as patch:
            self.checkpoint_often(patch)
            with pytest.raises(_Stop):
                self.make_surrogate().fit(data, seed=self.seed, checkpoint=path, on_progress=stop)
            assert path.exists(), "no checkpoint was written before the training ended"
            yield path, last

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
        if self.resumable:
            pytest.skip("this training writes checkpoints")
        self.make_surrogate().fit(data, seed=self.seed, checkpoint=tmp_path / "training.h5")
        assert list(tmp_path.iterdir()) == []

    def test_invalid_options_are_refused(self) -> None:
        for options in self.invalid_options:
            key = next(iter(options))
            with pytest.raises(ConfigurationError, match=key):
                self.make_invalid(options)


class PotentialConformance(SurrogateConformance):
    """In addition, the laws of a surrogate whose stress and fluid volume derive from one potential.

    They hold for every state, whether or not the training came near it.
    """

    @pytest.fixture(scope="class")
    @classmethod
    def states(cls) -> MacroState:
        """Stretched, sheared and rotated, and the undeformed state."""
        random = np.random.default_rng(11)
        grad_u = random.uniform(-0.08, 0.08, (40, 3, 3))
        grad_u[0] = 0.0
        return MacroState(grad_u, random.uniform(-0.02, 0.2, 40) * (np.arange(40) > 0))

    def test_it_provides_a_potential(self, fitted: Surrogate, states: MacroState) -> None:
        response = fitted.predict(states)
        assert response.tangent is not None
        for name in RESPONSES:
            assert getattr(response, name) is not None, name
        assert dict(provided(response)).keys() == {"mean_grad", "stress", "fluid_volume"}

    def test_rest_is_free_of_energy_and_stress(self, fitted: Surrogate, data: TrainingSet) -> None:
        at_rest = fitted.predict(MacroState.zeros(1))
        assert abs(_there(at_rest.potential)[0]) < 1e-12
        assert np.abs(_there(at_rest.stress)).max() < 1e-12
        assert abs(_there(at_rest.fluid_volume)[0] - _there(data.reference.fluid_volume)[0]) < 1e-12

    def test_the_tangent_is_symmetric(self, fitted: Surrogate, states: MacroState) -> None:
        tangent = fitted.predict(states).tangent
        assert tangent is not None
        A = _there(tangent.stress_grad_u)
        assert np.abs(A - A.transpose(0, 3, 4, 1, 2)).max() < 1e-12

    def test_reciprocity(self, fitted: Surrogate, states: MacroState) -> None:
        """∂P_E/∂p = −∂φ/∂H."""
        tangent = fitted.predict(states).tangent
        assert tangent is not None
        assert np.abs(_there(tangent.stress_p) + _there(tangent.fluid_volume_grad_u)).max() < 1e-12

    def test_objectivity(self, fitted: Surrogate, states: MacroState) -> None:
        """W and φ do not feel a rotation; P_E and <∇u¹> turn with it."""
        R = _rotations(len(states), seed=3)
        turned = MacroState(R @ (np.eye(3) + states.grad_u) - np.eye(3), states.p)
        before, after = fitted.predict(states, tangent=False), fitted.predict(turned, tangent=False)
        for name in ("potential", "fluid_volume"):
            assert np.abs(getattr(after, name) - getattr(before, name)).max() < 1e-12, name
        for name in ("stress", "mean_grad"):
            assert np.abs(getattr(after, name) - R @ getattr(before, name)).max() < 1e-12, name

    @pytest.mark.parametrize("seed", [0, 1, 2])
    def test_a_closed_cycle_does_no_work(self, fitted: Surrogate, seed: int) -> None:
        """∮ P_E:dH − φ dp over a smooth loop; the trapezoidal rule converges exponentially there."""
        random = np.random.default_rng(seed)
        (H0, H1, H2), (p0, p1, p2) = random.uniform(-0.04, 0.04, (3, 3, 3)), random.uniform(-0.03, 0.03, 3)
        angle = 2 * np.pi * np.arange(400) / 400
        cos, sin = np.cos(angle), np.sin(angle)
        loop = MacroState(
            H0 + cos[:, None, None] * H1 + sin[:, None, None] * H2, 0.08 + p0 + cos * p1 + sin * p2
        )
        response = fitted.predict(loop, tangent=False)
        dH, dp = cos[:, None, None] * H2 - sin[:, None, None] * H1, cos * p2 - sin * p1
        power = np.einsum("nij,nij->n", _there(response.stress), dH) - _there(response.fluid_volume) * dp
        assert np.abs(power).mean() > 1e-6, "nothing happens in this loop"
        assert abs(power.sum() * 2 * np.pi / len(angle)) < 1e-10


def _there(array: Array | None) -> Array:
    assert array is not None
    return array


def _rotations(n: int, seed: int) -> Array:
    """Random rotations (n, 3, 3), by any angle."""
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(n, 3, 3)))
    rotations: Array = Q * np.linalg.det(Q)[:, None, None]
    return rotations


def _global_random_state() -> tuple[Any, ...]:
    name, keys, *place = np.random.get_state()  # noqa: NPY002
    return random.getstate(), name, np.asarray(keys).tobytes(), place
