"""Cells that are boxes: a cell repeated along an axis, or the half of one that repeats, answers like the cube."""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from porocore.cell.cell import Cell
from porocore.cell.contact.wall_contact import ContactModel
from porocore.cell.geometry.pore_geometry import CUBE, unit_sides
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.connectivity import pieces, why_disconnected
from porocore.cell.meshing.mesh import MeshSettings, block, tiled
from porocore.cell.meshing.mesh_file import MeshFile
from porocore.cell.meshing.tetrahedra import volume
from porocore.cell.quality import measure_mesh_quality, quality_lines, unmatched
from porocore.commands.fields.points import PointFields
from porocore.errors import ConfigurationError
from porocore.states import MacroState
from porocore.testing.cell_checks.base import noise

GENERAL = MacroState.single(np.array([[0.02, 0.03, 0.0], [-0.01, -0.04, 0.02], [0.01, 0.0, 0.01]]), 0.05)
RESPONSES = ("mean_grad", "potential", "stress", "fluid_volume")
TANGENTS = tuple(f"{name}_{by}" for name in ("mean_grad", "stress", "fluid_volume") for by in ("grad_u", "p"))


def skfem():
    return pytest.importorskip("porocore_fem_skfem.cell_solver").SkfemCellSolver()


def dolfinx():
    if find_spec("dolfinx") is None:
        pytest.skip("dolfinx is not installed")
    return pytest.importorskip("porocore_fem_dolfinx.cell_solver").DolfinxCellSolver()


def image(path, values, **keys):
    np.save(path, values)
    return Voxels(kind="voxels", path=str(path), **{"pore": 1, "repeat": "periodic", **keys})


def cell(geometry, size=0.25, element="linear", voxels=12, **keys):
    """A cell with elements of one size in edges of that many voxels, whatever the cube root of its volume is."""
    edge = np.prod(np.array(geometry.solid.shape) / voxels) ** (1 / 3)
    mesh = MeshSettings(size=size / edge, fluid_size=size / edge, element=element)
    return Cell(geometry=geometry, mesh=mesh, **keys)


def repeated(path, described, periods):
    """The cell of the same tetrahedra, repeated along the axes and written to a file."""
    meshio = pytest.importorskip("meshio")
    meshes = [block(described.make_mesh(phase, "whole"), periods) for phase in ("solid", "fluid")]
    points = np.concatenate([mesh.points for mesh in meshes])
    cells = np.concatenate([meshes[0].cells, meshes[1].cells + len(meshes[0].points)])
    points, number = np.unique(points, axis=0, return_inverse=True)
    tags = np.repeat([1, 2], [len(mesh.cells) for mesh in meshes])
    kind = {4: "tetra", 10: "tetra10"}[cells.shape[1]]
    written = meshio.Mesh(3 * points, [(kind, number.reshape(-1)[cells])], cell_data={"phase": [tags]})
    meshio.write(path, written)
    geometry = MeshFile(kind="mesh-file", path=str(path), solid=(1,), fluid=(2,))
    return described.model_copy(update={"geometry": geometry})


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    """Noise of 12³ voxels."""
    return image(tmp_path_factory.mktemp("images") / "one.npy", noise(3, 12, 1.5))


@pytest.fixture(scope="module")
def two(tmp_path_factory, one):
    """The same twice along z."""
    return image(tmp_path_factory.mktemp("images") / "two.npy", np.tile(~one.solid, (1, 1, 2)))


def same(one, two, names, within):
    for name in names:
        a, b = (getattr(r.tangent if name in TANGENTS else r, name) for r in (one, two))
        assert np.isfinite(a).all()
        np.testing.assert_allclose(b, a, atol=within * np.abs(a).max(), err_msg=name)


def test_sides_have_the_volume_one_and_exact_multiples():
    assert unit_sides((3.0, 3.0, 3.0)) == CUBE
    sides = unit_sides((16, 16, 32))
    assert np.prod(sides) == pytest.approx(1, abs=1e-11)
    np.testing.assert_allclose(sides, 2.0 ** np.array([-1 / 3, -1 / 3, 2 / 3]), rtol=1e-12)
    for side in sides:
        assert [k * side - side / 2 for k in range(1, 9)] == [(k - 1) * side + side / 2 for k in range(1, 9)]


def test_the_edge_of_the_cell_is_told_in_the_unit_of_the_mesh_file(tmp_path, one):
    periods = (2, 1, 3)
    (note,) = repeated(tmp_path / "box.vtu", cell(one), periods).geometry.notes
    edges = np.array([float(edge) for edge in note.split(" is ")[1].split(" in the unit")[0].split(" x ")])
    assert edges / edges[1] == pytest.approx(periods, rel=1e-5)
    assert note.endswith(f"is {np.prod(edges) ** (1 / 3):.6g} of this unit")


