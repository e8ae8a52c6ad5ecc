"""Warnings of bodies that cannot drain."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.macro.body.surfaces import Patch
from porocore.macro.drainage import drained_axes, undrained
from porocore.macro.problem import Boundary
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
