"""Rigid bodies inside closed surfaces of triangles: distance, refusals, a sphere of many facets."""

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.macro.boundary.closed_surface import read_surface
from porocore.macro.boundary.conditions import boundary_data
from porocore.macro.boundary.contact import ContactScales, IndenterContact
from porocore.macro.problem import body_mesh
from porocore.plugins.registry import registry
from porocore.testing.macro_checks.contact import SPHERE, pressed
from porocore.testing.macro_checks.runs import LINEAR
from tests.helpers.spheres import icosphere, write_stl

pytest.importorskip("vtkmodules.vtkCommonDataModel")


def cube(side=1.0):
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    faces = []
    for axis in range(3):
        for end in (0, 1):
            own = np.flatnonzero(corners[:, axis] == end)
            a, b, c, d = own if end else own[[0, 2, 1, 3]]
            quads = [(a, b, c), (d, c, b)] if axis != 1 else [(a, c, b), (d, b, c)]
            faces += quads
    return side * corners, np.array(faces)


def read(path, scale=1.0):
    return read_surface(path, str(path.stat().st_mtime_ns), scale)


@pytest.fixture
def solid(tmp_path):
    return read(write_stl(tmp_path / "cube.stl", *cube()))


def test_the_distance_from_a_cube_is_that_of_a_box(solid):
    """Faces, edges and corners, inside and outside."""
    x = np.random.default_rng(0).uniform(-0.7, 1.7, (4000, 3))
    gap, normal, _ = solid.distance(x)
    q = np.abs(x - 0.5) - 0.5
    wanted = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)
    np.testing.assert_allclose(gap, wanted, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, rtol=1e-12)


def test_gradient_and_hessian_are_limits_of_differences(solid):
    x, h = np.random.default_rng(1).uniform(-0.7, 1.7, (400, 3)), 1e-6
    gap, normal, hessian = solid.distance(x)
    for i in range(3):
        up, down = (solid.distance(x + sign * h * np.eye(3)[i]) for sign in (1, -1))
        # Beside the planes between two features the limits are one-sided.
        smooth = (np.abs(up[1] - down[1]).max(axis=1) < 0.01) & (np.abs(gap) > 1e-3)
        assert smooth.mean() > 0.95
        slope, turned = (up[0] - down[0]) / (2 * h), (up[1] - down[1]) / (2 * h)
        np.testing.assert_allclose(slope[smooth], normal[smooth, i], atol=1e-8)
        np.testing.assert_allclose(turned[smooth], hessian[smooth][:, :, i], atol=1e-5)


def test_a_sphere_of_facets_has_the_distance_of_the_sphere(tmp_path):
    surface = read(write_stl(tmp_path / "ball.stl", *icosphere(1.0, 4)))
    x = np.random.default_rng(2).normal(size=(1000, 3))
    gap, normal, _ = surface.distance(x)
    length = np.linalg.norm(x, axis=1)
    np.testing.assert_allclose(gap, length - 1, atol=2e-3)
    assert np.einsum("ni,ni->n", normal, x / length[:, None]).min() > 0.998


def test_surfaces_that_are_turned_inward_are_turned_outward(tmp_path):
    points, triangles = cube()
    surface = read(write_stl(tmp_path / "inward.stl", points, triangles[:, ::-1]))
    gap, *_ = surface.distance(np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 2.0]]))
    np.testing.assert_allclose(gap, [-0.5, 1.0])


def problem(path, **shape):
    ball = {"shape": {"kind": "surface", "path": str(path)} | shape, "place": (0, 2.8, 0), "surfaces": ["y+"]}
    return pressed(ball | {"displacement": 0.05})


def collected(one):
    return boundary_data(body_mesh(one), one)


