"""Rule of identifiability: distances by scale and name."""

import numpy as np
import pytest

from porocore.commands.calibration.problem import Unknown
from porocore.commands.calibration.suggestions import IdentifiabilityRule

RULE = IdentifiabilityRule()
MODULUS = Unknown("modulus", 1.0, 0.1, 10.0, "log")
POISSON = Unknown("core.poisson_ratio", 0.3, 0.0, 0.49)
SHIFT = Unknown("time_shift", 0.0, -2.0, 2.0, unit="s")


@pytest.mark.parametrize(
    ("unknown", "value", "distance"), [(MODULUS, 5.0, 0.5), (POISSON, 0.3, 0.04), (SHIFT, 0.3, 0.2)]
)
def test_distances(unknown, value, distance):
    assert RULE.distance(unknown, value) == pytest.approx(distance)
    assert RULE.holds(unknown, value, value - 0.999 * distance, value + 0.999 * distance)
    assert not RULE.holds(unknown, value, value - 1.001 * distance, value)
    assert not RULE.holds(unknown, value, value, value + 1.001 * distance)


def test_an_open_end_is_not_identifiable():
    assert not RULE.holds(MODULUS, 5.0, None, 5.1)
    assert not RULE.holds(MODULUS, 5.0, 4.9, None)


def test_limits_are_moves_of_coordinates():
    found = RULE.limits((MODULUS, POISSON), np.array([np.log(5.0), 0.3]))
    assert found == pytest.approx([np.log(1.1), 0.04])
    assert IdentifiabilityRule(relative=0.2, poisson_ratio=0.1).limits(
        (MODULUS, POISSON), np.zeros(2)
    ) == pytest.approx([np.log(1.2), 0.1])


def test_a_distance_may_be_given_by_name():
    rule = IdentifiabilityRule(distances={"nu": 0.02})
    unknown = Unknown("nu", 0.3, 0.0, 0.49)
    assert rule.distance(unknown, 0.3) == 0.02
    assert RULE.distance(unknown, 0.3) == pytest.approx(0.03)


def test_an_angle_is_compared_with_a_right_one():
    assert RULE.distance(Unknown("fibres.angle", 2.0, 0.0, 180.0), 2.0) == 9.0
    assert RULE.distance(Unknown("angle", 2.0, 1.0, 180.0, "log"), 2.0) == pytest.approx(0.2)
