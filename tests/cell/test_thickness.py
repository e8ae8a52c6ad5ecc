"""Thickness of the thinnest parts of a phase, from masks whose thickness is known."""

import numpy as np
import pytest

from porocore.cell.level_sets.voxels import least_thickness

VOXEL = np.full(3, 1 / 48)


def grid(n=48):
    return np.stack(np.meshgrid(*[np.arange(n) + 0.5] * 3, indexing="ij"))


@pytest.mark.parametrize("voxels", [2, 3, 4, 7, 10])
def test_a_plate(voxels):
    plate = np.zeros((48, 48, 48), bool)
    plate[10 : 10 + voxels] = True
    assert least_thickness(plate, VOXEL, periodic=True) * 48 == pytest.approx(voxels, abs=0.501)


def test_a_pore_goes_on_in_the_next_cell_or_in_the_mirror():
    solid = np.zeros((48, 48, 48), bool)
    solid[4:-4] = True
    assert least_thickness(~solid, VOXEL, periodic=True) * 48 == pytest.approx(8, abs=0.501)
    solid[-4:] = True
    assert least_thickness(~solid, VOXEL, periodic=True) * 48 == pytest.approx(4, abs=0.501)
    assert least_thickness(~solid, VOXEL, periodic=False) * 48 == pytest.approx(8, abs=0.501)


def test_the_neck_of_a_rod_counts_and_its_thick_part_does_not():
    x, y, z = grid()
    radius = 10 - 6 * np.exp(-(((x - 24) / 10) ** 2))
    rod = (y - 24) ** 2 + (z - 24) ** 2 < radius**2
    assert least_thickness(rod, VOXEL, periodic=True) * 48 == pytest.approx(8, abs=1.5)


@pytest.mark.parametrize("radius", [6, 12])
def test_edges_of_what_is_thick_do_not_count(radius):
    x, y, z = grid()
    block = (np.abs(x - 24) < radius) & (np.abs(y - 24) < radius) & (np.abs(z - 24) < radius)
    assert least_thickness(block, VOXEL, periodic=True) * 48 == pytest.approx(2 * radius, abs=1)


def test_a_ball_and_an_oblique_plate():
    x, y, z = grid()
    ball = (x - 24) ** 2 + (y - 24) ** 2 + (z - 24) ** 2 < 15**2
    assert least_thickness(ball, VOXEL, periodic=True) * 48 == pytest.approx(30, abs=2)
    plate = np.abs((x + y) % 48 - 24) < 4 * np.sqrt(2)  # a period of 48 holds it once along the diagonal
    assert least_thickness(plate, VOXEL, periodic=True) * 48 == pytest.approx(8, abs=1)


def test_voxels_need_not_be_cubes():
    plate = np.zeros((24, 48, 48), bool)
    plate[4:8] = True
    assert least_thickness(plate, np.array([2.0, 1, 1]), periodic=True) == pytest.approx(8, abs=1)


def test_one_phase_alone_has_no_thickness():
    assert least_thickness(np.ones((4, 4, 4), bool), VOXEL, periodic=True) == np.inf
