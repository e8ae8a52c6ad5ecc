"""Bodies as meshes, and what is prescribed on them."""

import numpy as np
import pytest
from pydantic import ValidationError

from porocore.core.formulas import TimeFunction
from porocore.errors import ConfigurationError
from porocore.macro.body.kinds import Box, make_body
from porocore.macro.body.mesh import HEXAHEDRON, TETRAHEDRON, BodyMesh, Facets, boundary_facets, sector
from porocore.macro.boundary.conditions import (
    Constraint,
    boundary_data,
    follower_forces,
    follower_tangent,
    in_frames,
)
from porocore.macro.boundary.reactions import interpolation
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.testing.synthetic.response import confined_column

SIZE, ELEMENTS = (1.0, 2.0, 1.5), (2, 3, 4)
PATCH = {"body": {"size": SIZE, "elements": ELEMENTS}}


def make(elements=ELEMENTS, size=SIZE):
    return make_body(Box(size=size, elements=elements))


@pytest.mark.parametrize("element", [HEXAHEDRON, TETRAHEDRON], ids=lambda e: e.shape)
def test_shape_functions_are_one_at_their_node_and_their_slopes_are_slopes(element):
    np.testing.assert_allclose(element.values(element.nodes), np.eye(len(element.nodes)), atol=1e-14)
    x, h = np.random.default_rng(0).random((6, 3)) / 3, 1e-6
    gradients = [(element.values(x + h * e) - element.values(x - h * e)) / (2 * h) for e in np.eye(3)]
    np.testing.assert_allclose(element.gradients(x), np.stack(gradients, axis=-1), atol=1e-9)
    np.testing.assert_allclose(element.corner_values(x) @ element.nodes[: element.corners], x, atol=1e-14)
    middle = element.nodes.mean(axis=0)
    for facet in element.facets:
        corners = element.nodes[facet[: element.facet_corners]]
        outward = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        assert outward @ (corners.mean(axis=0) - middle) > 0
        between = (corners + np.roll(corners, -1, axis=0)) / 2
        edges = facet[element.facet_corners : 2 * element.facet_corners]
        np.testing.assert_allclose(element.nodes[edges], between)


def test_nodes_elements_and_corners_of_a_box_run_along_x_first():
    mesh = make()
    assert len(mesh.points) == 5 * 7 * 9
    np.testing.assert_array_equal(np.lexsort(mesh.points.T), np.arange(len(mesh.points)))
    middles = mesh.points[mesh.cells[:, 26]]
    np.testing.assert_array_equal(np.lexsort(middles.T), np.arange(2 * 3 * 4))
    np.testing.assert_allclose(middles, mesh.points[mesh.cells].mean(axis=1), atol=1e-15)
    np.testing.assert_array_equal(mesh.p_nodes[mesh.p_cells], mesh.cells[:, :8])
    np.testing.assert_array_equal(mesh.points.max(axis=0), SIZE)
    assert mesh.size == 3 * 5 * 7 * 9 + 3 * 4 * 5
    assert mesh.straight


def test_a_node_is_found_by_its_place():
    mesh = make()
    shifted = mesh.points + 1e-9 * np.sin(np.arange(mesh.points.size)).reshape(mesh.points.shape)
    np.testing.assert_array_equal(mesh.node_at(shifted), np.arange(len(mesh.points)))


def test_the_quadrature_is_exact_as_far_as_it_says():
    x, w = HEXAHEDRON.points, HEXAHEDRON.weights
    for powers in [(0, 0, 0), (5, 5, 5), (4, 5, 3), (1, 0, 5)]:
        exact = np.prod([1 / (n + 1) for n in powers])
        assert w @ (x**powers).prod(axis=1) == pytest.approx(exact, rel=1e-14)
    assert w @ x[:, 0] ** 6 != pytest.approx(1 / 7, rel=1e-5)
    np.testing.assert_array_equal(np.lexsort(x.T), np.arange(27))
    x, w = TETRAHEDRON.points, TETRAHEDRON.weights
    assert w @ (x[:, 0] * x[:, 1]) == pytest.approx(1 / 120, rel=1e-13)


def test_the_pressure_at_all_nodes_is_trilinear():
    mesh = make((1, 1, 1))

    def p(X):
        x, y, z = X.T
        return 0.3 + x - 2 * y + 3 * z + x * y - 4 * y * z + 5 * x * z - 6 * x * y * z

    found = mesh.pressure_everywhere(p(mesh.points[mesh.p_nodes]))
    np.testing.assert_allclose(found, p(mesh.points), atol=1e-13)


