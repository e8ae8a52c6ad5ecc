"""Each function of the compatibility module against numbers that are known without dolfinx, on every version."""

from itertools import combinations

import basix
import numpy as np
import pytest
import ufl
from mpi4py import MPI

from porocore_fem_dolfinx import compat, elements

EDGES = [[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]]  # VTK's order
CORNERS = {
    "tetrahedron": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "hexahedron": [[x ^ y, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)],
}


def one_cell(cell, degree=1, moved=lambda x: x):
    """A mesh of the reference cell, its nodes given in VTK's order and moved."""
    points = np.array(CORNERS[cell], dtype=float)
    if degree == 2:
        points = np.vstack([points, points[EDGES].mean(axis=1)])
    order = compat.from_vtk(cell, len(points))
    return compat.make_mesh(
        MPI.COMM_SELF, cell, degree, moved(points.T).T, np.arange(len(points))[order][None]
    )


def integral(integrand, mesh, **metadata):
    dx = ufl.Measure("dx", domain=mesh, metadata=metadata)
    return compat.fem.assemble_scalar(compat.form(integrand * dx))


def test_a_curved_tetrahedron_has_the_volume_of_its_map():
    # det ∇φ = 1 + 0.5 Y + 0.06 Y² − 0.04 X² − 0.012 X² Y, and ∫ X^a Y^b Z^c = a! b! c! / (a + b + c + 3)!
    mesh = one_cell(
        "tetrahedron",
        2,
        lambda x: np.array([x[0] + 0.2 * x[0] * x[1], x[1] + 0.1 * x[0] ** 2, x[2] + 0.3 * x[1] * x[2]]),
    )
    volume = 1 / 6 + 0.5 / 24 + 0.06 * 2 / 120 - 0.04 * 2 / 120 - 0.012 * 2 / 720
    assert integral(compat.constant(mesh, 1.0), mesh, quadrature_degree=3) == pytest.approx(volume, rel=1e-14)


def test_a_trilinear_hexahedron_has_the_volume_of_its_map():
    # det ∇φ = (1 + 0.2 Y)(1 + 0.1 Z)(1 + 0.3 X) + 0.006 X Y Z
    mesh = one_cell(
        "hexahedron",
        moved=lambda x: np.array(
            [x[0] + 0.2 * x[0] * x[1], x[1] + 0.1 * x[1] * x[2], x[2] + 0.3 * x[2] * x[0]]
        ),
    )
    volume = 1.1 * 1.05 * 1.15 + 0.006 / 8
    assert integral(compat.constant(mesh, 1.0), mesh, quadrature_degree=4) == pytest.approx(volume, rel=1e-14)


def test_the_tables_of_a_mesh_and_of_a_space_lead_back_to_the_cells():
    corners = np.array([*CORNERS["tetrahedron"], [1, 1, 1]], dtype=float)
    cells = np.array([[0, 1, 2, 3], [1, 2, 3, 4]])
    mesh = compat.make_mesh(MPI.COMM_SELF, "tetrahedron", 1, corners, cells)
    original = np.asarray(mesh.geometry.input_global_indices)
    assert {frozenset(row) for row in original[compat.cell_nodes(mesh)].tolist()} == {
        frozenset(row) for row in cells.tolist()
    }
    space = compat.function_space(mesh, elements.lagrange_element("tetrahedron", 2))
    table = compat.cell_dofs(space.dofmap)
    assert table.shape == (2, 10)
    assert set(table.ravel()) == set(range(5 + 9))  # the two share a face with its three edges
    at = space.tabulate_dof_coordinates()
    for row, nodes in zip(table, compat.cell_nodes(mesh), strict=True):
        x = mesh.geometry.x[nodes]
        expected = [*x, *((x[i] + x[j]) / 2 for i, j in combinations(range(4), 2))]
        assert sorted(at[row].round(12).tolist()) == sorted(np.round(expected, 12).tolist())


