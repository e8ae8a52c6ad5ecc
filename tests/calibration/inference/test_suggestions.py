"""Ranking of further data: what separates comes first, what repeats the same does not help."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.commands.calibration.infer import infer
from porocore.commands.calibration.problem import Misfit, Unknown
from porocore.commands.calibration.suggestions import FurtherData, ranked, repeated_parts
from porocore.errors import ConfigurationError
from tests.helpers.calibration_models import Formula, data_of, experiment, misfit_of

T = np.linspace(0.1, 2.0, 16)
PAIR = (Unknown("a", 2.0, 0.1, 50.0, "log"), Unknown("b", 3.0, 0.1, 50.0, "log"))


def test_another_test_separates_what_repetition_cannot():
    misfit = misfit_of(Formula(PAIR, lambda v: v[0] * v[1] * T), [2.0, 3.0], 0.02)
    best = misfit.at(misfit.start)
    same = Formula(PAIR, lambda v: v[0] * v[1] * T**2)
    other = Formula(PAIR, lambda v: v[0] * T)
    further = [
        experiment("the same again", same, best.coordinates, np.full(16, 0.001)),
        experiment("a alone", other, best.coordinates, np.full(16, 0.02)),
    ]
    found = infer(misfit, best, rays=0, further=further).suggestions
    assert found[0].name == "a alone"
    assert (found[0].non_identifiable_before, found[0].non_identifiable) == (1, 0)
    assert found[0].gain == np.inf
    assert [each.name for each in found if each.helps] == ["a alone"]
    # The rows by hand: d(a t)/d ln a = a t.
    np.testing.assert_allclose(further[1].rows, np.stack([2 * T, 0 * T], axis=1) / 0.02, rtol=1e-12)


def test_the_part_of_a_curve_that_sees_comes_first():
    # The second unknown is seen in the last quarter alone.
    model = Formula(PAIR, lambda v: np.where(T > 1.5, v[1] * 0.01 * T, v[0]))
    misfit = Misfit(model, data_of(np.zeros(16), 0.1, times=T, names=("settlement",)))
    best = misfit.at(misfit.start)
    found = ranked(best.jacobian, np.full(2, 0.1), list(repeated_parts(misfit, best)))
    assert found[0].name == "10 times as many values of settlement from 1.62 to 2"
    assert found[0].gain == pytest.approx(np.sqrt(10))
    assert not any(each.helps for each in found[1:])
    timed = Misfit(model, replace(misfit.data, time_units=("min",)))
    assert next(iter(repeated_parts(timed, best))).name.endswith("of settlement from 0.1 to 0.48 min")


def test_with_two_unseen_directions_the_better_of_two_partial_helps_is_first():
    rows = np.array([[10.0, 0.0, 0.0]])
    weak, strong = (
        FurtherData("weak", np.array([[0, 2.0, 0]])),
        FurtherData("strong", np.array([[0, 0, 5.0]])),
    )
    found = ranked(rows, np.ones(3), [weak, strong])
    assert [each.name for each in found] == ["strong", "weak"]
    # One direction stays unseen, but one fewer.
    assert found[0].gain == 1.0
    assert found[0].helps


def test_a_gain_that_leaves_a_direction_unseen_does_not_separate():
    rows = np.array([[10.0, 0.0], [0.0, 0.01]])
    (found,) = ranked(rows, np.ones(2), [FurtherData("twice", np.sqrt(3) * rows)])
    assert found.gain == pytest.approx(2)
    assert found.helps
    assert not found.separates


def test_curves_that_no_unknown_changes_are_refused_before_anything_is_divided_by_their_slopes():
    misfit = misfit_of(Formula(PAIR, lambda v: T + 0 * v[0]), [2.0, 3.0], 0.02)
    with pytest.raises(
        ConfigurationError, match=r"expected a curve that a and b can change, but .* would be the same"
    ):
        infer(misfit, misfit.at(misfit.start), rays=0)


def test_a_curve_that_no_unknown_changes_is_named_beside_one_that_sees():
    model = Formula(PAIR, lambda v: np.concatenate([v[0] * v[1] * T, T]))
    data = replace(
        data_of(np.zeros(32), 0.1, times=T, names=("force", "settlement")), curve=np.repeat([0, 1], 16)
    )
    misfit = Misfit(model, data)
    assert misfit.unmoved(misfit.at(misfit.start)) == ["settlement"]
