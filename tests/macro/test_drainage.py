"""Warnings of bodies that cannot drain."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from porocore.macro.analytic import excess_force, relaxed
from porocore.macro.body.mesh import Patch
from porocore.macro.boundary.drainage import drained_axes, held_sideways, moved, relaxation_time, undrained
from porocore.macro.problem import Boundary, body_mesh
from porocore.testing.synthetic.response import confined_column


@pytest.fixture
def column():
    return confined_column(4)


def with_faces(column, **faces):
    names = {"top": "y+", "side": "x+"}
    boundary = {**column.boundary, **{names[name]: value for name, value in faces.items()}}
    return column.model_copy(update={"boundary": boundary})


def test_a_body_that_drains_is_not_warned_of(column):
    assert undrained(column, np.diag([1.0, 1.1e-6, 1.0])) == []


@pytest.mark.parametrize("across", [1e-9, 0.0, -1e-18])
def test_no_conductivity_towards_the_drained_face(column, across):
    (warning,) = undrained(column, np.diag([1.0, across, 1.0]))
    assert "no fluid along y (K_22 =" in warning
    assert "the face y+" in warning


def test_a_cell_that_conducts_nothing(column):
    (warning,) = undrained(column, np.zeros((3, 3)))
    assert "no fluid in any direction" in warning


def test_a_part_of_a_face_has_its_direction(column):
    strip = column.model_copy(
        update={
            "surfaces": {"strip": Patch(of="y+", x=(0.0, 0.5))},
            "boundary": {name: value for name, value in column.boundary.items() if name != "y+"}
            | {"strip": column.boundary["y+"]},
        }
    )
    (warning,) = undrained(strip, np.diag([1.0, 0.0, 1.0]))
    assert "no fluid along y" in warning
    assert "the surface strip" in warning


def test_the_axes_along_which_fluid_leaves(column):
    """Across flat faces and parts of them; along all three where one is curved."""
    assert drained_axes(column) == (1,)
    both = with_faces(column, side=Boundary(displacement=(0, None, 0), pressure=0))
    assert drained_axes(both) == (0, 1)
    strip = both.boundary | {"strip": both.boundary["x+"]}
    del strip["x+"], strip["y+"]
    part = both.model_copy(update={"surfaces": {"strip": Patch(of="x+", y=(0.0, 0.5))}, "boundary": strip})
    assert drained_axes(part) == (0,)
    mantle = column.model_copy(update={"boundary": {"side": Boundary(pressure=0), **column.boundary}})
    assert drained_axes(mantle) == (0, 1, 2)
    closed = {name: Boundary(normal=0) for name in column.boundary}
    assert drained_axes(column.model_copy(update={"boundary": closed})) == ()


def test_of_two_drained_faces_the_closed_one_is_named(column):
    both = with_faces(column, side=Boundary(displacement=(0, None, 0), pressure=0))
    (warning,) = undrained(both, np.diag([0.0, 1.0, 1.0]))
    assert "the face x+" in warning


def test_no_drained_face(column):
    (warning,) = undrained(with_faces(column, top=Boundary(traction=(0.0, 1.0, 0.0))), np.eye(3))
    assert "no surface has a prescribed pressure" in warning


def test_a_prescribed_flux_lets_fluid_out(column):
    assert undrained(with_faces(column, top=Boundary(flux=1.0)), np.eye(3)) == []


def test_the_force_after_a_sudden_displacement_relaxes_by_its_own_mode(column):
    """A piston that is moved was told the time of a sudden load, T = 1.13; its force relaxes with π², T = 0.374."""
    assert relaxed(1.0, 0.05) == pytest.approx(np.log(2 / 0.05) / np.pi**2, rel=1e-4)
    assert relaxed(0.0, 0.05) is None
    assert relaxed(0.04, 0.05) is None
    n, dt, T = 400, 1e-4, 0.2
    for share in (0.999999, 0.9, 0.3):
        # Finite volumes of p_t - r mean(p)_t = p_yy, drained at y = 1, from the undrained pressure 1.
        flow = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
        flow[0, 0], flow[-1, -1] = 1, 3
        kept = np.eye(n) - share / n
        step, p = np.linalg.solve(kept + dt * n**2 * flow, kept), np.ones(n)
        p = np.linalg.matrix_power(step, round(T / dt)) @ p
        excess = share / (1 - share) * p.mean()
        assert excess_force(share, np.array([T]))[0] == pytest.approx(excess, rel=3e-3)


def test_which_bodies_relax_in_a_known_time(column):
    c = SimpleNamespace(
        biot=np.eye(3),
        stiffness=np.full((3, 3, 3, 3), 0.5),
        storage=0.0,
        consolidation_coefficient=lambda axis: 2.0,
    )
    assert held_sideways(column) == 1
    assert not moved(column)
    assert relaxation_time(column, c) is None
    pressed = with_faces(column, top=Boundary(displacement=(None, -0.1, None), pressure=0))
    height = np.ptp(body_mesh(pressed).points[:, 1])
    once = relaxation_time(pressed, c)
    assert once == pytest.approx(0.37377 * height**2 / 2, rel=1e-3)
    both = {**pressed.boundary, "y-": Boundary(normal=0, pressure=0)}
    assert relaxation_time(pressed.model_copy(update={"boundary": both}), c) == pytest.approx(once / 4)
    loose = with_faces(pressed, side=Boundary())
    assert held_sideways(loose) is None
    assert moved(loose)
    assert relaxation_time(loose, c) is None
