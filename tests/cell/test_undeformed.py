"""Undeformed members as data to learn from: kinds of parameters, what is known of the solid, the count."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.family.mesh import (
    UnstressedFamily,
    isotropic_solid,
    parameter_kinds,
    rest_data,
    undeformed_count,
)
from porocore.sampling.execution.members import UndeformedMemberSolver
from porocore.states import MacroState
from porocore_fem_skfem.cell_solver import SkfemCellSolver

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


# --- solids that swell ---------------------------------------------------------------------------------

COARSE = {"size": 0.5, "fluid_size": 0.5, "element": "linear"}


class Layered(Cell):
    """A cell whose solid has two regions, by the distance from the middle of the cell."""

    def make_mesh(self, phase, domain):
        mesh = super().make_mesh(phase, domain)
        far = np.linalg.norm(mesh.points[mesh.cells[:, :4]].mean(axis=1), axis=1) > 0.5
        return replace(mesh, regions=far.astype(np.int64), region_names=("near", "far"))


def members(cell, theta):
    """Solved undeformed members at rows of parameters, and what is learned from them."""
    solver = UndeformedMemberSolver(SkfemCellSolver())
    states = MacroState.zeros(len(theta)).with_parameters(np.array(theta))
    response = solver.solve(solver.prepare(UnstressedFamily(cell)), states).response
    return response, rest_data(cell, states, response)


def test_members_of_a_solid_that_swells_as_a_whole_are_those_before_it_does():
    radius = {"geometry": {"radius": RANGE}, "mesh": COARSE}
    swelling = family(**radius, material={"swelling": {"range": [1.05, 1.2]}})
    found, rests = members(swelling, [[0.22, 1.1], [0.28, 1.2]])
    dry, known = members(family(**radius), [[0.22], [0.28]])
    for name in ("stress", "fluid_volume", "conductivity"):
        np.testing.assert_array_equal(getattr(found, name), getattr(dry, name), err_msg=name)
    np.testing.assert_array_equal(found.tangent.stress_grad_u, dry.tangent.stress_grad_u)
    for name, value in vars(dry.slopes).items():
        np.testing.assert_array_equal(getattr(found.slopes, name)[..., :1], value, err_msg=name)
        assert not getattr(found.slopes, name)[..., 1].any(), name
    assert rests.states.parameters.tolist() == [[0.22, 1.0], [0.28, 1.0]]
    assert (rests.kinds, rests.stretch, known.stretch) == (("length", "swelling"), 1.0, 1.0)
    assert rests.stiffness_slopes.shape == (2, 10, 10, 2)


def test_members_without_another_parameter_than_the_swelling_are_one_cell():
    found, rests = members(family(mesh=COARSE, material={"swelling": {"range": [1.0, 1.2]}}), [[1.1], [1.2]])
    assert found.slopes is None
    np.testing.assert_array_equal(found.tangent.stress_grad_u[0], found.tangent.stress_grad_u[1])
    assert rests.stiffness_slopes is None


def test_a_stretch_that_is_a_number_is_told_beside_the_members():
    fixed = family(geometry={"radius": RANGE}, mesh=COARSE, material={"swelling": 1.1})
    found, rests = members(fixed, [[0.22]])
    np.testing.assert_allclose(found.stress, 0.0, atol=1e-14)
    assert rests.stretch == 1.1


def test_members_whose_regions_swell_differently_are_held():
    cell = Layered(
        mesh=COARSE, materials={"near": {"swelling": {"range": [1.0, 1.2]}}, "far": {"poisson_ratio": RANGE}}
    )
    found, rests = members(cell, [[1.1, 0.25], [1.0, 0.25]])
    assert np.abs(found.stress[0]).max() > 1e-3
    np.testing.assert_allclose(found.stress[1], 0.0, atol=1e-13)
    assert rests.stiffness_slopes is None
    assert rests.porosity[0] == pytest.approx(rests.porosity[1], rel=1e-12)
    assert rests.porosity[1] == pytest.approx(found.fluid_volume[1], rel=1e-12)
    assert found.fluid_volume[0] < rests.porosity[0] - 0.01
    assert parameter_kinds(cell) == ("other", "poisson_ratio")
