"""Where a surrogate is trusted: the hull of what is known, a little more, and never beyond the box."""

import numpy as np
import pytest

from porocore.core.inputs import InputSpace, SampledRange
from porocore.states import MacroState

INPUTS = InputSpace(("H22", "p"), (-0.2, 0.0), (0.1, 0.3))


def unit(*points):
    """States from points of the unit box."""
    low, high = np.array(INPUTS.lower), np.array(INPUTS.upper)
    return low + np.array(points) * (high - low)


def test_the_undeformed_cell_is_always_known():
    few = SampledRange.around(INPUTS, unit((0.1, 0.5), (0.2, 0.9), (0.15, 0.6)))
    assert not few.outside(MacroState.zeros(1))[0]


def test_the_range_ends_half_a_difference_of_neighbours_beyond_the_samples():
    side = np.linspace(0.2, 0.8, 7)  # 0.1 apart; the undeformed cell lies on the lower edge of the box
    grid = np.array(np.meshgrid(side, np.linspace(0, 0.6, 7))).reshape(2, -1).T
    around = SampledRange.around(INPUTS, unit(*grid))
    more = 0.1 / 2 / np.sqrt(2)
    within, beyond = 0.99 * more, 1.01 * more
    assert around.contains(
        unit((0.5, 0.6), (0.5, 0.6 + within), (0.2 - within, 0.3), (0.8 + within, 0.3))
    ).all()
    assert not around.contains(unit((0.5, 0.6 + beyond), (0.2 - beyond, 0.3), (0.8 + beyond, 0.3))).any()


@pytest.mark.parametrize("count", [2, 40])
def test_the_range_does_not_leave_the_box_unless_samples_do(count):
    """Two samples span nothing: their bounding box stands in for the hull."""
    points = np.concatenate([[[0, 0], [1, 1]], np.random.default_rng(0).random((count - 2, 2))])
    around = SampledRange.around(INPUTS, unit(*points))
    assert around.contains(unit((1.0, 1.0))).all()
    assert not around.contains(unit((1.0, 1.001), (-0.001, 0.0))).any()
    wider = SampledRange.around(INPUTS, unit(*points, (1.2, 1.2)))
    assert wider.contains(unit((1.2, 1.2))).all()
    assert not wider.contains(unit((1.3, 1.3))).any()


def test_a_component_that_is_no_input_may_move_by_what_is_not_felt():
    around = SampledRange.around(INPUTS, unit((0, 0), (0, 1), (1, 0), (1, 1)))
    H = np.zeros((3, 3, 3))
    H[:, 1, 1] = -0.1
    H[:, 0, 1] = 0, 3e-4, 5e-4  # of the 0.2 that H22 moves
    assert around.outside(MacroState(H, np.zeros(3))).tolist() == [False, False, True]
    pressure = InputSpace(("p",), (0.0,), (0.1,))
    H[:, 1, 1] = 0, 1e-7, 2e-6
    H[:, 0, 1] = 0
    assert pressure.moves_other(MacroState(H, np.zeros(3))).tolist() == [False, False, True]


def test_the_undeformed_cell_is_known_at_all_parameters():
    """The reach of the samples depends on the parameter: the hull is one in all inputs."""
    family = InputSpace.from_ranges({"H22": (-0.4, 0.0)}, {"radius": (0.1, 0.3)})
    radii = np.linspace(0.1, 0.3, 9)
    reach = -0.1 - (radii - 0.1)  # −0.1 at the smallest radius, −0.3 at the largest
    points = [[share * end, r] for r, end in zip(radii, reach, strict=True) for share in (0.25, 0.5, 0.75, 1)]
    around = SampledRange.around(family, points)
    assert around.contains([[0, 0.1], [0, 0.3], [-0.09, 0.1], [-0.29, 0.3]]).all()
    assert not around.contains([[-0.2, 0.1], [-0.05, 0.31]]).any()
    states = family.scatter([[-0.2, 0.1], [-0.2, 0.3]])
    assert around.outside(states).tolist() == [True, False]
