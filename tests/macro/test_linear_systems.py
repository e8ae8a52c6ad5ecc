"""What the iterations for large bodies share: the coarse level, the Schur complement, the memory of a factor."""

from __future__ import annotations

from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from porocore.interfaces.law import MacroTangent
from porocore.interfaces.solution import StepWork
from porocore.macro import linear_systems as memory
from porocore.macro.boundary.conditions import boundary_data
from porocore.macro.linear_systems import (
    LinearWork,
    ReusePolicy,
    forcing,
    linear_level,
    linear_prolongation,
    pressure_mass,
    rigid_modes,
    step_in_words,
    sufficient,
    work_in_words,
)
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.testing.synthetic.response import confined_column

SLOPE = np.array([[0.1, -0.2, 0.3], [0.4, 0.5, -0.6], [0.7, 0.8, 0.9]])
WEDGE = MacroProblem.model_validate(
    {
        "body": {"kind": "wedge", "radius": 1, "height": 0.7, "elements": (2, 2, 1), "angle": 60},
        "boundary": {
            "oblique": {"normal": 0},
            "z-": {"normal": 0},
            "y-": {"displacement": (None, 0, None)},
            "y+": {"plate": -0.03},
        },
    }
)


def test_linear_displacements_are_prolonged_exactly():
    mesh = body_mesh(confined_column((2, 3, 2)))
    level = linear_prolongation(mesh)
    coarse = (mesh.points[mesh.p_nodes] @ SLOPE.T + 1).ravel()
    np.testing.assert_allclose(level @ coarse, (mesh.points @ SLOPE.T + 1).ravel(), atol=1e-13)


def test_rigid_modes_have_no_strain():
    points = np.random.default_rng(0).uniform(size=(9, 3))
    modes = rigid_modes(points).reshape(9, 3, 6)
    for k in range(6):
        slope = np.linalg.lstsq(np.column_stack([points, np.ones(9)]), modes[:, :, k], rcond=None)[0]
        np.testing.assert_allclose(slope[:3] + slope[:3].T, 0, atol=1e-13)
    assert np.linalg.matrix_rank(modes.reshape(-1, 6)) == 6


