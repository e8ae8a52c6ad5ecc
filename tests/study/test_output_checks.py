"""The table of a surrogate's errors: components that are zero but for the mesh are not judged."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.study.notes.parameters import output_checks
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate
from porocore.testing.synthetic.potential_cell import potential_training_set

INPUTS = InputSpace.from_ranges({"H22": (-0.1, 0.1), "p": (0.0, 0.1)})


def solved(n, seed, noise):
    """States without shear, whose shear stress is the error of a mesh, as a share of the largest stress."""
    data = potential_training_set(n, seed=seed, inputs=INPUTS)
    stress = data.responses.stress.copy()
    wrong = np.random.default_rng(seed).uniform(-0.5, 0.5, n)
    stress[:, 0, 1] = noise * np.ptp(stress[:, 1, 1]) * wrong
    return replace(data, responses=replace(data.responses, stress=stress))


def as_dataset(data):
    return SimpleNamespace(
        inputs=data.inputs,
        x=lambda: data.inputs.gather(data.states),
        states=lambda: data.states,
        responses=lambda: data.responses,
    )


@pytest.mark.parametrize(("noise", "judged"), [(5e-4, False), (1e-2, False), (0.2, True)])
def test_a_component_that_is_zero_but_for_the_mesh_is_not_judged(noise, judged):
    data = solved(24, 1, noise)
    surrogate = PolynomialSurrogate().fit(potential_training_set(24, seed=1, inputs=INPUTS), seed=0)
    checks = output_checks(as_dataset(data), as_dataset(solved(8, 2, noise)), surrogate)
    names = [check.plain for check in checks]
    assert "P_E,22" in names
    assert ("P_E,12" in names) == judged


def test_the_range_in_the_body_is_that_of_its_states():
    data = potential_training_set(24, seed=1, inputs=INPUTS)
    surrogate = PolynomialSurrogate().fit(data, seed=0)
    body = INPUTS.scatter([[0.0, 0.0], [-0.02, 0.01], [-0.01, 0.0]])
    checks = output_checks(
        as_dataset(data), as_dataset(potential_training_set(8, seed=2, inputs=INPUTS)), surrogate, body
    )
    expected = surrogate.predict(body, tangent=False)
    (stress,) = [check for check in checks if check.plain == "P_E,22"]
    assert stress.in_body == (expected.stress[:, 1, 1].min(), expected.stress[:, 1, 1].max())
    assert 0 < stress.span_in_body < 0.5 * stress.span