def test_the_stretch_is_that_of_the_node_with_most_of_it():
    """The middle of a single cube, by hand: N = 4 x (1 − x) along each edge, the rule's points at (1 ± √0.6)/2."""
    slope = 5 / 9 * 4 * np.sqrt(0.6)
    assert make((1, 1, 1), (1, 1, 1)).stretch == pytest.approx(3 * slope * (2 / 3) ** 2, rel=1e-13)


@pytest.mark.parametrize("angle", [np.pi / 2, np.pi / 7, 2 * np.pi])
def test_a_sector_has_the_volume_and_the_areas_of_one(angle):
    """Curved elements: the error goes with the fourth power of their size."""
    errors = []
    for n in (1, 2):
        mesh = sector(2.0, 1.5, angle, (2 * n, 1, n), 1.0)
        assert mesh.weights.min() > 0
        area = {name: Facets(mesh, facets).areas.sum() for name, facets in mesh.surfaces.items()}
        assert area["y+"] == pytest.approx(area["y-"], rel=1e-12)
        assert area["y+"] * 1.5 == pytest.approx(mesh.weights.sum(), rel=1e-10)
        assert area["side"] == pytest.approx(angle * 2 * 1.5, rel=2e-3)
        for name in set(area) - {"y-", "y+", "side"}:
            assert area[name] == pytest.approx(2 * 1.5, rel=1e-12)
        assert sum(map(len, mesh.surfaces.values())) == len(boundary_facets(mesh.cells))
        errors.append(abs(mesh.weights.sum() / (angle / 2 * 4 * 1.5) - 1))
    assert errors[1] < errors[0] / 10


def test_elements_are_graded():
    mesh = make_body(Box(size=(4, 1, 1), elements=(3, 1, 1), grading=(4, 1, 1)))
    edges = np.unique(mesh.points[mesh.p_nodes][:, 0])
    np.testing.assert_allclose(np.diff(edges) / np.diff(edges)[0], [1, 2, 4])
    assert edges[-1] == 4


def test_prescribed_values_and_loads_of_the_faces():
    side = {"displacement": (0, None, 0)}
    boundary = {
        **{face: side for face in ("x-", "x+", "z-", "z+")},
        "y-": {"displacement": (None, 0, None), "flux": -0.5},
        "y+": {"traction": (0, 2, 0), "pressure": 0.25},
    }
    problem = confined_column(ELEMENTS, size=SIZE, boundary=boundary)
    mesh = body_mesh(problem)
    data = boundary_data(mesh, problem)
    assert data.time_functions == (1.0,)
    values = np.full(mesh.size, np.nan)
    values[data.prescribed] = data.values[:, 0]
    u, p = values[: mesh.n_u].reshape(-1, 3), values[mesh.n_u :]
    x, y, z = mesh.points.T
    on_side = (x == 0) | (x == 1) | (z == 0) | (z == 1.5)
    np.testing.assert_array_equal(u[:, 0] == 0, on_side)
    np.testing.assert_array_equal(np.isnan(u[:, 2]), ~on_side)
    np.testing.assert_array_equal(u[:, 1] == 0, y == 0)
    corners = mesh.points[mesh.p_nodes]
    np.testing.assert_array_equal(p == 0.25, corners[:, 1] == 2)
    assert (~np.isnan(p)).sum() == 3 * 5
    force, outflow = data.external[0, : mesh.n_u].reshape(-1, 3), data.external[0, mesh.n_u :]
    np.testing.assert_allclose(force.sum(axis=0), [0, -2 * 1.5, 0], atol=1e-14)
    assert outflow.sum() == pytest.approx(-0.5 * 1.5)
    # Consistent loads do the work of the traction on any quadratic displacement.
    np.testing.assert_allclose(force[:, 1] @ (x**2 * z**2), -2 * (1 / 3) * (1.5**3 / 3), rtol=1e-13)
    np.testing.assert_allclose(outflow @ (corners[:, 0] * corners[:, 2]), -0.5 * 0.5 * 1.5**2 / 2, rtol=1e-13)


