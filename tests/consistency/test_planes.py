"""Followers, oblique planes and plates beside them: both backends, large and small, and boxes that are turned."""

import numpy as np
import pytest

from porocore.testing.macro_checks.runs import NONLINEAR
from tests.consistency.planes import NAMES, isotropic_law, problem, turned_box

#: Beyond 3,000 unknowns other solvers are chosen than below.
LARGE = 3_000
TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
TURN = TURN * np.sign(np.linalg.det(TURN))
SIZES = [pytest.param(2, id="small"), pytest.param(5, id="large", marks=pytest.mark.slow)]
#: Independent directions everywhere, and a clamped face beside planes, which holds what they hold.
HELD = {
    "planes": {"x-": {"normal": 0}, "y-": {"normal": 0}, "z-": {"normal": 0}},
    "clamped": {"x-": {"normal": 0}, "y-": {"displacement": (0, 0, 0)}, "z-": {"normal": 0}},
}


@pytest.mark.parametrize("elements", SIZES)
@pytest.mark.parametrize("name", NAMES)
def test_backends_agree(macro_solver_pair, load, name, elements):
    found = []
    for backend in macro_solver_pair:
        solver = load("macro solver", backend)
        prepared = solver.prepare(problem(name, elements))
        assert (len(prepared.free) > LARGE) == (elements == 5)
        found.append(solver.solve(prepared, NONLINEAR))
    one, other = found
    np.testing.assert_allclose(one.profiles[-1].u, other.profiles[-1].u, rtol=0, atol=1e-9)
    np.testing.assert_allclose(one.profiles[-1].p, other.profiles[-1].p, rtol=0, atol=1e-9)
    assert abs(one.profiles[-1].u).max() > 1e-3
    for surface, force in one.reactions.items():
        np.testing.assert_allclose(force, other.reactions[surface], rtol=0, atol=1e-9)


def test_a_plate_beside_an_oblique_plane_moves_as_one_and_bears_its_force(macro_solver, load):
    solver = load("macro solver", macro_solver)
    prepared = solver.prepare(problem("plate", 2))
    solution = solver.solve(prepared, NONLINEAR)
    last, top = solution.profiles[-1], solution.points[:, 1] == 0.7
    assert np.ptp(last.u[top, 1]) == 0
    normal = np.array([np.sin(np.pi / 3), 0, -np.cos(np.pi / 3)])
    on_plane = np.abs(solution.points @ normal) < 1e-9
    assert on_plane.sum() > 10
    assert np.abs(last.u[on_plane] @ normal).max() < 1e-15
    assert solution.reactions["y-"][-1, 1] == pytest.approx(0.03, rel=1e-8)
    assert last.u[top, 1].max() < -1e-2


@pytest.mark.parametrize("held", HELD)
def test_a_turned_box_has_turned_reactions(macro_solver, load, tmp_path, held):
    """No tangential force on a smooth plane, and equilibrium with the load."""
    solver, found = load("macro solver", macro_solver), []
    for name, turn in (("straight", np.eye(3)), ("turned", TURN)):
        (tmp_path / name).mkdir()
        faces = HELD[held]
        if held == "clamped" and name == "turned":
            faces = dict(reversed(faces.items()))
        prepared = solver.prepare(turned_box(tmp_path / name, turn, faces))
        found.append(solver.solve(prepared, isotropic_law()))
    straight, turned = found
    largest = abs(straight.reactions["y-"]).max()
    assert largest > 1e-3
    for surface, force in straight.reactions.items():
        np.testing.assert_allclose(
            turned.reactions[surface], force @ TURN.T, rtol=0, atol=1e-9 * largest, err_msg=surface
        )
        if held == "planes":
            normal = TURN[:, "xyz".index(surface[0])]
            force = turned.reactions[surface]
            assert abs(force - np.outer(force @ normal, normal)).max() < 1e-15
    total = sum(force[-1] for force in straight.reactions.values())
    np.testing.assert_allclose(total, -0.8 * np.array([0.004, -0.02, -0.006]), atol=1e-9)


def test_the_reported_darcy_flux_is_the_prescribed_flux_at_a_drained_end(macro_solver, load):
    """Steady flow through a compressed confined column: area and normal of the end do not change, so w is q̄."""
    from porocore.report.dimensional import darcy_flux
    from porocore.testing.synthetic.response import confined_column

    sides = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
    faces = {
        **sides,
        "y-": {"displacement": (0, 0, 0), "flux": -0.02},
        "y+": {"displacement": (None, -0.15, None), "pressure": 0},
    }
    plan = {"end": 400.0, "step": 50.0, "ramp_increments": 4, "ramp_step": 0.5, "profiles": ()}
    solver = load("macro solver", macro_solver)
    prepared = solver.prepare(confined_column(4, 1.0, size=(0.1, 1.0, 0.1), boundary=faces, time=plan))
    profile = solver.solve(prepared, NONLINEAR).profiles[-1]
    np.testing.assert_allclose(profile.flux[:, 1], 0.02, rtol=1e-6)
    np.testing.assert_allclose(darcy_flux(profile)[:, 1], 0.02, rtol=1e-6)
    bar = profile.deformation
    assert np.abs(bar[:, 1, 1] / np.linalg.det(bar) - 1).min() > 0.02  # what F̄ would make of it