def test_the_coarse_level_obeys_supports_frames_and_plates():
    mesh = body_mesh(WEDGE)
    boundary = boundary_data(mesh, WEDGE)
    level = linear_level(mesh, boundary)
    plate = boundary.plates[0]
    coarse = np.random.default_rng(1).normal(size=level.prolongation.shape[1]) * level.active
    fine = level.prolongation @ coarse
    assert len(plate) > 3
    assert np.ptp(fine[plate]) < 1e-14
    assert np.abs(fine[plate[0]]) > 0
    prescribed = boundary.prescribed[boundary.prescribed < mesh.n_u]
    np.testing.assert_array_equal(fine[prescribed], 0)
    # Every active unknown acts, and no other.
    acts = np.asarray(abs(level.prolongation).sum(axis=0)).ravel() > 0
    np.testing.assert_array_equal(acts, level.active)
    # In Cartesian components the field is linear along every edge that no support touches.
    cartesian = (boundary.rotation[: mesh.n_u, : mesh.n_u].T @ fine).reshape(-1, 3)
    touched = np.isin(np.arange(len(mesh.points)), np.concatenate([prescribed, plate]) // 3)
    free_cells = mesh.cells[~touched[mesh.cells].any(axis=1)]
    ends = mesh.element.corner_values(mesh.element.nodes)
    for cell in free_cells:
        np.testing.assert_allclose(
            cartesian[cell], ends @ cartesian[cell[: mesh.element.corners]], atol=1e-13
        )


def test_the_pressure_mass_of_an_isotropic_solid_is_that_of_its_bulk_modulus():
    i, bulk, shear, biot = np.eye(3), 0.7, 0.3, 0.6
    volume = np.einsum("ij,kl->ijkl", i, i)
    mixed = np.einsum("ik,jl->ijkl", i, i) + np.einsum("il,jk->ijkl", i, i)
    stiffness = (bulk - 2 * shear / 3) * volume + shear * mixed
    n, share = 6, np.array([0.9, 1.1, 1.0] * 2)
    tangent = MacroTangent(
        stress_grad_u=share[:, None, None, None, None] * np.broadcast_to(stiffness, (n, 3, 3, 3, 3)),
        stress_p=np.broadcast_to(-biot * i, (n, 3, 3)),
        storage_grad_u=np.broadcast_to(biot * i, (n, 3, 3)),
        storage_p=np.ones(n),
        flux_grad_u=np.zeros((n, 3, 3, 3)),
        flux_p=np.zeros((n, 3)),
        flux_grad_p=np.zeros((n, 3, 3)),
    )
    np.testing.assert_allclose(pressure_mass(tangent, 3), biot**2 / bulk, rtol=1e-8)


def test_memory_is_that_of_the_machine_or_of_a_tighter_group(tmp_path, monkeypatch):
    group = tmp_path / "group"
    group.mkdir()
    monkeypatch.setattr(memory.psutil, "virtual_memory", lambda: SimpleNamespace(available=4096 * 1024))
    monkeypatch.setattr(memory, "_GROUPS", ((group, "memory.max", "memory.current"),))
    assert memory.available_bytes() == 4096 * 1024
    (group / "memory.max").write_text("max\n")
    (group / "memory.current").write_text("1000\n")
    assert memory.available_bytes() == 4096 * 1024
    (group / "memory.max").write_text("100000\n")
    (group / "memory.stat").write_text("anon 5\ninactive_file 300\n")
    assert memory.available_bytes() == 100000 - 1000 + 300
    assert memory.fits(70_000, 99_300.0)
    assert not memory.fits(90_000, 99_300.0)


def test_the_memory_of_a_factor_follows_its_power_law():
    assert memory.factor_bytes(200, at=100, gib=1.5, exponent=2) == pytest.approx(6 * 2**30)
    assert memory.spoken_bytes(6 * 2**30) == "6.0 GiB"


def test_two_levels_reduce_the_energy_of_a_smooth_load():
    """The coarse correction of a confined block alone finds most of the work of a smooth load."""
    problem = confined_column((3, 3, 3), size=(1, 1, 1))
    mesh = body_mesh(problem)
    level = linear_level(mesh, boundary_data(mesh, problem)).prolongation
    gradients = np.einsum(
        "qak,eqkj->eqaj", mesh.element.gradients(mesh.element.points), np.linalg.inv(mesh.jacobians)
    )
    local = np.einsum("eq,eqaj,eqbj->eab", mesh.weights, gradients, gradients)
    n = len(mesh.points)
    scalar = np.zeros((n, n))
    for cell, block in zip(mesh.cells, local, strict=True):
        scalar[np.ix_(cell, cell)] += block
    free = np.flatnonzero(np.asarray(abs(level).sum(axis=1)).ravel())
    A = np.kron(scalar, np.eye(3))[np.ix_(free, free)]
    P = level[free]
    P = P[:, np.asarray(abs(P).sum(axis=0)).ravel() > 0]
    load = np.tile([0.0, 1.0, 0.0], n)[free]
    whole = load @ np.linalg.solve(A, load)
    coarse = P.T @ load
    found = coarse @ np.linalg.solve(P.T @ A @ P.toarray(), coarse)
    assert 0.9 * whole < found < whole


def test_a_preconditioner_ages_by_iterations_a_digit():
    policy = ReusePolicy()
    assert policy.due
    policy.renewed()
    policy.add(10, 1e-5)
    policy.add(2, 0.5)  # tells nothing
    policy.add(6, 1e-2)  # three a digit where two were enough: not yet
    assert not policy.due
    policy.add(7, 1e-2)
    assert policy.due
    policy.renewed()
    policy.add(40, 1e-10)
    assert not policy.due
    policy.expire()
    assert policy.due


@pytest.mark.parametrize(
    ("misfit", "before", "expected"),
    [
        (1.0, None, 1e-4),
        (1e-2, 1.0, 0.9e-4),
        (1e-5, 1e-1, 1e-5),  # 1e-10 of Newton's tolerance are enough
        (1e-2, 1e-1, 1e-4),
        (1e-12, 1e-3, 1e-4),
        (0.0, None, 1e-10),
        (np.nan, 1.0, 1e-10),
    ],
)
def test_newtons_method_wants_as_many_digits_as_it_can_use(misfit, before, expected):
    assert forcing(misfit, before, 1e-9) == pytest.approx(expected)


def test_a_tangent_that_does_not_change_is_solved_with_to_the_end():
    assert sufficient(1e-1, 1e-9) == pytest.approx(1e-9)
    assert sufficient(0.0, 1e-9) == sufficient(1e3, 1e-9) == 1e-10


def test_the_record_of_a_step_begins_anew_with_the_next():
    work = LinearWork()
    work.add_set_up(2.0)
    work.add_set_up(1.0, whole=False)
    for iterations in (7, 9):
        work.add_solve(iterations, 0.5)
    work.note("once")
    work.note("once")
    step, notes = work.take()
    assert (step.systems, step.iterations, step.most_iterations, step.set_ups) == (2, 16, 9, 1)
    assert (step.set_up_seconds, step.solve_seconds) == (3.0, 1.0)
    assert step.seconds > 0
    assert notes == ("once",)
    assert step_in_words(step).startswith(", 16 iterations for 2 systems, set-up 3.0 s, ")
    after, notes = work.take()
    assert (after.systems, after.iterations, after.set_ups, notes) == (0, 0, 0, ())
    assert step_in_words(after) == step_in_words(None) == ""


def test_sums_of_a_solve_are_told_in_words():
    work = dict.fromkeys((f.name for f in fields(StepWork)), np.zeros(3))
    assert work_in_words({}) == work_in_words(work) == ""
    work |= {"systems": np.array([0, 3, 2.0]), "iterations": np.array([0, 20, 14.0])}
    work |= {"most_iterations": np.array([0, 8, 9.0]), "seconds": np.array([0, 3, 2.0])}
    words = work_in_words(work)
    assert words.startswith("5 linear systems in 34 iterations, at most 9 each; 0 set-ups in 0.0 s")
    assert words.endswith("; 2.5 s a step")
