"""Undeformed members as data to learn from: kinds of parameters, what is known of the solid, the count."""

import pytest

from porocore.cell.cell import Cell
from porocore.cell.family.undeformed import isotropic_solid, parameter_kinds, undeformed_count

RANGE = {"range": [0.2, 0.3]}
NEO_HOOKEAN = {"kind": "neo-hookean", "poisson_ratio": RANGE}
MOONEY_RIVLIN = {"kind": "mooney-rivlin", "c10": 0.1, "c01": 0.05, "bulk_modulus": 2.0}


def family(**entries):
    return Cell.model_validate(entries)


@pytest.mark.parametrize(
    ("cell", "kinds", "solid", "count"),
    [
        (
            family(geometry={"radius": RANGE}, material=NEO_HOOKEAN),
            "length poisson_ratio",
            (1.0, "poisson_ratio"),
            20,
        ),
        (
            family(geometry={"radii": [RANGE, 0.2, 0.2]}, viscosity={"range": [1, 2]}),
            "length viscosity",
            (1.0, pytest.approx(0.35)),
            10,
        ),
        (
            family(geometry={"radius": 0.2}, material={"swelling": {"range": [1, 1.1]}}),
            "swelling",
            (1.0, pytest.approx(0.35)),
            6,
        ),
        (
            family(
                geometry={"kind": "tpms", "surface": "gyroid", "void_fraction": {"range": [0.4, 0.6]}},
                material=MOONEY_RIVLIN,
            ),
            "other",
            (pytest.approx(9 * 2 * 0.3 / 6.3), pytest.approx((3 * 2 - 2 * 0.3) / (2 * (3 * 2 + 0.3)))),
            10,
        ),
        (family(material=MOONEY_RIVLIN | {"c10": {"range": [0.1, 0.2]}}), "other", (None, None), 20),
    ],
    ids=["neo-hookean", "radii", "swelling", "void fraction", "modulus"],
)
def test_what_is_known_of_a_family(cell, kinds, solid, count):
    assert parameter_kinds(cell) == tuple(kinds.split())
    assert isotropic_solid(cell) == solid
    assert undeformed_count(cell) == count