@pytest.mark.parametrize("cell", ["tetrahedron", "hexahedron"])
@pytest.mark.parametrize("shape", [(), (3,), (3, 3)])
def test_lagrange_elements_hold_a_linear_field_of_every_shape(cell, shape):
    mesh = one_cell(cell)
    space = compat.function_space(mesh, elements.lagrange_element(cell, 1, shape))
    function = compat.fem.Function(space)
    assert function.ufl_shape == shape
    slopes = np.arange(1.0, 1 + max(1, int(np.prod(shape))))
    function.interpolate(lambda x: np.outer(slopes, x[0]) if shape else x[0])
    integrals = integrals_of_parts(function, mesh)
    first_moment = {"tetrahedron": 1 / 24, "hexahedron": 1 / 2}[cell]
    np.testing.assert_allclose(integrals, slopes * first_moment, rtol=1e-13)


def integrals_of_parts(function, mesh, **metadata):
    """Integrals of the components, last index fastest; one form, with the unit tensors as a constant."""
    units = np.eye(max(1, int(np.prod(function.ufl_shape)))).reshape(-1, *function.ufl_shape)
    unit = compat.constant(mesh, units[0])
    dx = ufl.Measure("dx", domain=mesh, metadata=metadata)
    compiled = compat.form(ufl.inner(function, unit) * dx)
    found = []
    for value in units:
        unit.value = value
        found.append(compat.fem.assemble_scalar(compiled))
    return found


@pytest.mark.parametrize("shape", [(), (3,), (3, 3)])
def test_quadrature_functions_carry_their_values_to_the_points_of_the_rule(shape):
    mesh = one_cell("tetrahedron", moved=lambda x: 2 * x)
    space = compat.function_space(mesh, elements.quadrature_element("tetrahedron", 2, shape))
    function = compat.fem.Function(space)
    points, _ = basix.make_quadrature(basix.CellType.tetrahedron, 2)
    at = compat.expression(ufl.SpatialCoordinate(mesh), points)
    x = compat.evaluate(at, mesh, [0]).reshape(-1, 3)
    np.testing.assert_allclose(x, 2 * points, rtol=1e-14)
    size = max(1, int(np.prod(shape)))
    values = np.arange(1.0, 1 + size)[None, :] * (x[:, 0] * x[:, 1])[:, None]
    table = compat.cell_dofs(space.dofmap)[0]
    function.x.array.reshape(-1, size)[table] = values
    integrals = integrals_of_parts(function, mesh, quadrature_degree=2)
    # ∫ x y over the tetrahedron with legs of 2
    np.testing.assert_allclose(integrals, np.arange(1.0, 1 + size) * 32 / 120, rtol=1e-13)


def test_a_rule_of_our_own_is_used():
    mesh = one_cell("tetrahedron")
    x = ufl.SpatialCoordinate(mesh)
    rule = {
        "quadrature_rule": "custom",
        "quadrature_points": np.array([[0.2, 0.3, 0.1], [0.5, 0.1, 0.3]]),
        "quadrature_weights": np.array([0.25, 0.75]),
    }
    value = integral(x[0] * x[1] + x[2] ** 2, mesh, **rule)
    assert value == pytest.approx(0.25 * (0.06 + 0.01) + 0.75 * (0.05 + 0.09), rel=1e-14)


def test_two_rules_in_one_process_are_told_apart():
    mesh = one_cell("tetrahedron")
    values = []
    for weight in (0.1, 0.2):
        rule = {
            "quadrature_rule": "custom",
            "quadrature_points": np.array([[0.25, 0.25, 0.25]]),
            "quadrature_weights": np.array([weight]),
        }
        values.append(integral(compat.constant(mesh, 1.0), mesh, **rule))
    assert values == pytest.approx([0.1, 0.2], rel=1e-14)


