"""Flags by the estimated error of a surrogate: they follow the error itself, and say which component drives it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from porocore.core.inputs import SampledRange
from porocore.core.tensors import TRIVIAL
from porocore.interfaces.solution import MacroSolution
from porocore.macro.body.kinds import Box
from porocore.states import MacroState
from porocore.study.notes.reach import flagged_place
from porocore.surrogates.error_estimate.fit import with_mean_gradient_error
from porocore.surrogates.mean_gradient import AnchoredModel, ScaledData
from porocore.surrogates.network.network import Network
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.surrogates.portable import NumpySurrogate
from porocore.testing.synthetic.potential_cell import potential_training_set, respond
from tests.helpers.flag_studies import FOUR, SEVEN, assert_follows, held_out

#: Inputs, training states, tolerance: some tenths of the held-out states are beyond it.
STUDIES = {"four": (FOUR, 16, 5e-3), "seven": (SEVEN, 24, 2e-2)}


def training(study):
    """Of a cell of whose symmetry nothing is known."""
    inputs, n, tolerance = STUDIES[study]
    return replace(potential_training_set(n, seed=1, inputs=inputs), symmetry=TRIVIAL, tolerance=tolerance)


def share_of_range(predicted, exact, data, *names):
    """Largest error of each state."""
    worst = np.zeros(len(exact))
    for name in names:
        known = getattr(data.responses, name).reshape(len(data.states), -1)
        wrong = (getattr(predicted, name) - getattr(exact, name)).reshape(len(exact), -1)
        worst = np.maximum(worst, np.abs(wrong).max(axis=1) / np.ptp(known, axis=0).max())
    return worst


@pytest.fixture(scope="module", params=STUDIES)
def study(request):
    data = training(request.param)
    return data, PolynomialSurrogate().fit(data, seed=0)


def test_flags_follow_the_error_of_a_potential(study):
    data, surrogate = study
    states = held_out(data.inputs)
    predicted = surrogate.predict(states, tangent=False)
    error = share_of_range(predicted, respond(states), data, "stress", "fluid_volume")
    assert_follows(predicted.flagged, error, data.tolerance)


def test_the_hull_does_not(study):
    """What was flagged before: without a tolerance."""
    data, _ = study
    states, inputs = held_out(data.inputs), data.inputs
    surrogate = PolynomialSurrogate().fit(replace(data, tolerance=None), seed=0)
    predicted = surrogate.predict(states, tangent=False)
    assert (
        predicted.flagged == SampledRange.around(inputs, inputs.gather(data.states)).outside(states)
    ).all()
    error = share_of_range(predicted, respond(states), data, "stress", "fluid_volume")
    with pytest.raises(AssertionError):
        assert_follows(predicted.flagged, error, data.tolerance)


@pytest.mark.parametrize("study", STUDIES)
def test_flags_follow_the_error_of_a_network(study):
    """One that knows little: the first weights of a network, small, with the exact linear limit."""
    data = replace(training(study), tolerance=0.05)
    scaled, random = ScaledData.from_training_set(data), np.random.default_rng(0)
    o, d = len(scaled.components), len(data.inputs)
    network = Network(
        "tanh",
        (0.3 * random.standard_normal((8, d)), 0.3 * random.standard_normal((o, 8))),
        (np.zeros(8), np.zeros(o)),
    )
    sampled = SampledRange.around(data.inputs, data.inputs.gather(data.states))
    model = AnchoredModel(scaled.linear, scaled.components, scaled.output_scale, network, sampled)
    states = held_out(data.inputs)
    predicted = with_mean_gradient_error(model, data).predict(states, tangent=False)
    assert_follows(predicted.flagged, share_of_range(predicted, respond(states), data, "mean_grad"), 0.05)


def test_in_the_safe_box_no_estimate_is_near_the_tolerance(study):
    data, surrogate = study
    model = replace(surrogate.fitted)
    states = held_out(data.inputs)
    asked = replace(model, estimate=replace(model.estimate, safe=np.zeros((2, 7))))
    flagged = surrogate.predict(states, tangent=False).flagged
    assert (flagged == asked.predict(states, tangent=False).flagged).all()


def test_far_states_are_flagged_whatever_is_estimated(study):
    data, _ = study
    surrogate = PolynomialSurrogate().fit(replace(data, tolerance=1.0), seed=0)
    inputs = data.inputs
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    within = surrogate.predict(inputs.scatter([low, high]), tangent=False)
    assert not within.flagged.any()
    beyond = inputs.scatter([low - 0.3 * (high - low), high + 0.3 * (high - low)])
    assert surrogate.predict(beyond, tangent=False).flagged.all()
    turned_inside_out = MacroState(np.array([np.diag([0.0, -1.2, 0.0])]), np.zeros(1))
    assert surrogate.predict(turned_inside_out, tangent=False).flagged.all()


def test_the_file_carries_it(study, tmp_path):
    data, surrogate = study
    surrogate.save(tmp_path / "surrogate.h5")
    read, states = NumpySurrogate.load(tmp_path / "surrogate.h5"), held_out(data.inputs)
    flagged = surrogate.predict(states, tangent=False).flagged
    assert 0 < flagged.mean() < 1
    assert (read.predict(states, tangent=False).flagged == flagged).all()
    assert read.reasons(states[:5]) == surrogate.reasons(states[:5])


def test_reasons_name_the_component():
    surrogate = PolynomialSurrogate().fit(training("seven"), seed=0)
    H = np.zeros((3, 3, 3))
    H[0, 2, 1], H[1, 1, 1], H[2, 0, 1] = 0.05, -0.2, 0.1
    H[2, 1, 1] = 0.01
    said = surrogate.reasons(MacroState(H[1:], np.array([0.05, 0.05])))
    assert said[0].startswith("H22 = −0.2, beyond [−0.1, 0.1], where the estimated error is ")
    assert said[1].startswith("H12 = 0.1 in [−0.1, 0.1], where the estimated error is ")
    four = PolynomialSurrogate().fit(training("four"), seed=0)
    sheared = MacroState(H[2:], np.array([0.05]))
    assert four.reasons(sheared) == ["H12 = 0.1, which was not sampled"]


class Profile:
    """Two elements, of which the upper one has the gradient H."""

    def __init__(self, time, outside, H):
        self.time, self.flagged = time, np.array(outside)
        self.grad_u = np.stack([np.zeros((3, 3)), H])
        self.element_p = self.cell_p = np.full(2, 0.1)
        self.u = np.maximum(Solution.points - [0, 2, 0], 0) @ np.transpose(H)
        self.p = np.full(len(self.u), 0.1)


class Solution:
    body = Box(size=(1, 4, 1), elements=(1, 2, 1)).make()
    points, cells, element_cells = body.points, body.cells, None
    revolved, depth = False, 1.0
    cell_states, seen_by_cells = MacroSolution.cell_states, MacroSolution.seen_by_cells
    _of_cells = MacroSolution._of_cells

    def __init__(self, *profiles):
        self.profiles = profiles


def pressed(H22):
    return np.diag([0, H22, 0])


def test_the_flagged_place_in_the_body_is_named():
    surrogate = PolynomialSurrogate().fit(training("four"), seed=0)
    early, late = Profile(1.0, [0.0, 0.5], pressed(-0.16)), Profile(2.0, [0.0, 1.0], pressed(-0.2))
    said = flagged_place(Solution(early, late, Profile(3.0, [0.25, 0.0], pressed(0))), surrogate)
    assert said == (
        "Beyond what was sampled: H22 = −0.2 at (0.5, 3, 0.5) at t = 2 (sampled in [−0.15, 0.1]). "
        "Write under 'sampling.inputs:' H22: {range: [-0.23, 0.1]}."
    )
    within = Solution(Profile(1.0, [0.0, 0.5], pressed(-0.14)))
    said = flagged_place(within, surrogate)
    assert said.startswith(
        "An example is the element at (0.5, 3, 0.5) at t = 1: H22 = −0.14 in [−0.15, 0.1], where"
    )
    assert said.endswith("raise sampling.options.count.")
    assert flagged_place(Solution(Profile(1.0, [0.0, 0.0], pressed(0))), surrogate) == ""
    assert flagged_place(Solution(), surrogate) == ""


def test_the_flagged_place_has_a_component_that_was_not_sampled():
    surrogate = PolynomialSurrogate().fit(training("four"), seed=0)
    turn = np.array([[np.cos(0.3) - 1, -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3) - 1, 0], [0, 0, 0]])
    turned, both = Profile(1.0, [0.0, 1.0], turn), Profile(2.0, [0.0, 1.0], pressed(-0.2))
    turned.u = Solution.points @ turn.T
    both.u[:, 1] += 0.016 * Solution.points[:, 2]
    said = flagged_place(Solution(both), surrogate)
    assert said.startswith(
        "Beyond what was sampled: H23 = 0.016 at (0.5, 3, 0.5) at t = 2 (not sampled); H22 = −0.2"
    )
    assert said.endswith(" H23: {range: [0, 0.018]}, H22: {range: [-0.23, 0.1]}.")
    assert "H21 = 0.296" in flagged_place(Solution(turned), surrogate)
    # A law that does not change when the body turns has nothing against it.
    assert "Beyond" not in flagged_place(Solution(turned), surrogate, objective=True)


def test_the_flagged_place_is_looked_for_at_the_points_of_an_element(column):
    """Its mean lies within all ranges: at the edge of an indenter the state changes within one element."""
    surrogate = PolynomialSurrogate().fit(training("four"), seed=0)
    solution = column(elements=(1, 1, 1))
    last = solution.profiles[-1]
    height = solution.points[:, 1].max()
    u = np.zeros_like(last.u)
    u[:, 1] = -0.13 * solution.points[:, 1] ** 2 / height
    # H22 = −0.26 y/h: −0.13 on average, and at the highest point (0.5 + √0.15) of that −0.231.
    H = np.zeros((1, 3, 3))
    H[:, 1, 1] = -0.13
    p = np.full(len(u), 0.1)
    bent = replace(last, u=u, p=p, grad_u=H, element_p=p[:1], cell_p=p[:1], flagged=np.array([1 / 3]))
    said = flagged_place(replace(solution, profiles=(bent,)), surrogate)
    assert said.startswith("Beyond what was sampled: H22 = −0.231 at ")
    assert said.endswith("H22: {range: [-0.27, 0.1]}.")