def test_what_is_refused_has_its_key(tmp_path):
    points, triangles = icosphere(0.8, 1)
    path = tmp_path / "ball.stl"
    one = triangles.copy()
    one[0] = one[0, ::-1]
    for changed, said in (
        (
            (points, triangles[1:]),
            r"ball\.stl is not closed: of its 120 edges 3 belong to one triangle alone",
        ),
        ((points, one), "turn opposite ways"),
        ((points * 1000, triangles), r"shape\.scale: the surface is 1\.6e\+03 times as long as the body"),
        ((points / 1000, triangles), r"shape\.scale: the surface is"),
    ):
        write_stl(path, *changed)
        with pytest.raises(ConfigurationError, match=rf"^macro\.contact\.indenter\.shape\..*{said}|{said}"):
            collected(problem(path))
    path.write_text("solid nothing\nendsolid\n")
    with pytest.raises(ConfigurationError, match=r"indenter\.shape\.path: .*ball\.stl"):
        collected(problem(path))
    path.write_bytes(b"\x00" * 100)
    with pytest.raises(ConfigurationError, match=r"indenter\.shape\.path: .*ball\.stl"):
        collected(problem(path))
    write_stl(path, points, triangles)
    before = problem(path)
    write_stl(path, points * 1.01, triangles)
    with pytest.raises(ConfigurationError, match=r"indenter\.shape\.sha256"):
        collected(before)
    flat = {"kind": "plane-strain", "size": (1, 1), "elements": (2, 2)}
    shape, held = {"kind": "surface", "path": str(path)}, {"y-": {"normal": 0}, "x-": {"normal": 0}}
    one = pressed(SPHERE | {"shape": shape, "displacement": 0.05}, body=flat, boundary=held)
    with pytest.raises(ConfigurationError, match="has two; give another kind of shape"):
        collected(one)


def test_a_file_counts_by_its_content(tmp_path):
    one, other = (write_stl(tmp_path / name, *icosphere(0.8, 1)) for name in ("a.stl", "b.stl"))
    assert problem(one).specification() == problem(other).specification()
    assert problem(one).specification() != problem(one, scale=2.0).specification()


def solved(one):
    pytest.importorskip("porocore_fem_skfem")
    solver = registry().get("macro solver", "skfem")()
    return solver.solve(solver.prepare(one), LINEAR)


@pytest.mark.slow
@pytest.mark.parametrize("by", ["displacement", "force"])
def test_a_sphere_of_facets_presses_as_the_sphere(tmp_path, by):
    """20,480 facets in millimetres, whose middles lie up to 1.5e-4 below the sphere."""
    points, triangles = icosphere(800.0, 5)
    # A corner of the icosahedron is turned to the tip.
    tip = points[0] / 800
    turn = np.linalg.qr(np.stack([tip, *np.eye(3)[:2]], axis=1))[0]
    turn = np.stack([turn[:, 1], np.sign(turn[:, 0] @ tip) * -turn[:, 0], turn[:, 2]])
    path = write_stl(tmp_path / "ball.stl", points @ turn.T, triangles)
    drained = {"under": "sealed", "outside": "drained"}
    given = drained | {by: 0.05 if by == "displacement" else 2e-3}
    shape = {"kind": "surface", "path": str(path), "scale": 1e-3}
    of_facets = {"shape": shape, "place": (0, 1.8, 0), "surfaces": ["y+"]}
    found = solved(pressed(of_facets | given)).contact["indenter"]
    wanted = solved(pressed(SPHERE | given)).contact["indenter"]
    for column in (0, 1):
        scale = wanted[-1, column]
        np.testing.assert_allclose(found[:, column], wanted[:, column], atol=0.01 * scale)
    np.testing.assert_allclose(found[-1, 2], wanted[-1, 2], rtol=0.03)


def test_the_tangent_is_that_of_the_forces(tmp_path):
    """Along a random direction, with faces and edges of a coarse ball at work."""
    points, triangles = icosphere(0.8, 2)
    path = write_stl(tmp_path / "ball.stl", points, triangles)
    one = problem(path)
    mesh = body_mesh(one)
    (contact,) = boundary_data(mesh, one).contacts
    rng = np.random.default_rng(3)
    whole, along, h = 1e-3 * rng.normal(size=mesh.size), rng.normal(size=mesh.size), 1e-8

    def state(share):
        return IndenterContact(contact, whole + share * along, 1.1, ContactScales())

    found = state(0.0).tangent(1.0) @ along
    slope = (state(h).residual(1.0) - state(-h).residual(1.0)) / (2 * h)
    assert state(0.0).touched.sum() > 10
    np.testing.assert_allclose(found, slope, atol=1e-5 * np.abs(slope).max())
