"""The laws that every surrogate obeys, as tests that a plugin author subclasses.

.. code-block:: python

    class TestMySurrogate(SurrogateSuite):
        kit_version = "2"

        @classmethod
        def make_surrogate(cls):
            return MySurrogate(epochs=500)

The cell that is learned is :mod:`porocore.testing.synthetic_cell`, known in closed form. A surrogate that derives
stress and fluid volume from a potential subclasses
:class:`porocore.testing.potential.PotentialSuite`.
"""

from __future__ import annotations

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.states import Array, CellResponse, MacroState
from porocore.testing.compare import RESPONSES, moved, provided
from porocore.testing.surrogate_files import Files
from porocore.testing.surrogate_training import Trainings
from porocore.testing.synthetic_cell import INPUTS, synthetic_training_set

__all__ = ["SurrogateSuite", "synthetic_training_set"]


class SurrogateSuite(Files, Trainings):
    """Subclass it, name the class ``Test…`` and give it ``make_surrogate``."""

    def test_shapes(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        """The batch axis leads, an empty batch included; each response comes with its slopes."""
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
        """Within ``accuracy`` of a cell that is known in closed form, on states that it has not seen."""
        predicted = fitted.predict(unseen.states, tangent=False)
        assert predicted.tangent is None
        for name in RESPONSES:
            values, truth = getattr(predicted, name), getattr(unseen.responses, name)
            if values is not None:
                if name == "stress":  # a potential over the inputs knows the stress that works on them
                    values, truth = values[:, 1, 1], truth[:, 1, 1]
                self._compare(name, values, truth, self.accuracy)

    def test_learns_the_slopes(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        """Within ``slope_accuracy``, on states that it has not seen."""
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

    def test_rows_do_not_depend_on_the_batch_or_its_order(
        self, fitted: Surrogate, unseen: TrainingSet
    ) -> None:
        states = unseen.states[:20]
        together = fitted.predict(states)
        backwards = fitted.predict(states[::-1])[::-1]
        _assert_rows(backwards, together)
        for row in range(20):
            _assert_rows(fitted.predict(states[row : row + 1]), together[row : row + 1])

    def test_derivatives_only_where_they_are_wanted(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        states = unseen.states[:20]
        plain, whole = fitted.predict(states, tangent=False), fitted.predict(states)
        assert plain.tangent is None
        for name in RESPONSES:
            if getattr(whole, name) is not None:
                np.testing.assert_allclose(
                    getattr(plain, name), getattr(whole, name), rtol=0, atol=1e-12, err_msg=name
                )

    def test_inputs_are_not_changed(self, fitted: Surrogate, data: TrainingSet, unseen: TrainingSet) -> None:
        """Neither the states that it predicts nor those that it was trained on."""
        states = unseen.states[:20]
        H, p = states.grad_u.copy(), states.p.copy()
        fitted.predict(states)
        np.testing.assert_array_equal(states.grad_u, H)
        np.testing.assert_array_equal(states.p, p)
        original = self.training_data()
        np.testing.assert_array_equal(data.states.grad_u, original.states.grad_u)
        np.testing.assert_array_equal(data.states.p, original.states.p)
        for name in RESPONSES:
            np.testing.assert_array_equal(getattr(data.responses, name), getattr(original.responses, name))

    def test_it_provides_what_it_says(self, fitted: Surrogate, unseen: TrainingSet) -> None:
        """``provides``, where a surrogate has it, lists the responses that are there, each with its derivatives."""
        response = fitted.predict(unseen.states[:3])
        there = {name for name in RESPONSES if getattr(response, name) is not None}
        says = getattr(fitted, "provides", None)
        assert says is None or set(says) & set(RESPONSES) == there
        with_slopes = dict(provided(response))
        for name in there & {"mean_grad", "stress", "fluid_volume"}:
            assert name in with_slopes or np.isnan(getattr(response, name)).all(), (
                f"{name} has no derivatives"
            )

    def test_reference_state_is_exact(self, fitted: Surrogate, data: TrainingSet) -> None:
        at_rest = fitted.predict(MacroState.zeros(1))
        known = dict(provided(data.reference))
        for name, slopes in provided(at_rest):
            np.testing.assert_allclose(
                getattr(at_rest, name), getattr(data.reference, name), rtol=0, atol=1e-12, err_msg=name
            )
            for slope, expected in zip(slopes, known[name], strict=True):
                np.testing.assert_allclose(slope, expected, rtol=0, atol=1e-11, err_msg=name)

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

    def test_invalid_options_are_refused(self) -> None:
        for options in self.invalid_options:
            key = next(iter(options))
            with pytest.raises(ConfigurationError, match=key):
                self.make_invalid(options)


def _assert_rows(found: CellResponse, expected: CellResponse) -> None:
    """Alike but for round-off, derivatives and flags included."""
    np.testing.assert_array_equal(found.status, expected.status)
    assert found.outside is not None
    assert expected.outside is not None
    np.testing.assert_array_equal(found.outside, expected.outside)
    for name in RESPONSES:
        if getattr(expected, name) is not None:
            np.testing.assert_allclose(
                getattr(found, name), getattr(expected, name), rtol=0, atol=1e-12, err_msg=name
            )
    others = dict(provided(found))
    for name, slopes in provided(expected):
        for one, other in zip(others[name], slopes, strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-10, err_msg=f"slope of {name}")