@pytest.mark.parametrize(
    ("face", "message"),
    [
        (
            {"plate": 1, "displacement": (None, 0.1, None)},
            r"y\+ has both a plate.* and a displacement u_2.*keep one",
        ),
        ({"plate": 1, "normal": 0.1}, "both a plate, which is pushed, and a normal displacement; keep one"),
    ],
)
def test_a_plate_that_is_moved_is_refused(face, message):
    with pytest.raises(ValidationError, match=message):
        MacroProblem.model_validate({"body": {"size": (2, 1, 0.5)}, "boundary": {"y+": face}})


def test_a_patch_takes_its_facets_from_the_surface():
    problem = MacroProblem.model_validate(
        PATCH
        | {
            "surfaces": {
                "strip": {"of": "y+", "x": (0, 0.5)},
                "disk": {"of": "y+", "centre": (1, 2, 0), "radius": 0.5},
            },
            "boundary": {"y-": {"displacement": (0, 0, 0)}},
        }
    )
    mesh = body_mesh(problem)
    counts = {name: len(facets) for name, facets in mesh.surfaces.items()}
    assert (counts["strip"], counts["disk"], counts["y+"]) == (4, 1, 3)
    assert Facets(mesh, mesh.surfaces["strip"]).areas.sum() == pytest.approx(0.5 * 1.5)


def test_a_surface_that_slides_fixes_its_normal_component_with_its_sign():
    problem = MacroProblem.model_validate(
        PATCH
        | {"boundary": {"x-": {"normal": 0.1}, "x+": {"normal": 0.2}, "y-": {"displacement": (None, 0, 0)}}}
    )
    mesh = body_mesh(problem)
    data = boundary_data(mesh, problem)
    values = dict(zip(data.prescribed.tolist(), data.values[:, 0].tolist(), strict=True))
    for node in np.flatnonzero(mesh.points[:, 0] == 0):
        assert values[3 * node] == -0.1
    for node in np.flatnonzero(mesh.points[:, 0] == 1):
        assert values[3 * node] == 0.2
    assert data.rotation is None


def test_a_frame_holds_what_is_prescribed_of_an_oblique_node():
    """n·u = 0.3, said twice, and u_2 = −0.1 at one node."""
    mesh = make((1, 1, 1))
    n = np.array([0.6, 0, -0.8])
    oblique = {4: [Constraint(n, 0, 0.3, "one"), Constraint(-n, 0, -0.3, "other")]}
    others = [Constraint(np.eye(3)[1], 1, -0.1, "u_2")]
    rotation, (unknowns, values) = in_frames(mesh, oblique, lambda node: others, 2)
    np.testing.assert_allclose((rotation @ rotation.T).toarray(), np.eye(mesh.size), atol=1e-14)
    np.testing.assert_array_equal(unknowns, [12, 13])
    amplitudes = np.array([2.0, 3.0])
    framed = np.zeros(mesh.size)
    framed[unknowns] = values @ amplitudes
    framed[14] = 0.77  # free
    u = (rotation.T @ framed)[12:15]
    assert n @ u == pytest.approx(0.6)
    assert u[1] == pytest.approx(-0.3)


def test_the_axis_of_a_plate_keeps_its_place_in_a_frame():
    mesh, n = make((1, 1, 1)), np.array([0.6, 0, -0.8])
    oblique = {4: [Constraint(n, 0, 0.3, "one")]}
    rotation, (unknowns, _) = in_frames(mesh, oblique, lambda node: [], 1, {4: [1]})
    frame = rotation[12:15, 12:15].toarray()
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
    np.testing.assert_array_equal(frame[1], [0, 1, 0])
    np.testing.assert_allclose(frame[0], n)
    np.testing.assert_array_equal(unknowns, [12])


def test_dependent_constraints_that_contradict_are_refused():
    """Four planes in three dimensions: the last one follows from the others, or does not."""
    mesh = make((1, 1, 1))
    last = np.array([1.0, 2.0, 2.0]) / 3

    def frames(value):
        planes = [Constraint(axis, 0, 0.3, "a") for axis in np.eye(3)]
        return in_frames(mesh, {4: [*planes, Constraint(last, 0, value, "d.normal")]}, lambda node: [], 1)

    frames(0.5)
    with pytest.raises(ConfigurationError, match=r"d.normal contradicts what a prescribe"):
        frames(0.4)