def test_an_expression_is_evaluated_at_the_given_points_of_the_given_cells():
    corners = np.array([*CORNERS["tetrahedron"], [1, 1, 1]], dtype=float)
    mesh = compat.make_mesh(MPI.COMM_SELF, "tetrahedron", 1, corners, np.array([[0, 1, 2, 3], [1, 2, 3, 4]]))
    space = compat.function_space(mesh, elements.lagrange_element("tetrahedron", 2, (3,)))
    u = compat.fem.Function(space)
    u.interpolate(lambda x: np.array([x[0] * x[1], x[2] ** 2, x[0] + 2 * x[1]]))
    x = ufl.SpatialCoordinate(mesh)
    points = np.array([[0.1, 0.2, 0.3], [0.25, 0.25, 0.25]])
    both = compat.expression(ufl.as_vector([*x, *(ufl.grad(u)[i, j] for i, j in np.ndindex(3, 3))]), points)
    for cells in ([0], [1], [1, 0]):
        values = compat.evaluate(both, mesh, cells)
        assert values.shape == (len(cells), 2 * 12)
        for at, gradient in zip(
            values.reshape(-1, 12)[:, :3], values.reshape(-1, 12)[:, 3:].reshape(-1, 3, 3), strict=True
        ):
            exact = [[at[1], at[0], 0], [0, 0, 2 * at[2]], [1, 2, 0]]
            np.testing.assert_allclose(gradient, exact, atol=1e-13)
    assert not np.allclose(compat.evaluate(both, mesh, [0]), compat.evaluate(both, mesh, [1]))


def test_a_constant_changes_without_compiling_again():
    mesh = one_cell("hexahedron")
    H = compat.constant(mesh, np.eye(3))
    trace = compat.form(ufl.tr(H) * ufl.dx(domain=mesh))
    assert compat.fem.assemble_scalar(trace) == pytest.approx(3, rel=1e-14)
    H.value[:] = np.diag([1.0, 2.0, 4.0])
    assert compat.fem.assemble_scalar(trace) == pytest.approx(7, rel=1e-14)


def test_a_function_and_its_vector_share_their_values():
    mesh = one_cell("hexahedron")
    function = compat.fem.Function(
        compat.function_space(mesh, elements.lagrange_element("hexahedron", 1, (3,)))
    )
    vector = compat.vector_of(function)
    assert vector.getSize() == 24
    vector.array[:] = np.arange(24.0)
    assert function.x.array.tolist() == list(range(24))
    function.x.array[5] = -1
    assert vector.array[5] == -1


def test_the_mass_matrix_and_the_load_of_a_hexahedron():
    mesh = one_cell("hexahedron")
    space = compat.function_space(mesh, elements.lagrange_element("hexahedron", 1))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    factor = compat.constant(mesh, 1.0)
    mass = compat.form(factor * u * v * ufl.dx)
    line = np.array([[2, 1], [1, 2]]) / 6
    cube = np.kron(line, np.kron(line, line))
    table = compat.cell_dofs(space.dofmap)[0]
    matrix = compat.assemble_matrix(mass)
    np.testing.assert_allclose(matrix.getValues(table, table), cube, rtol=1e-13)
    factor.value = 3.0
    assert compat.assemble_matrix(mass, matrix) is matrix
    np.testing.assert_allclose(matrix.getValues(table, table), 3 * cube, rtol=1e-13)
    np.testing.assert_allclose(compat.assemble_vector(compat.form(v * ufl.dx)), np.full(8, 1 / 8), rtol=1e-13)


@pytest.mark.parametrize(("cell", "degree"), [("tetrahedron", 2), ("hexahedron", 1)])
def test_a_form_has_one_name_whatever_was_compiled_before_it(tmp_path, monkeypatch, cell, degree):
    """Else a process compiles anew what another one has put into the cache."""
    monkeypatch.setattr(compat, "FORMS", tmp_path)
    mesh = one_cell(cell, degree)

    def name():
        return (ufl.SpatialCoordinate(mesh)[0] * ufl.dx(domain=mesh)).signature()

    before = name()
    compat.form(compat.constant(mesh, 1.0) * ufl.dx(domain=mesh))
    assert len(list(tmp_path.glob("libffcx_forms_*.cached"))) == 1
    assert name() == before
