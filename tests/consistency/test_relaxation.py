"""Cells whose solid relaxes, on every backend that follows them: limits, closed forms, symmetry, statuses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from porocore.cell.cell import Cell
from porocore.cell.geometry.drawn import NoPores
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.materials.prony import Relaxation
from porocore.cell.materials.relaxing import RelaxingSolid, second_stress
from porocore.cell.meshing.mesh import MeshSettings
from porocore.errors import ConfigurationError
from porocore.states import MacroState, Status


def series(strengths, times):
    """Prony series of these branches."""
    return Relaxation(branches=[{"strength": s, "time": t} for s, t in zip(strengths, times, strict=True)])


COARSE = MeshSettings(size=0.4, fluid_size=0.4, element="linear")
SHEAR = np.array([[0.01, 0.08, 0.0], [0.0, -0.06, 0.0], [0.0, 0.0, 0.02]])
DIAGONAL = np.diag([0.02, -0.12, 0.0])
TIMES = np.array([0.0, 0.2, 0.2, 0.5, 2.0])
TWO_BRANCHES = [(1.0, 0.3), (0.5, 4.0)]
TWO = series(*zip(*TWO_BRANCHES, strict=True))


def path(H, p):
    """From rest to a half, at once to all, then held, and half way back."""
    f = np.array([0.0, 0.5, 1.0, 1.0, 0.5])
    return MacroState(f[:, None, None] * H, f * p)


@pytest.fixture(scope="module")
def cells(load):
    """``cells(backend, **cell)`` is a solver and a coarse cell."""
    kept = {}

    def prepared(backend, **cell):
        key = backend, repr(cell)
        if key not in kept:
            solver = load("cell solver", backend)
            kept[key] = solver, solver.prepare(Cell(**{"mesh": COARSE} | cell))
        solver, ready = kept[key]
        if not solver.relaxes:
            pytest.skip(f"{backend} follows no cell whose solid relaxes")
        return solver, ready

    return prepared


@pytest.mark.parametrize("H", [DIAGONAL, pytest.param(SHEAR, marks=pytest.mark.slow)])
def test_a_branch_of_strength_0_changes_nothing_to_the_last_bit(cell_solver, cells, H):
    solver, cell = cells(cell_solver)
    states = path(H, 0.05)
    # A path that is sheared anywhere is followed on the whole cell from its beginning.
    states, times = states[1:], TIMES[1:]
    one = solver.relax(cell, states, times, series([0.7], [0.4]), fields=True)
    with_nothing = solver.relax(cell, states, times, series([0.0, 0.7], [0.1, 0.4]), fields=True)
    elastic = solver.relax(cell, states, times, series([0.0], [0.4]), fields=True)
    start = None
    for k in range(len(states)):
        alone = solver.solve(cell, states[k : k + 1], start=[start], tangent=False, fields=True)
        start = alone.fields[0]
        for name in ("stress", "fluid_volume", "mean_grad", "status"):
            assert np.array_equal(getattr(elastic.response, name)[k], getattr(alone.response, name)[0]), name
            assert np.array_equal(getattr(with_nothing.response, name)[k], getattr(one.response, name)[k]), (
                name
            )
    assert np.abs(one.response.stress[-1] - elastic.response.stress[-1]).max() > 1e-3


@pytest.mark.parametrize("H", [DIAGONAL, pytest.param(SHEAR, marks=pytest.mark.slow)])
@pytest.mark.parametrize(("time", "stiffer"), [(1e-14, 1.0), (1e14, 2.5)])
def test_fast_and_slow_limits_are_elastic(cell_solver, cells, H, time, stiffer):
    """W_a(H, p) = a W(H, p/a) of a solid whose stiffness is a times as large."""
    solver, cell = cells(cell_solver)
    states, times = path(H, 0.05), np.array([0.0, 0.2, 0.3, 0.5, 2.0])
    found = solver.relax(cell, states, times, series([1.5], [time])).response
    elastic = solver.solve(cell, MacroState(states.grad_u, states.p / stiffer), tangent=False).response
    np.testing.assert_allclose(found.stress, stiffer * elastic.stress, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.fluid_volume, elastic.fluid_volume, rtol=0, atol=1e-10)


def test_a_sudden_change_meets_the_instantaneous_stiffness(cell_solver, cells):
    solver, cell = cells(cell_solver)
    states = MacroState(np.stack([np.zeros((3, 3)), DIAGONAL]), np.array([0.0, 0.05]))
    found = solver.relax(cell, states, np.array([1.0, 1.0]), TWO).response
    elastic = solver.solve_one(cell, DIAGONAL, 0.05 / 2.5)
    np.testing.assert_allclose(found.stress[1], 2.5 * elastic.stress[0], rtol=0, atol=1e-10)


def test_a_cell_without_pores_is_a_point_of_the_solid(cell_solver, cells):
    """A ramp of S_∞ in one step and a hold: the overstress is γ τ/Δt (1 − exp(−Δt/τ)) S_∞, and dies out."""
    solver, cell = cells(cell_solver, geometry=NoPores(kind="no-pores"))
    F, ramp, end = np.eye(3) + SHEAR, 0.2, 1.7
    states = MacroState(np.stack([np.zeros((3, 3)), SHEAR, SHEAR]), np.full(3, 0.1))
    found = solver.relax(cell, states, np.array([0.0, ramp, end]), TWO).response
    P = NeoHookean().stress(F)
    for k, age in ((1, 0.0), (2, end - ramp)):
        over = sum(g * tau / ramp * (1 - np.exp(-ramp / tau)) * np.exp(-age / tau) for g, tau in TWO_BRANCHES)
        np.testing.assert_allclose(found.stress[k], (1 + over) * P, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.fluid_volume, 0.0, atol=1e-12)


def test_small_strains_follow_the_relaxed_stiffness(cell_solver, cells):
    """C g(t) : H after a sudden drained strain, g = 1 + Σ γ exp(−t/τ); the fluid stays."""
    solver, cell = cells(cell_solver)
    C = solver.solve_one(cell, np.zeros((3, 3))).tangent.stress_grad_u[0]
    H, times = 1e-7 * np.diag([0.3, -1.0, 0.2]), np.array([0.0, 0.0, 0.1, 1.0, 5.0])
    states = MacroState(np.stack([np.zeros((3, 3)), H, H, H, H]), np.zeros(5))
    found = solver.relax(cell, states, times, TWO).response
    g = 1 + sum(s * np.exp(-times[1:] / tau) for s, tau in TWO_BRANCHES)
    wanted = g[:, None, None] * np.einsum("ijkl,kl->ij", C, H)
    np.testing.assert_allclose(found.stress[1:], wanted, rtol=0, atol=1e-6 * np.abs(wanted).max())
    changes = np.diff(found.fluid_volume)
    assert np.abs(changes[1:]).max() < 1e-6 * abs(changes[0])


def test_the_eighth_and_the_whole_cell_agree(cell_solver, cells):
    states = path(DIAGONAL, 0.05)
    eighth, whole = (
        solver.relax(cell, states, TIMES, TWO).response
        for solver, cell in (cells(cell_solver), cells(cell_solver, symmetry="none"))
    )
    np.testing.assert_allclose(eighth.stress, whole.stress, rtol=0, atol=1e-9)
    np.testing.assert_allclose(eighth.fluid_volume, whole.fluid_volume, rtol=0, atol=1e-9)


@pytest.mark.slow
def test_a_turned_path_turns_the_stress(cell_solver, cells):
    solver, cell = cells(cell_solver)
    states, R = path(SHEAR, 0.05), Rotation.from_rotvec([0.3, -0.2, 0.4]).as_matrix()
    plain = solver.relax(cell, states, TIMES, TWO).response
    # The turn itself grows from one time to the next.
    turns = [np.linalg.matrix_power(R, k) for k in range(len(TIMES))]
    H = np.stack([Q @ (np.eye(3) + H) - np.eye(3) for Q, H in zip(turns, states.grad_u, strict=True)])
    turned = solver.relax(cell, MacroState(H, states.p), TIMES, TWO).response
    wanted = np.stack([Q @ P for Q, P in zip(turns, plain.stress, strict=True)])
    np.testing.assert_allclose(turned.stress, wanted, rtol=0, atol=1e-9)
    np.testing.assert_allclose(turned.fluid_volume, plain.fluid_volume, rtol=0, atol=1e-9)


def test_contact_is_told_and_a_lost_state_ends_the_path(cell_solver, cells):
    solver, cell = cells(cell_solver)
    f = np.array([0.0, 0.1, 0.4, 0.97, 0.1])
    states = MacroState(f[:, None, None] * np.diag([0.0, -1.0, 0.0]), np.zeros(5))
    solution = solver.relax(cell, states, np.arange(5.0), series([1.0], [1.0]), fields=True)
    found = solution.response
    assert list(found.status[:3]) == [Status.converged, Status.converged, Status.contact]
    assert found.extrema.contact_share[2] > 0
    assert not Status(int(found.status[3])).has_values
    assert found.status[4] == found.status[3]
    assert np.isnan(found.stress[3:]).all()
    assert [field is None for field in solution.fields] == [False, False, False, True, True]


def test_a_path_that_cannot_be_followed_is_refused(cell_solver, cells):
    solver, cell = cells(cell_solver)
    states = MacroState.zeros(2)
    with pytest.raises(ConfigurationError, match="one time for each of at least one state, got 2 states"):
        solver.relax(cell, states, np.zeros(3), TWO)
    with pytest.raises(ConfigurationError, match="finite times that never fall"):
        solver.relax(cell, states, np.array([1.0, 0.0]), TWO)
    inverted = MacroState(np.stack([np.zeros((3, 3)), np.diag([0.0, -1.2, 0.0])]), np.zeros(2))
    with pytest.raises(ConfigurationError, match=r"det \(I \+ H\) > 0, got .* at the time 1"):
        solver.relax(cell, inverted, np.array([0.0, 1.0]), TWO)


def test_the_solid_of_a_step_derives_from_its_energy():
    """Stress and tangent against differences; the energy does not change under a rotation."""
    rng = np.random.default_rng(0)
    F = np.eye(3) + 0.1 * rng.normal(size=(2, 3, 3, 3))
    B = rng.normal(size=(2, 3, 3, 3))
    solid = RelaxingSolid(NeoHookean(), 0.7, B + B.swapaxes(-2, -1))
    dF, h = rng.normal(size=F.shape), 1e-5
    slope = (solid.energy_density(F + h * dF) - solid.energy_density(F - h * dF)) / (2 * h)
    np.testing.assert_allclose((solid.stress(F) * dF).sum(axis=(-2, -1)), slope, rtol=1e-7)
    slopes = (solid.stress(F + h * dF) - solid.stress(F - h * dF)) / (2 * h)
    np.testing.assert_allclose(
        np.einsum("...ijkl,...kl->...ij", solid.tangent(F), dF), slopes, rtol=0, atol=1e-7
    )
    R = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
    np.testing.assert_allclose(solid.energy_density(R @ F), solid.energy_density(F), rtol=1e-12)
    S = second_stress(NeoHookean(), F)
    np.testing.assert_allclose(F @ S, NeoHookean().stress(F), rtol=0, atol=1e-12)
