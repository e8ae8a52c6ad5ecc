"""The box as a mesh, and what is prescribed on it."""

import numpy as np
import pytest

from porocore.macro.boundary import boundary_data
from porocore.macro.mesh import BoxMesh, gauss_points, gauss_weights
from porocore.testing.synthetic import confined_column

SIZE, ELEMENTS = (1.0, 2.0, 1.5), (2, 3, 4)


def make(**settings):
    return BoxMesh.make(confined_column(ELEMENTS, size=SIZE, **settings))


def test_nodes_elements_and_corners_run_along_x_first():
    mesh = make()
    assert len(mesh.points) == 5 * 7 * 9
    np.testing.assert_array_equal(np.lexsort(mesh.points.T), np.arange(len(mesh.points)))
    middles = mesh.points[mesh.cells[:, 26]]
    np.testing.assert_array_equal(np.lexsort(middles.T), np.arange(2 * 3 * 4))
    np.testing.assert_allclose(middles, mesh.points[mesh.cells].mean(axis=1), atol=1e-15)
    np.testing.assert_array_equal(mesh.p_nodes[mesh.p_cells], mesh.cells[:, :8])
    np.testing.assert_array_equal(mesh.points.max(axis=0), SIZE)
    assert mesh.size == 3 * 5 * 7 * 9 + 3 * 4 * 5


def test_a_node_is_found_by_its_place():
    mesh = make()
    shifted = mesh.points + 1e-9 * np.sin(np.arange(mesh.points.size)).reshape(mesh.points.shape)
    np.testing.assert_array_equal(mesh.node_at(shifted), np.arange(len(mesh.points)))


def test_the_quadrature_is_exact_to_degree_five_in_each_direction():
    x, w = gauss_points(), gauss_weights()
    for powers in [(0, 0, 0), (5, 5, 5), (4, 5, 3), (1, 0, 5)]:
        exact = np.prod([1 / (n + 1) for n in powers])
        assert w @ (x**powers).prod(axis=1) == pytest.approx(exact, rel=1e-14)
    assert w @ x[:, 0] ** 6 != pytest.approx(1 / 7, rel=1e-5)
    assert make().weights.sum() * 24 == pytest.approx(3, rel=1e-14)
    np.testing.assert_array_equal(np.lexsort(x.T), np.arange(27))


def test_the_pressure_at_all_nodes_is_trilinear():
    mesh = BoxMesh.make(confined_column((1, 1, 1), size=SIZE))

    def p(X):
        x, y, z = X.T
        return 0.3 + x - 2 * y + 3 * z + x * y - 4 * y * z + 5 * x * z - 6 * x * y * z

    found = mesh.pressure_everywhere(p(mesh.points[mesh.p_nodes]))
    np.testing.assert_allclose(found, p(mesh.points), atol=1e-13)


def test_the_stretch_is_that_of_the_node_with_most_of_it():
    """The middle of a single cube, by hand: N = 4 x (1 − x) along each edge, the rule's points at (1 ± √0.6)/2."""
    mesh = BoxMesh.make(confined_column((1, 1, 1), size=(1, 1, 1)))
    slope = 5 / 9 * 4 * np.sqrt(0.6)
    assert mesh.stretch == pytest.approx(3 * slope * (2 / 3) ** 2, rel=1e-13)


def test_prescribed_values_and_loads_of_the_faces():
    side = {"displacement": (0, None, 0)}
    boundary = {
        **{face: side for face in ("x-", "x+", "z-", "z+")},
        "y-": {"displacement": (None, 0, None), "flux": -0.5},
        "y+": {"traction": (0, 2, 0), "pressure": 0.25},
    }
    mesh = make(boundary=boundary)
    data = boundary_data(mesh)
    values = np.full(mesh.size, np.nan)
    values[data.prescribed] = data.values
    u, p = values[: mesh.n_u].reshape(-1, 3), values[mesh.n_u :]
    x, y, z = mesh.points.T
    on_side = (x == 0) | (x == 1) | (z == 0) | (z == 1.5)
    np.testing.assert_array_equal(u[:, 0] == 0, on_side)
    np.testing.assert_array_equal(np.isnan(u[:, 2]), ~on_side)
    np.testing.assert_array_equal(u[:, 1] == 0, y == 0)
    corners = mesh.points[mesh.p_nodes]
    np.testing.assert_array_equal(p == 0.25, corners[:, 1] == 2)
    assert (~np.isnan(p)).sum() == 3 * 5
    force, outflow = data.external[: mesh.n_u].reshape(-1, 3), data.external[mesh.n_u :]
    np.testing.assert_allclose(force.sum(axis=0), [0, -2 * 1.5, 0], atol=1e-14)
    assert outflow.sum() == pytest.approx(-0.5 * 1.5)
    # Consistent loads do the work of the traction on any quadratic displacement.
    np.testing.assert_allclose(force[:, 1] @ (x**2 * z**2), -2 * (1 / 3) * (1.5**3 / 3), rtol=1e-13)
    np.testing.assert_allclose(outflow @ (corners[:, 0] * corners[:, 2]), -0.5 * 0.5 * 1.5**2 / 2, rtol=1e-13)
