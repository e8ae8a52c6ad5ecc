"""Flags of a learned conductivity: they follow its error, and the hull of its states does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from porocore.core.inputs import InputSpace
from porocore.core.tensors import CUBIC, TRIVIAL, logarithm
from porocore.states import Doubt, MacroState
from porocore.surrogates.conductivity import fit_conductivity
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.surrogates.portable import CLOSED, NumpySurrogate
from porocore.testing.synthetic.potential_cell import potential_training_set
from tests.helpers.flag_studies import FOUR, SEVEN, assert_follows, held_out
from tests.helpers.made_up_conductivity import conductivity, with_conductivity

#: Inputs, training states, tolerance, what is known of the symmetry: some tenths of the held-out states are beyond it.
STUDIES = {"four": (FOUR, 12, 5e-3, CUBIC), "seven": (SEVEN, 60, 3e-2, TRIVIAL)}


def training(study):
    inputs, n, tolerance, symmetry = STUDIES[study]
    data = with_conductivity(potential_training_set(n, seed=1, inputs=inputs))
    return replace(data, symmetry=symmetry, tolerance=tolerance)


def beyond(data, model, states):
    """Largest error of ln K_ref of each state, as a share of the range."""
    known = logarithm(data.responses.conductivity).reshape(len(data.states), -1)
    wrong = logarithm(model.predict(states, tangent=False)[0]) - logarithm(conductivity(states))
    return np.abs(wrong).reshape(len(states), -1).max(axis=1) / np.ptp(known, axis=0).max()


@pytest.fixture(scope="module", params=STUDIES)
def study(request):
    data = training(request.param)
    return data, fit_conductivity(data)[0]


def test_flags_follow_the_error(study):
    data, model = study
    states = held_out(data.inputs)
    assert_follows(model.doubt(states) != 0, beyond(data, model, states), data.tolerance)


def test_the_hull_does_not(study):
    """What was flagged before."""
    data, model = study
    states = held_out(data.inputs)
    flagged = replace(model, estimate=None).doubt(states) != 0
    assert (flagged == model.sampled.outside(states)).all()
    with pytest.raises(AssertionError):
        assert_follows(flagged, beyond(data, model, states), data.tolerance)


def test_in_the_safe_box_no_estimate_is_near_the_tolerance(study):
    data, model = study
    none = np.full_like(model.estimate.safe, np.nan)
    everywhere = replace(model, estimate=replace(model.estimate, safe=none))
    states = held_out(data.inputs)
    assert ((everywhere.doubt(states) != 0) == (model.doubt(states) != 0)).all()


def test_far_states_are_flagged_whatever_is_estimated(study):
    data, _ = study
    model = fit_conductivity(replace(data, tolerance=1.0))[0]
    low, high = np.array(data.inputs.lower), np.array(data.inputs.upper)
    assert not (model.doubt(data.inputs.scatter([low, high])) != 0).any()
    far = data.inputs.scatter([low - 0.3 * (high - low), high + 0.3 * (high - low)])
    assert (model.doubt(far) != 0).all()
    inside_out = MacroState(np.array([np.diag([0.0, -1.2, 0.0])]), np.zeros(1))
    assert (model.doubt(inside_out) != 0).all()


def test_a_rotation_is_no_reason(study):
    """Neither by the estimate nor by the hull: K_ref depends on the stretch."""
    data, model = study
    states = held_out(data.inputs, 50)
    R = Rotation.from_rotvec([0.4, -0.3, 0.8]).as_matrix()
    turned = MacroState(R @ (np.eye(3) + states.grad_u) - np.eye(3), states.p)
    for one in (model, replace(model, estimate=None)):
        flagged = one.doubt(states) != 0
        assert 0 < flagged.sum() < len(states) or one.estimate is None
        assert ((one.doubt(turned) != 0) == flagged).all()


def test_a_component_that_was_not_sampled_is_flagged():
    model = fit_conductivity(training("four"))[0]
    H = np.zeros((2, 3, 3))
    H[1, 0, 1] = 0.01
    assert (model.doubt(MacroState(H, np.full(2, 0.1))) != 0).tolist() == [False, True]


def test_beyond_the_hull_of_pores_that_close_all_is_flagged():
    """Walls touch beyond H₂₂ = −0.05: what follows from the others, however smooth, does not hold there."""
    inputs = InputSpace.from_ranges({"H11": (-0.15, 0.1), "H22": (-0.15, 0.1), "p": (0.0, 0.2)})
    data = replace(with_conductivity(potential_training_set(40, seed=1, inputs=inputs)), tolerance=0.2)
    touching = data.states.grad_u[:, 1, 1] < -0.05
    K = data.responses.conductivity.copy()
    K[touching] = np.nan
    closing = replace(data, responses=replace(data.responses, conductivity=K))
    states = held_out(inputs)[:400]
    H22 = states.grad_u[:, 1, 1]
    flagged = fit_conductivity(closing)[0].doubt(states) != 0
    assert flagged[H22 < -0.08].all()
    assert flagged[H22 > -0.04].mean() < 0.5
    assert not (fit_conductivity(data)[0].doubt(states) != 0)[H22 < -0.08].all()
    surrogate = PolynomialSurrogate().fit(closing, seed=0)
    near = surrogate.conductivity.doubt(states) == Doubt.closed
    assert near[H22 < -0.08].all()
    assert not near[H22 > -0.04].all()
    assert [said.endswith(CLOSED) for said in surrogate.reasons(states)] == near.tolist()


def test_a_surrogate_flags_by_it_and_its_file_carries_it(tmp_path):
    data = training("four")
    surrogate, states = PolynomialSurrogate().fit(data, seed=0), held_out(data.inputs)
    flagged = surrogate.predict(states, tangent=False).flagged
    own = surrogate.conductivity.doubt(states) != 0
    assert (flagged == own | replace(surrogate.fitted).predict(states, tangent=False).flagged).all()
    assert 0 < own.mean() < 1
    surrogate.save(tmp_path / "surrogate.h5")
    read = NumpySurrogate.load(tmp_path / "surrogate.h5")
    assert ((read.conductivity.doubt(states) != 0) == own).all()
    assert (read.predict(states, tangent=False).flagged == flagged).all()
    assert read.reasons(states[:5]) == surrogate.reasons(states[:5])


def test_the_reason_names_the_larger_of_the_errors():
    data = training("four")
    surrogate = PolynomialSurrogate().fit(data, seed=0)
    states = held_out(data.inputs)
    worst = states[[int(np.argmax(surrogate.conductivity.error(states)))]]
    error = surrogate.conductivity.error(worst)[0]
    assert error > surrogate.fitted.error(worst)[0]
    (said,) = surrogate.reasons(worst)
    assert f"the estimated error is {100 * error:.2g} % of the range of the conductivity" in said


def test_where_the_conductivity_alone_is_at_fault_stress_is_called_good():
    """By errors of the conductivity, "the surrogate is not reliable" in a body whose force was right to 0.05 %."""
    data = training("four")
    surrogate = PolynomialSurrogate().fit(data, seed=0)
    states = held_out(data.inputs)
    model, tolerance = surrogate.fitted, surrogate.conductivity.estimate.tolerance
    bad = surrogate.conductivity.error(states) > tolerance
    good = ~model.predict(states, tangent=False).flagged
    assert (bad & good).any()
    assert all("forces and displacements in equilibrium" in s for s in surrogate.reasons(states[bad & good]))
    assert not any("can be relied on" in said for said in surrogate.reasons(states[~good | ~bad]))
