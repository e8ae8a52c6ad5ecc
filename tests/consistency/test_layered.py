"""Finite elements against layers in closed form, by the example plugin that shares no discretisation with them."""

from __future__ import annotations

import sys
from itertools import product
from pathlib import Path

import meshio
import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.meshing.connectivity import pieces
from porocore.cell.meshing.mesh import CellMesh
from porocore.errors import ConfigurationError
from porocore.plugins.registry import registry
from porocore.states import MacroState, Status

PLUGIN = Path(__file__).parents[2] / "examples/plugins/porocore-cell-layered"
IMAGE = PLUGIN / "porocore_cell_layered/layers.npy"
#: Boundaries of the layers along y, and what each is.
HEIGHTS = (-0.5, -0.2, -0.1, 0.0, 0.1, 0.25, 0.5)
PARTS = ("soft", "fluid", "fluid", "fluid", "stiff", "soft")
SOFT = {"kind": "neo-hookean", "poisson_ratio": 0.35}
STIFF = {"kind": "mooney-rivlin", "c10": 0.4, "c01": 0.1, "bulk_modulus": 2.0}
STATES = {
    "squeezed": (np.diag([0.02, -0.08, 0.03]), 0.05),
    "sheared": (np.array([[0.03, 0.08, -0.02], [0.01, -0.06, 0.04], [0.0, 0.05, 0.02]]), 0.08),
}
KUHN = ((0, 1, 3, 7), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7), (0, 4, 5, 7), (0, 5, 1, 7))


@pytest.fixture
def layered(monkeypatch):
    """The class of the plugin."""
    monkeypatch.syspath_prepend(str(PLUGIN))
    from porocore_cell_layered.cell_solver import LayeredCellSolver

    yield LayeredCellSolver()
    for name in [name for name in sys.modules if name.startswith("porocore_cell_layered")]:
        del sys.modules[name]


def registry_lacks(backend: str) -> bool:
    return bool([o for o in registry().offers if o.offer.name == backend and o.missing])