def test_a_box_has_faces_that_match_and_the_volume_one(two):
    described = cell(two, element="quadratic-curved")
    meshes = [described.make_mesh(phase, "whole") for phase in ("solid", "fluid")]
    assert unmatched(meshes) == 0
    assert sum(volume(mesh.points, mesh.cells) for mesh in meshes) == pytest.approx(1, abs=1e-10)
    for mesh in meshes:
        assert mesh.sides == two.sides
        np.testing.assert_array_equal(mesh.points.max(axis=0), np.array(two.sides) / 2)
    assert why_disconnected(pieces(meshes[0])) == ""
    solid = meshes[0]
    many = block(solid, (2, 1, 3))
    assert many.periodic_class.max() + 1 == 6 * (solid.periodic_class.max() + 1)
    assert len(many.wall) == 6 * len(solid.wall)
    text = "\n".join(quality_lines(measure_mesh_quality(described)))
    assert "image two.npy of 12 × 12 × 24 voxels, periodic" in text
    assert "sides: 0.7937, 0.7937, 1.587 along x, y, z" in text
    assert "every facet has its partner" in text


@pytest.mark.parametrize("make_solver", [skfem, dolfinx])
def test_a_cell_repeated_along_an_axis_answers_like_the_cell(one, tmp_path, make_solver):
    """K is in units of the squared edge, which is larger by the cube root of two."""
    solver, single = make_solver(), cell(one)
    double = repeated(tmp_path / "two.vtu", single, (1, 1, 2))
    np.testing.assert_allclose(double.geometry.sides, unit_sides((1, 1, 2)), rtol=1e-9)
    prepared = [solver.prepare(some) for some in (single, double)]
    same(*(solver.solve(some, GENERAL).response for some in prepared), RESPONSES + TANGENTS, 1e-8)
    a, b = (solver.conductivity(some) for some in prepared)
    np.testing.assert_allclose(b * 4 ** (1 / 3), a, atol=1e-8 * a.max())
    fluid = single.make_mesh("fluid", "whole")
    assert double.geometry.porosity == pytest.approx(volume(fluid.points, fluid.cells), abs=1e-9)


@pytest.mark.slow
def test_an_image_that_repeats_answers_like_its_period(one, two):
    """The meshes differ beside the faces of the box."""
    solver = skfem()
    prepared = [solver.prepare(cell(some, 0.125, "quadratic-curved")) for some in (one, two)]
    a, b = (solver.solve(some, GENERAL, tangent=False).response for some in prepared)
    same(a, b, RESPONSES, 3e-3)
    a, b = (solver.conductivity(some) for some in prepared)
    np.testing.assert_allclose(b * 4 ** (1 / 3), a, atol=2e-2 * a.max())
    assert two.porosity == pytest.approx(one.porosity, abs=1e-12)


def test_the_flow_through_a_deformed_box_is_that_through_the_cell(one, tmp_path):
    solver, single = skfem(), cell(one)
    double = repeated(tmp_path / "two.vtu", single, (2, 1, 1))
    prepared = [solver.prepare(some, deformed=True) for some in (single, double)]
    a, b = (solver.solve(some, GENERAL, tangent=False).response.conductivity for some in prepared)
    np.testing.assert_allclose(b * 4 ** (1 / 3), a, atol=1e-7 * np.abs(a).max())


def test_a_flat_box_answers_like_its_repetitions(tmp_path):
    """Half of a cube that repeats: the cube, a supercell of two halves, and averages over the fields of all three."""
    values = gaussian_filter(np.random.default_rng(1).normal(size=(12, 12, 6)), 1.2, mode="wrap")
    flat = cell(image(tmp_path / "half.npy", values < np.quantile(values, 0.4)))
    cells = [
        flat,
        repeated(tmp_path / "cube.vtu", flat, (1, 1, 2)),
        flat.model_copy(update={"supercell": (1, 1, 2)}),
    ]
    assert cells[1].geometry.sides == CUBE
    solver = skfem()
    solutions = [solver.solve(solver.prepare(some), GENERAL, tangent=False, fields=True) for some in cells]
    for described, found in zip(cells, solutions, strict=True):
        same(solutions[0].response, found.response, RESPONSES, 1e-8)
        points = PointFields.from_cell_field(described, found.fields[0])
        np.testing.assert_allclose(points.mean(points.grad), found.response.mean_grad[0], atol=1e-12)


