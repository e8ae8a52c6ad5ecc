"""Regions, parameters and axes of a body's elements: kept with a solution, read back, given to states; their law."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from porocore.errors import DataError
from porocore.interfaces.cell import ElementCells
from porocore.interfaces.solution import MacroSolution
from porocore.macro.analytic import LayeredConsolidation, SoilLayer
from porocore.macro.body.kinds import most_telling, sections
from porocore.macro.boundary.drainage import diffusion_time, drainage_time
from porocore.macro.composition.regions import nearest_rotations
from porocore.macro.laws.composed import NearestMemberLaw, RegionLaw
from porocore.macro.laws.linear import LinearPoroelasticity, RestCoefficients, coefficients_of_elements
from porocore.macro.problem import body_mesh
from porocore.plugins.registry import registry
from porocore.states import MacroState
from porocore.testing.synthetic.cell import CONDUCTIVITY, BoundCell, parametric_law
from porocore.testing.synthetic.response import confined_column, linear_law

SHORT = {"end": 2.0, "step": 1.0, "ramp_increments": 1, "ramp_step": 0.5, "profiles": (0.5,)}
#: Pores that grow to a formula until t = 1, in a column of four elements of which the lowest has its own.
PROBLEM = {
    "fields": {
        "radius": {"formula": "0.2 + 0.005*y", "initial": 0.25, "over": {"ramp": 1.0, "until": 1.0}},
        "stiffness": 1.3,
        "axes": {"about": [0, 1, 0], "angle": "10*y"},
    },
    "regions": {"deep": {"kind": "layer", "below": 1.0, "fields": {"radius": 0.18}}},
    "size": (0.1, 4.0, 0.1),
}


@pytest.fixture(scope="module", params=["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
def solution(request):
    pytest.importorskip(request.param)
    problem = confined_column(4, -0.01, time=SHORT, **PROBLEM)
    solver = registry().get("macro solver", request.param)()
    return solver.solve(solver.prepare(problem), parametric_law())


def turn(degrees):
    return Rotation.from_rotvec(np.deg2rad(degrees) * np.array([0, 1.0, 0])).as_matrix()


def test_a_solution_has_the_cells_of_its_elements(solution):
    cells, y = solution.element_cells, solution.points[solution.cells[:, :8], 1].mean(axis=1)
    assert cells.regions == ("deep",)
    assert cells.parameters == ("radius", "stiffness")
    np.testing.assert_array_equal(cells.region, y < 1)
    for i, profile in enumerate(solution.profiles):
        share = min(profile.time, 1.0)
        grown = 0.25 + share * (0.2 + 0.005 * y - 0.25)
        np.testing.assert_allclose(cells.field("radius", i), np.where(y < 1, 0.18, grown), rtol=1e-13)
        np.testing.assert_allclose(cells.field("stiffness", i), 1.3, rtol=1e-14)
        np.testing.assert_allclose(cells.axes_at(i), [turn(10 * at) for at in y], atol=1e-13)


def test_states_are_those_that_the_cells_see(solution):
    y = solution.points[solution.cells[:, :8], 1].mean(axis=1)
    states, H = solution.cell_states(1), solution.profiles[1].grad_u
    for e, at in enumerate(y):
        R = turn(10 * at)
        np.testing.assert_allclose(states.grad_u[e], R.T @ H[e] @ R, atol=1e-15)
    np.testing.assert_array_equal(states.parameters, solution.element_cells.values_at(1))
    given = solution.element_cells.given_to(states[[2, 2, 0]], 1, np.array([2, 2, 0]))
    np.testing.assert_array_equal(given.parameters, states.parameters[[2, 2, 0]])


def test_the_file_has_them_and_a_solution_of_one_cell_has_none(solution, tmp_path):
    path = tmp_path / "solution.h5"
    solution.save(path)
    again, cells = MacroSolution.load_file(path).element_cells, solution.element_cells
    assert (again.regions, again.parameters) == (cells.regions, cells.parameters)
    for name in ("region", "values", "axes"):
        np.testing.assert_array_equal(getattr(again, name), getattr(cells, name))
    replace(solution, element_cells=None).save(path)
    alone = MacroSolution.load_file(path)
    assert alone.element_cells is None
    assert alone.cell_states(1).parameters is None
    with_a_gap = replace(cells, values=np.where(cells.values > 1, np.nan, cells.values))
    replace(solution, element_cells=with_a_gap).save(path)
    assert np.isnan(MacroSolution.load_file(path).element_cells.field("stiffness", 0)).all()


def test_a_file_whose_elements_have_no_such_region_is_refused(solution, tmp_path):
    path = tmp_path / "solution.h5"
    replace(solution, element_cells=replace(solution.element_cells, region=np.full(4, 2))).save(path)
    with pytest.raises(DataError, match="names a region that is not there"):
        MacroSolution.load_file(path)


def test_means_of_rotations_become_rotations():
    turns = Rotation.from_rotvec([[0, 0, 0.1], [0, 0, 0.3]]).as_matrix()
    (found,) = nearest_rotations(turns.mean(axis=0)[None])
    np.testing.assert_allclose(found, Rotation.from_rotvec([0, 0, 0.2]).as_matrix(), atol=1e-14)
    flipped = np.diag([1.0, 1.0, -0.1])
    assert np.linalg.det(nearest_rotations(flipped)) == pytest.approx(1.0)


def soil(stiffness, conductivity):
    c = linear_law().coefficients
    return LinearPoroelasticity(
        replace(
            c,
            stiffness=stiffness * c.stiffness,
            storage=c.storage / stiffness,
            conductivity=conductivity * c.conductivity,
        )
    )


def layered(elements=30):
    """A column of an upper soil on a stiffer one that conducts less, and linear poroelasticity of its elements."""
    upper, lower = soil(1.0, 1.0), soil(4.0, 0.2)
    problem = confined_column(elements, regions={"lower": {"along": "y", "below": 2.5}})
    mesh = body_mesh(problem)
    region = (mesh.centres[:, 1] < 2.5).astype(np.int64)
    law = RegionLaw.by_name(["lower"], {"lower": lower}, rest=upper)
    return problem, coefficients_of_elements(law, ElementCells(region, ("lower",))), (lower, upper)


def test_elements_have_the_coefficients_of_their_own_law():
    problem, found, (lower, upper) = layered()
    for law, inside in ((lower, found.points.place.region == 1), (upper, found.points.place.region == 0)):
        c, n = law.coefficients, int(inside.sum())
        np.testing.assert_allclose(found.stiffness[inside].reshape(n, 3, 3, 3, 3)[0], c.stiffness, rtol=1e-14)
        np.testing.assert_allclose(found.biot[inside].reshape(n, 3, 3)[0], c.biot, rtol=1e-14)
        np.testing.assert_allclose(found.storage[inside], c.storage, rtol=1e-14)
        np.testing.assert_allclose(found.conductivity[inside][0], c.conductivity, rtol=1e-14)
    # The drained face belongs to the upper layer alone.
    assert diffusion_time(problem, found) == pytest.approx(
        diffusion_time(problem, upper.coefficients), rel=1e-12
    )


def test_turned_elements_have_turned_coefficients():
    values, axes = np.array([[[0.2, 1.3], [0.2, 1.3]]]), np.stack([np.eye(3), turn(30)])[None]
    cells = ElementCells(np.zeros(2, np.int64), (), ("radius", "stiffness"), values, axes)
    K = coefficients_of_elements(parametric_law(), cells).conductivity
    np.testing.assert_allclose(K[0], CONDUCTIVITY * 0.2**4, rtol=1e-12)
    np.testing.assert_allclose(K[1], turn(30) @ K[0] @ turn(30).T, rtol=1e-12, atol=1e-15)


def test_layers_drain_in_the_time_of_the_closed_form():
    """Both soils answer a sudden load with the same pressure, so that the settlement goes as the fluid does."""
    problem, found, (lower, upper) = layered(60)
    layers = [SoilLayer.from_coefficients(s.coefficients, h) for s, h in ((lower, 2.5), (upper, 5.0))]
    exact = LayeredConsolidation(layers, 1e-3)
    time = drainage_time(problem, found)
    first, last = exact.settlement(1e-9), exact.settlement(1e5)
    assert (exact.settlement(time) - first) / (last - first) == pytest.approx(0.95, abs=5e-4)
    # One cell everywhere is the body of its elements.
    c = upper.coefficients
    alike = RestCoefficients.of_elements(c, 60)
    assert drainage_time(problem, alike) == pytest.approx(drainage_time(problem, c), rel=1e-12)


def test_members_answer_where_they_are_the_nearest():
    values = np.array([[0.2, 1.0], [0.3, 1.0], [0.2, 2.0]])
    laws = [parametric_law(BoundCell(row), row[0]) for row in values]
    law = NearestMemberLaw(laws, values, {"radius": (0.15, 0.35), "stiffness": (1.0, 2.0)})
    rng = np.random.default_rng(0)
    theta = np.array([[0.21, 1.1], [0.29, 1.2], [0.2, 1.9], [0.24, 1.0]])
    states = MacroState(0.02 * rng.standard_normal((4, 3, 3)), 0.01 * rng.random(4), theta)
    grad_p = rng.standard_normal((4, 3))
    found = law.respond(states, grad_p, law.initial_at(states))
    for row, k in enumerate([0, 1, 2, 0]):
        alone = MacroState(states.grad_u[[row]], states.p[[row]])
        expected = laws[k].respond(alone, grad_p[[row]], laws[k].initial(1))
        for name in ("stress", "storage", "flux"):
            np.testing.assert_array_equal(getattr(found, name)[row], getattr(expected, name)[0])
    with pytest.raises(ValueError, match="expected states with parameters"):
        law.respond(MacroState.zeros(1), np.zeros((1, 3)), law.initial_at(states))


def test_a_section_shows_the_element_at_each_place():
    problem = confined_column(6, size=(1.0, 3.0, 2.0))
    mesh = body_mesh(problem)
    across_z, across_x, across_y = sections(mesh.points, mesh.cells)
    assert [each.across for each in (across_z, across_x, across_y)] == [2, 0, 1]
    right, up = across_z.places()
    assert (across_z.element >= 0).all()
    at = mesh.centres[across_z.element, 1]
    assert np.abs(at - up[:, None]).max() <= 0.25 + 1e-12
    assert (right.min(), right.max()) == pytest.approx((0, 1), abs=0.05)
    np.testing.assert_array_equal(np.unique(across_z.image(np.arange(6))), np.arange(6))
    # A field along y is seen in both upright sections, one that is uniform in the first.
    assert most_telling((across_y, across_x, across_z), mesh.centres[:, 1]) is across_x
    assert most_telling((across_z, across_x), np.ones(6)) is across_z


@pytest.mark.parametrize("elements", [(3, 2, 3), (1, 2, 1)])
def test_what_lies_outside_a_round_body_is_in_no_element(elements):
    """The sides of an element are curved: a straight one of 45 degrees would be off by 8 % of the radius."""
    from porocore.macro.body.kinds import QuarterCylinder

    mesh = QuarterCylinder(kind="quarter-cylinder", radius=1.0, height=1.0, elements=elements).make()
    across_y = sections(mesh.points, mesh.cells)[2]
    right, up = across_y.places()
    far = np.hypot(right[None, :], up[:, None])
    assert (across_y.element[far > 1.02] == -1).all()
    assert (across_y.element[far < 0.97] >= 0).all()
    assert np.isnan(across_y.image(np.ones(len(mesh.cells)))[far > 1.02]).all()