WEDGE = {"body": {"kind": "wedge", "radius": 1, "height": 0.7, "elements": (1, 1, 1), "angle": 60}}
HELD = {"oblique": {"normal": 0}, "z-": {"normal": 0}, "y-": {"normal": 0}}


def test_a_plate_beside_an_oblique_plane_is_refused_where_they_are_not_at_right_angles():
    """Along y the plate slides on the oblique plane; along z it would be pushed into it."""
    problem = MacroProblem.model_validate(WEDGE | {"boundary": {**HELD, "y+": {"plate": 1}}})
    data = boundary_data(body_mesh(problem), problem)
    assert len(data.plates) == 1
    assert not np.isin(data.plates[0], data.prescribed).any()
    faces = {**HELD, "z-": {"plate": 1}}
    problem = MacroProblem.model_validate(WEDGE | {"boundary": faces})
    with pytest.raises(
        ConfigurationError,
        match=r"boundary.z-: the plate moves along z, but macro.boundary.oblique.normal prescribes the "
        r"displacement of the common edge along \(.*\), a direction that is not perpendicular to z",
    ):
        boundary_data(body_mesh(problem), problem)


def test_two_plates_of_one_axis_with_a_common_edge_are_refused():
    """Their nodes would have to move with both."""
    problem = MacroProblem.model_validate(
        PATCH
        | {
            "surfaces": {"left": {"of": "y+", "x": (0, 0.5)}},
            "boundary": {
                **{face: {"normal": 0} for face in ("x-", "y-", "z-")},
                "left": {"plate": 1},
                "y+": {"plate": 2},
            },
        }
    )
    with pytest.raises(
        ConfigurationError, match=r"shares an edge with the plate 'y.', which moves along the same"
    ):
        boundary_data(body_mesh(problem), problem)


def test_courses_have_their_values_and_corners():
    table = TimeFunction(table=((0, 1.0), (2, 3.0)))
    assert [table.at(t) for t in (0, 1, 2, 9)] == [1, 2, 3, 3]
    ramp = TimeFunction(ramp=-2.0, until=4.0)
    assert [ramp.at(t) for t in (0, 1, 4, 9)] == [0, -0.5, -2, -2]
    assert TimeFunction(expression="2*t + sin(pi*t)").at(0.5) == pytest.approx(2.0)
    assert (table.corners, ramp.corners) == ((0.0, 2.0), (4.0,))
    for wrong in (
        {},
        {"ramp": 1.0},
        {"table": ((1, 0), (0, 1))},
        {"ramp": 1.0, "until": 1.0, "expression": "t"},
    ):
        with pytest.raises(ValidationError):
            TimeFunction.model_validate(wrong)
    with pytest.raises(ValidationError, match="unknown name"):
        TimeFunction(expression="2*x")


def test_a_follower_is_the_slope_of_the_volume_that_it_encloses():
    """∫ p n N da = p ∂V/∂u for a closed surface; its tangent is the slope of that, and symmetric there."""
    mesh = make((1, 2, 1))
    facets = Facets(mesh, boundary_facets(mesh.cells))
    rng = np.random.default_rng(1)
    u = 0.05 * rng.standard_normal(mesh.points.shape)

    def volume(u):
        return BodyMesh(mesh.points + u, mesh.cells).weights.sum()

    direction, h = rng.standard_normal(u.shape), 1e-6
    slope = (volume(u + h * direction) - volume(u - h * direction)) / (2 * h)
    assert (follower_forces(facets, u, 0.7) * direction).sum() == pytest.approx(0.7 * slope, rel=1e-7)
    matrix = follower_tangent(facets, u, 0.7)
    change = (
        follower_forces(facets, u + h * direction, 0.7) - follower_forces(facets, u - h * direction, 0.7)
    ) / (2 * h)
    np.testing.assert_allclose(matrix @ direction.ravel(), change.ravel(), atol=1e-8)
    assert abs(matrix - matrix.T).max() < 1e-12


def test_probes_interpolate_exactly_inside_curved_elements():
    mesh = sector(1.0, 1.0, np.pi / 2, (2, 1, 1), 1.0)
    place = (0.3, 0.4, 0.6)
    rows = interpolation(mesh, {"here": place})
    A = np.random.default_rng(0).standard_normal((3, 3))
    x = np.concatenate([(mesh.points @ A.T).ravel(), np.ones(len(mesh.p_nodes))])
    np.testing.assert_allclose(rows @ x, [*(A @ place), 1], atol=1e-11)
