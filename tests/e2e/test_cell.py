"""One state of the cell as JSON."""

import json
import math

import numpy as np
import pytest

from tests.e2e.study import porocore, succeeded, write_study

SHAPES = {
    "porosity": (),
    "conductivity": (3, 3),
    "mean_grad": (3, 3),
    "stress": (3, 3),
    "fluid_volume": (),
    "potential": (),
}
TANGENT = {
    "mean_grad_grad_u": (3, 3, 3, 3),
    "mean_grad_p": (3, 3),
    "stress_grad_u": (3, 3, 3, 3),
    "stress_p": (3, 3),
    "fluid_volume_grad_u": (3, 3),
    "fluid_volume_p": (),
}


def cell(study, grad_u, *words):
    rows = "; ".join(" ".join(map(repr, row)) for row in grad_u)
    done = porocore("cell", study, "--grad-u", rows, *words, "--json")
    assert done.stderr == ""
    text = succeeded(done)
    assert len(text.splitlines()) == 1
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


def compression(strain):
    return [[0, 0, 0], [0, strain, 0], [0, 0, 0]]


def test_a_state_on_the_eighth_with_negative_pressure(study):
    found = cell(study, compression(-0.05), "--p", "-0.02")
    assert set(found) == {*SHAPES, "cell", "tangent", "status", "peaks", "seconds"}
    assert found["status"] == "converged"
    assert set(found["tangent"]) == set(TANGENT)
    for shapes, values in ((SHAPES, found), (TANGENT, found["tangent"])):
        for name, shape in shapes.items():
            value = np.array(values[name], dtype=float)
            assert value.shape == shape, name
            assert np.isfinite(value).all(), name
    radius = 0.25
    assert found["porosity"] == pytest.approx(3 * math.pi * radius**2 - 8 * 2**0.5 * radius**3, rel=1e-3)
    conductivity = np.array(found["conductivity"])
    assert (np.linalg.eigvalsh(conductivity) > 0).all()
    np.testing.assert_allclose(conductivity, conductivity.T, atol=1e-12 * conductivity.max())
    # ∂P_E/∂p = −∂φ/∂H, and ∂P_E/∂H has major symmetry: both come from one potential.
    tangent = {name: np.array(value) for name, value in found["tangent"].items()}
    np.testing.assert_allclose(tangent["stress_p"], -tangent["fluid_volume_grad_u"], atol=1e-9)
    np.testing.assert_allclose(
        tangent["stress_grad_u"], np.transpose(tangent["stress_grad_u"], (2, 3, 0, 1)), atol=1e-9
    )
    assert found["fluid_volume"] < found["porosity"]


@pytest.fixture
def linear(tmp_path):
    """The study on linear elements, of which the whole cell takes a moment."""
    return write_study(tmp_path / "linear.yaml", {"cell.mesh.element": "linear"})


def test_a_sheared_state_is_solved_on_the_whole_cell(linear):
    found = cell(linear, [[0, 0.03, 0], [0, 0, 0], [0, 0, 0]])
    assert found["status"] == "converged"
    assert found["peaks"]["min_gap"] is None  # there are no mirror planes
    stress, F = np.array(found["stress"]), np.eye(3) + 0.03 * np.eye(3)[:, [2, 0, 1]] * [0, 1, 0]
    assert F[0, 1] == 0.03
    assert stress[0, 1] > 1e-3
    # The moments balance: P Fᵀ is symmetric.
    np.testing.assert_allclose(stress @ F.T, (stress @ F.T).T, atol=1e-9)


def test_a_state_in_contact_has_values(study):
    found = cell(study, compression(-0.3))
    assert found["status"] == "contact"
    assert 0 < found["peaks"]["contact_share"] < 0.5
    assert found["peaks"]["min_gap"] < 0
    assert found["stress"][1][1] < -0.15
    tangent = {name: np.array(value) for name, value in found["tangent"].items()}
    np.testing.assert_allclose(tangent["stress_p"], -tangent["fluid_volume_grad_u"], atol=1e-8)


def test_a_state_without_solution_is_an_answer(study):
    """Under p = −1 there is no equilibrium: hydrostatic tension of the solid peaks at 0.45 E."""
    found = cell(study, compression(0.0), "--p", "-1")
    assert found["status"] in ("not_converged", "inverted")
    for shapes, values in ((SHAPES, found), (TANGENT, found["tangent"])):
        for name, shape in shapes.items():
            value = np.array(values[name], dtype=float)  # null becomes NaN
            assert value.shape == shape, name
            assert np.isnan(value).all() == (name not in ("porosity", "conductivity")), name