def slit(n, m, k):
    """The eighth of a cell with a slit that closes under compression along x, and channels along y and z."""
    x, y, z = np.indices((n, m, k))
    return ((x < 2) & (y < m - 3) & (z < k - 3)) | ((x < 3) & (y < 3)) | ((x < 3) & (z < 3))


@pytest.mark.parametrize("make_solver", [skfem, dolfinx])
def test_the_eighth_of_a_box_answers_like_the_whole(tmp_path, make_solver):
    geometry, solver = image(tmp_path / "eighth.npy", slit(6, 9, 12), repeat="mirror"), make_solver()
    state = MacroState.single(np.diag([-0.03, 0.02, 0.01]), 0.02)
    cells = [cell(geometry, 0.2, symmetry=symmetry) for symmetry in ("auto", "none")]
    prepared = [solver.prepare(some) for some in cells]
    solutions = [solver.solve(some, state, fields=True) for some in prepared]
    assert [solution.fields[0].domain for solution in solutions] == ["eighth", "whole"]
    same(*(solution.response for solution in solutions), RESPONSES + TANGENTS, 1e-8)
    K, whole = (solver.conductivity(some) for some in prepared)
    np.testing.assert_allclose(K, whole, atol=1e-9 * K.max())
    for described, found in zip(cells, solutions, strict=True):
        points = PointFields.from_cell_field(described, found.fields[0])
        np.testing.assert_allclose(points.mean(points.grad), found.response.mean_grad[0], atol=1e-12)


def test_walls_of_a_box_touch_like_those_of_its_period():
    """A cell pushed together, and the same twice along z, with the lengths that make its volume one."""
    single = Cell(mesh=MeshSettings(size=0.3, element="linear")).make_mesh("solid", "whole")
    H = np.diag([0.0, -0.75, 0.0])
    X, u = single.points, np.zeros_like(single.points)
    u[:, 1] = -0.16 * np.sin(2 * np.pi * X[:, 1]) * np.cos(np.pi * X[:, 0]) ** 2
    edge = 2 ** (-1 / 3)
    joined, sides = block(single, (1, 1, 2)), unit_sides((1, 1, 2))
    middle = (joined.low + joined.high) / 2
    points = (joined.points - middle) / joined.spans * sides
    points = np.where(joined.points == joined.low, np.array(sides) / -2, points)
    points = np.where(joined.points == joined.high, np.array(sides) / 2, points)
    double = replace(joined, points=points, periods=(1, 1, 1), sides=sides)
    one = ContactModel(single, 40.0, deepest=0.05).at(H, u)
    two = ContactModel(double, 40.0 / edge, deepest=0.05 * edge).at(H, tiled(single, u, (1, 1, 2)) * edge)
    assert one.active
    assert two.depth == pytest.approx(one.depth * edge, rel=1e-9)
    assert two.forces.energy == pytest.approx(one.forces.energy, rel=1e-9)
    scale = np.abs(one.forces.by_load).max()
    np.testing.assert_allclose(two.forces.by_load, one.forces.by_load, atol=1e-8 * scale)
    a, b = (state.blocks("").second(GENERAL.grad_u[0], GENERAL.grad_u[0]) for state in (one, two))
    assert b == pytest.approx(a, rel=1e-8)


def test_a_box_that_is_too_flat_for_its_elements_is_refused(tmp_path):
    x = np.indices((4, 8, 8))[1]
    flat = image(tmp_path / "flat.npy", x < 4, voxel_size=(1e-6, 6e-5, 6e-5))
    with pytest.raises(ConfigurationError, match=r"its box is too flat: about .* tetrahedra would be made"):
        Cell(geometry=flat, mesh=MeshSettings(size=0.1)).make_mesh("solid", "whole")


def test_the_point_group_of_a_box_keeps_its_sides(tmp_path):
    z = np.indices((8, 8, 16))[2]
    layers = z % 8 < 4
    assert image(tmp_path / "a.npy", layers).point_group.name == "4/mmm"
    assert image(tmp_path / "b.npy", np.indices((8, 10, 16))[2] < 8).point_group.name == "mmm"
    # Layers along x are those along y after a quarter turn, but the box is none.
    x, y, _ = np.indices((8, 16, 8))
    checked = (x // 4 + y // 4) % 2 == 0
    assert image(tmp_path / "c.npy", checked).point_group.name == "mmm"
    cubes = image(tmp_path / "d.npy", checked[:, :8])
    assert cubes.point_group.name == "4/mmm"
    oblong = image(tmp_path / "d.npy", checked[:, :8], voxel_size=(1e-5, 2e-5, 1e-5))
    assert oblong.point_group.name == "mmm"
