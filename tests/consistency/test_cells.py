"""Cell solvers against each other on one mesh: averages, derivatives, conductivity, statuses, identities."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.contact.wall_contact import ContactSettings
from porocore.cell.meshing.mesh import MeshSettings
from porocore.commands.crosscheck.bodies import AVERAGES, DERIVATIVES, compare_responses, relative
from porocore.commands.crosscheck.comparison import CELL, STATES
from porocore.states import MacroState, Status

ELEMENTS = ("linear", "quadratic-straight", "quadratic-curved")
#: Diagonal and sheared; what is sheared is solved on the whole cell in any case.
*DIAGONAL, SHEARED = STATES
CASES = [
    *((element, "auto") for element in ELEMENTS),
    ("linear", "none"),
    *(pytest.param(element, "none", marks=pytest.mark.slow) for element in ELEMENTS[1:]),
]
#: H₂₂ and p from where every state is stable to where the pore wall has folded and to no state at all. Not within
#: 0.02 of where solutions end (H₂₂ = −0.25 at p = 0.05): there the last bit decides how a solve ends.
COMPRESSED = (
    (-0.18, 0.2),
    (-0.20, 0.0),
    (-0.22, 0.05),
    (-0.24, 0.1),
    (-0.28, 0.05),
    (-0.36, 0.0),
    (-0.40, 0.2),
    (-1.10, 0.0),
)


def cell(element, symmetry, contact="frictionless"):
    mesh = MeshSettings(size=0.35, fluid_size=0.25, element=element)
    return Cell(mesh=mesh, symmetry=symmetry, contact=ContactSettings(kind=contact))


@pytest.fixture(scope="module")
def prepared(load):
    """``prepared(backend, element, symmetry, contact)`` is a solver and the prepared cell, made once."""

    @cache
    def make(backend, element, symmetry, contact="frictionless"):
        solver = load("cell solver", backend)
        return solver, solver.prepare(cell(element, symmetry, contact))

    return make


@pytest.fixture(scope="module")
def solved(prepared):
    """``solved(backend, element, symmetry, state)``, solved once."""

    @cache
    def make(backend, element, symmetry, state):
        solver, ready = prepared(backend, element, symmetry)
        return solver.solve(ready, STATES[state]).response

    return make


@pytest.mark.parametrize(("element", "symmetry"), CASES)
def test_averages_and_derivatives_agree(cell_solver_pair, element, symmetry, solved):
    one, other = cell_solver_pair
    for state in DIAGONAL if symmetry == "auto" else STATES:
        a, b = (solved(backend, element, symmetry, state) for backend in cell_solver_pair)
        lines = compare_responses(state, one, a, other, b)
        assert {line.quantity for line in lines} == {"status", *AVERAGES.values(), *DERIVATIVES.values()}
        assert a.status[0] == Status.converged
        assert not [line.describe() for line in lines if not line.passed]


@pytest.mark.parametrize(("element", "symmetry"), CASES)
def test_conductivities_agree(cell_solver_pair, element, symmetry, prepared):
    found = []
    for backend in cell_solver_pair:
        solver, ready = prepared(backend, element, symmetry)
        found.append(solver.conductivity(ready))
    assert relative(*found, 0.0) < CELL
    assert np.linalg.eigvalsh(found[0]).min() > 0


@pytest.mark.parametrize(
    ("contact", "folded"),
    [pytest.param("none", "overlap", marks=pytest.mark.slow), ("frictionless", "contact")],
)
def test_statuses_agree_under_strong_compression(cell_solver_pair, prepared, contact, folded):
    H = np.zeros((len(COMPRESSED), 3, 3))
    H[:, 1, 1], p = np.array(COMPRESSED).T
    statuses, stresses = [], []
    for backend in cell_solver_pair:
        solver, ready = prepared(backend, "quadratic-curved", "auto", contact)
        response = solver.solve(ready, MacroState(H, p), tangent=False).response
        statuses.append([Status(s).name for s in response.status])
        assert (np.isfinite(response.stress).all(axis=(1, 2)) == response.valid).all()
        stresses.append(response.stress[response.valid])
    assert statuses[0] == statuses[1]
    assert statuses[0] == 4 * ["converged"] + 3 * [folded] + ["inverted"]
    assert relative(*stresses, 0.0) < CELL


@pytest.mark.parametrize("state", [*DIAGONAL, SHEARED])
def test_identities(cell_solver, state, solved):
    """Of every backend that is installed, whether it runs the conformance suite or not."""
    response = solved(cell_solver, "quadratic-curved", "none", state)
    tangent = response.tangent
    stiffness = tangent.stress_grad_u[0].reshape(9, 9)
    np.testing.assert_allclose(stiffness, stiffness.T, rtol=0, atol=1e-9 * np.abs(stiffness).max())
    np.testing.assert_allclose(tangent.stress_p, -tangent.fluid_volume_grad_u, rtol=0, atol=1e-9)
    if state == "at rest":
        M, Q = tangent.mean_grad_grad_u[0], tangent.mean_grad_p[0]
        nu = Cell().material.poisson_ratio
        expected = (1 - 2 * nu) * (M[1, 1, 1, 1] + 2 * M[1, 1, 0, 0])
        np.testing.assert_allclose(np.diag(Q), expected, rtol=1e-6)
        assert -1 / np.trace(Q) > 0
    # Moment balance: P Fᵀ is symmetric, since a rotation costs no energy.
    F = np.eye(3) + STATES[state].grad_u[0]
    kirchhoff = response.stress[0] @ F.T
    np.testing.assert_allclose(kirchhoff, kirchhoff.T, rtol=0, atol=1e-10)
