"""Points of a body: the element of each, exact interpolation on curved elements, gradients, deformed places."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from porocore.macro.body.mesh import TETRAHEDRON_EDGES, VTK_NODES, BodyMesh, box, rectangle, sector
from porocore.macro.body.points import LEEWAY, BodyPoints

NUMBERS = np.random.default_rng(0)
LINES = (np.linspace(0, 1.0, 3), np.linspace(0, 1.5, 4), np.linspace(0, 0.8, 3))


#: Six tetrahedra of a hexahedron by its corners.
PARTS = np.array([(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)])


def tetrahedral(mesh: BodyMesh) -> BodyMesh:
    """The mesh with each hexahedron cut into six tetrahedra, the middles of whose edges are its nodes."""
    place = {tuple(node): i for i, node in enumerate(VTK_NODES)}
    middles = [
        [place[tuple((VTK_NODES[part[i]] + VTK_NODES[part[j]]) // 2)] for i, j in TETRAHEDRON_EDGES]
        for part in PARTS
    ]
    of_one = np.hstack([PARTS, middles])
    return BodyMesh(mesh.points, np.concatenate([cell[of_one] for cell in mesh.cells]))


def curved(mesh: BodyMesh) -> BodyMesh:
    """The mesh with nodes that are moved by a smooth map, which makes its edges curved."""
    x, y, z = mesh.points.T
    bent = np.stack([x + 0.08 * y**2 + 0.03 * np.sin(2 * z), y + 0.06 * x * z, z - 0.05 * x**2 * y], axis=1)
    return replace(mesh, points=bent)


def bent_plane(mesh: BodyMesh) -> BodyMesh:
    """The mesh of a plane body with nodes that are moved within the plane."""
    x, y, z = mesh.points.T
    return replace(mesh, points=np.stack([x + 0.08 * y**2, y + 0.06 * x**2 * y, z], axis=1))


MESHES: dict[str, BodyMesh] = {
    "quadrilaterals": bent_plane(rectangle(LINES[:2])),
    "hexahedra": curved(box(LINES)),
    "tetrahedra": curved(tetrahedral(box(LINES))),
    "a sector": sector(1.0, 1.2, np.pi / 2, (2, 2, 2), 2.0),
}


@pytest.fixture(params=MESHES)
def mesh(request: Any) -> BodyMesh:
    return MESHES[request.param]


def drawn(mesh: BodyMesh, count: int = 200) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Elements, reference coordinates within them, and places."""
    cells = NUMBERS.integers(0, len(mesh.cells), count)
    local = NUMBERS.random((count, 3))
    local[:, mesh.element.dimension :] = 0.0
    if mesh.element.shape == "tetrahedron":
        local = np.sort(local, axis=1)
        local = np.stack([local[:, 0], local[:, 1] - local[:, 0], local[:, 2] - local[:, 1]], axis=1)
    places = np.einsum("na,nai->ni", mesh.element.values(local), mesh.points[mesh.cells[cells]])
    return cells, local, places


def test_places_are_found_in_their_elements(mesh: BodyMesh) -> None:
    cells, local, places = drawn(mesh)
    found = BodyPoints.at(mesh, places)
    assert found.inside.all()
    np.testing.assert_array_equal(found.cells, cells)
    np.testing.assert_allclose(found.local, local, atol=1e-9)


def test_fields_of_an_element_are_interpolated_exactly(mesh: BodyMesh) -> None:
    """Any quadratic function of the reference coordinates for u, any linear one for p, on curved elements."""
    cells, local, places = drawn(mesh, 60)
    found = BodyPoints.at(mesh, places)
    square, line = NUMBERS.normal(size=(3, 3, 3)), NUMBERS.normal(size=3)

    def quadratic(xi: np.ndarray) -> np.ndarray:
        return np.einsum("nj,ijk,nk->ni", xi, square, xi) + xi

    u = np.zeros((len(mesh.points), 3))
    p = np.zeros(len(mesh.p_nodes))
    for k, cell in enumerate(cells):
        nodes = mesh.element.nodes
        u[mesh.cells[cell]] = quadratic(nodes)
        p[mesh.p_cells[cell]] = nodes[: mesh.element.corners] @ line + 1
        here = found[[k]]
        np.testing.assert_allclose(here.displacement(u), quadratic(local[[k]]), atol=1e-9)
        np.testing.assert_allclose(here.pressure(p), local[[k]] @ line + 1, atol=1e-9)


def test_gradients_are_limits_of_differences(mesh: BodyMesh) -> None:
    _, _, places = drawn(mesh, 50)
    u, p = NUMBERS.normal(size=mesh.points.shape), NUMBERS.normal(size=len(mesh.p_nodes))
    found, step = BodyPoints.at(mesh, places), 1e-6
    for axis in range(mesh.element.dimension):
        ends = [BodyPoints.at(mesh, places + s * step * np.eye(3)[axis]) for s in (1, -1)]
        same = (ends[0].cells == found.cells) & (ends[1].cells == found.cells)
        assert same.sum() > 40
        by_u = (ends[0].displacement(u) - ends[1].displacement(u)) / (2 * step)
        by_p = (ends[0].pressure(p) - ends[1].pressure(p)) / (2 * step)
        np.testing.assert_allclose(found.displacement_gradient(u)[same, :, axis], by_u[same], atol=1e-5)
        np.testing.assert_allclose(found.pressure_gradient(p)[same, axis], by_p[same], atol=1e-5)


def test_rows_are_the_derivatives_of_what_is_interpolated(mesh: BodyMesh) -> None:
    _, _, places = drawn(mesh, 30)
    found = BodyPoints.at(mesh, places)
    u, p = NUMBERS.normal(size=mesh.points.shape), NUMBERS.normal(size=len(mesh.p_nodes))
    of_u, of_p = NUMBERS.normal(size=(30, 3)), NUMBERS.normal(size=30)
    wanted = np.einsum("ni,ni->n", of_u, found.displacement(u)) + of_p * found.pressure(p)
    np.testing.assert_allclose(found.rows(of_u, of_p) @ np.concatenate([u.ravel(), p]), wanted, atol=1e-12)


def test_places_of_a_deformed_body_are_those_of_its_particles(mesh: BodyMesh) -> None:
    cells, local, places = drawn(mesh)
    u = 0.1 * places.max() * np.sin(mesh.points @ NUMBERS.normal(size=(3, 3)))
    u[:, mesh.element.dimension :] = 0.0
    known = BodyPoints.at(mesh, places)
    for near in (None, known):
        found = BodyPoints.at(mesh, places + known.displacement(u), mesh.points + u, near)
        np.testing.assert_array_equal(found.cells, cells)
        np.testing.assert_allclose(found.local, local, atol=1e-8)


def test_places_outside_are_told_and_continued(mesh: BodyMesh) -> None:
    """A linear field goes on linearly beyond the body."""
    top = mesh.points[mesh.points[:, 1].argmax()]
    places = np.stack([mesh.points[mesh.cells[0]].mean(axis=0), top + np.array([0, 0.01, 0]), top + 1e3])
    found = BodyPoints.at(mesh, places)
    np.testing.assert_array_equal(found.inside, [True, False, False])
    assert LEEWAY < found.beyond[1] < 1
    np.testing.assert_allclose(found[:2].displacement(mesh.points), places[:2], atol=1e-9)