def tetrahedra_of(parts: tuple[str, ...], across: int = 3) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Points, tetrahedra (``across`` × layers × ``across`` boxes of six) and the name of each."""
    n = across + 1
    x = np.linspace(-0.5, 0.5, n)
    points = np.array([(a, b, c) for c in x for b in HEIGHTS for a in x])
    tetrahedra, names = [], []
    for i, j, k in product(range(across), range(len(parts)), range(across)):
        corner = [
            (i + (b & 1)) + n * (j + (b >> 1 & 1)) + n * len(HEIGHTS) * (k + (b >> 2)) for b in range(8)
        ]
        tetrahedra += [[corner[b] for b in kuhn] for kuhn in KUHN]
        names += [parts[j]] * 6
    cells = np.array(tetrahedra)
    inverted = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0
    cells[inverted] = cells[inverted][:, [0, 2, 1, 3]]
    return points, cells, names


def with_fluid(tmp_path: Path, parts: tuple[str, ...], across: int = 3) -> Cell:
    """From a mesh file with the layers by name."""
    points, cells, names = tetrahedra_of(parts, across)
    known = sorted(set(parts))
    tags = [np.array([1 + known.index(name) for name in names])]
    mesh = meshio.Mesh(
        points,
        [("tetra", cells)],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={name: np.array([1 + n, 3]) for n, name in enumerate(known)},
    )
    path = tmp_path / "layers.msh"
    meshio.write(path, mesh, file_format="gmsh22")
    solid = [name for name in known if name != "fluid"]
    geometry = {"kind": "mesh-file", "path": str(path), "solid": solid, "fluid": ["fluid"]}
    return Cell(geometry=geometry, materials={"soft": SOFT, "stiff": STIFF}, viscosity=0.1)


def without_fluid(monkeypatch: pytest.MonkeyPatch, parts: tuple[str, ...]) -> Cell:
    """No geometry has several solids and no pores, so the mesh is handed in."""
    points, cells, names = tetrahedra_of(parts)
    known = tuple(sorted(set(parts)))
    regions = np.array([known.index(name) for name in names])
    mesh = CellMesh("solid", "whole", points, cells, regions=regions, region_names=known)
    monkeypatch.setattr(Cell, "make_mesh", lambda *_: mesh)
    return Cell(geometry={"kind": "no-pores"}, materials={"soft": SOFT, "stiff": STIFF}, symmetry="none")


@pytest.mark.parametrize("backend", ["skfem", "dolfinx"])
@pytest.mark.parametrize("name", STATES)
@pytest.mark.parametrize(
    "parts", [PARTS, ("soft", "soft", "stiff", "stiff", "stiff", "soft")], ids=["with fluid", "two solids"]
)
def test_all_responses_and_derivatives(layered, monkeypatch, tmp_path, parts, name, backend):
    """Linear displacements lie in the space of the elements, so that nothing but round-off is between the two."""
    if backend not in registry().names("cell solver") or registry_lacks(backend):
        pytest.skip(f"{backend} is not installed")
    cell = with_fluid(tmp_path, parts) if "fluid" in parts else without_fluid(monkeypatch, parts)
    # Layers with fluid between them give a body no stiffness, but their cell problem is well posed.
    monkeypatch.setattr(Cell, "disconnected", "")
    exact = layered.solve_one(layered.prepare(cell), *STATES[name])
    solver = registry().get("cell solver", backend)()
    prepared = solver.prepare(cell)
    found = solver.solve_one(prepared, *STATES[name])
    assert Status(int(found.status[0])) is Status(int(exact.status[0])) is Status.converged
    assert (np.abs(exact.mean_grad).max() > 1e-2) == ("fluid" in parts)
    for field in ("mean_grad", "potential", "stress", "fluid_volume"):
        np.testing.assert_allclose(getattr(found, field), getattr(exact, field), atol=1e-8, err_msg=field)
    for field, value in vars(exact.tangent).items():
        if value is not None:
            np.testing.assert_allclose(getattr(found.tangent, field), value, atol=1e-7, err_msg=field)


@pytest.mark.parametrize("backend", ["skfem", "dolfinx"])
def test_conductivity_of_a_layer_of_fluid(layered, backend):
    """h³/(12 μ) along it; the parabola across it lies in the space of the elements."""
    if backend not in registry().names("cell solver") or registry_lacks(backend):
        pytest.skip(f"{backend} is not installed")
    geometry = {"kind": "voxels", "path": str(IMAGE), "repeat": "periodic", "smoothing": 0.0}
    cell = Cell(geometry=geometry, viscosity=0.1, mesh={"size": 0.2, "fluid_size": 0.2})
    expected = layered.conductivity(layered.prepare(cell))
    np.testing.assert_allclose(expected, np.diag([1, 1, 0]) * 0.375**3 / 1.2, atol=1e-12)
    solver = registry().get("cell solver", backend)()
    np.testing.assert_allclose(solver.conductivity(solver.prepare(cell)), expected, atol=1e-8)


@pytest.mark.parametrize("backend", ["skfem", "dolfinx"])
def test_two_elements_along_a_period_are_enough(layered, monkeypatch, tmp_path, backend):
    """Facets of both halves then have corners of the same periodic classes, and are different facets all the same."""
    if backend not in registry().names("cell solver") or registry_lacks(backend):
        pytest.skip(f"{backend} is not installed")
    monkeypatch.setattr(Cell, "disconnected", "")
    cell = with_fluid(tmp_path, PARTS, across=2)
    solver = registry().get("cell solver", backend)()
    prepared = solver.prepare(cell)
    np.testing.assert_allclose(
        solver.conductivity(prepared), np.diag([1, 0, 1]) * 0.3**3 / 1.2, rtol=0, atol=1e-10
    )
    found, exact = (s.solve_one(s.prepare(cell), *STATES["sheared"]) for s in (solver, layered))
    np.testing.assert_allclose(found.stress, exact.stress, atol=1e-8)


@pytest.mark.parametrize("across", [1, 2, 3])
def test_the_wall_of_layers_is_known_on_any_mesh(tmp_path, across):
    """Two planes of squares, two facets each; nothing of the faces of the cell, through which both phases run on."""
    cell = with_fluid(tmp_path, PARTS, across)
    for phase in ("solid", "fluid"):
        mesh = cell.make_mesh(phase, "whole")
        corners = mesh.points[mesh.wall[:, :3]]
        assert len(corners) == 2 * 2 * across**2
        assert set(np.unique(corners[:, :, 1].round(12))) == {-0.2, 0.1}
        assert [(piece.rank, piece.axes) for piece in pieces(mesh)] == [(2, "xz")]


def test_what_is_no_laminate_is_refused(layered):
    with pytest.raises(ConfigurationError, match="layered solves plane layers across x, y or z only, got"):
        layered.prepare(Cell(mesh={"size": 0.3, "fluid_size": 0.3}))


def test_a_channel_that_is_cut_by_the_end_of_the_cell_goes_on_at_its_beginning(layered, tmp_path):
    """So that its conductivity is that of one thick layer, (0.3 + 0.25)³/12 μ."""
    cell = with_fluid(tmp_path, ("fluid", "stiff", "stiff", "soft", "soft", "fluid"))
    K = layered.conductivity(layered.prepare(cell))
    np.testing.assert_allclose(K, np.diag([1, 0, 1]) * 0.55**3 / 1.2, atol=1e-12)


def test_a_large_rotation_changes_nothing_but_turns_it(layered, tmp_path):
    """By 170°, where a straight path from rest would turn the cell inside out."""
    prepared = layered.prepare(with_fluid(tmp_path, PARTS))
    H, p = STATES["sheared"]
    c, s = np.cos(np.radians(170)), np.sin(np.radians(170))
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    before = layered.solve_one(prepared, H, p)
    after = layered.solve(prepared, MacroState.single(R @ (np.eye(3) + H) - np.eye(3), p)).response
    np.testing.assert_allclose(after.potential, before.potential, atol=1e-13)
    np.testing.assert_allclose(after.stress[0], R @ before.stress[0], atol=1e-12)
    np.testing.assert_allclose(after.mean_grad[0], R @ before.mean_grad[0], atol=1e-12)
