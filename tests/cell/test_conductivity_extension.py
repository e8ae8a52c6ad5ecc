"""The fluid's mesh follows the solid's wall: exactly for affine fields, and without folding."""

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.conductivity.extension import HarmonicExtension, wall_interpolation
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.geometry.spheres import SpherePores
from porocore.cell.level_sets.tpms import TriplyPeriodic
from porocore.cell.meshing.mesh import MeshSettings
from porocore.cell.meshing.tetrahedra import volumes
from porocore.errors import PorocoreError

A = np.array([[0.3, 0.1, -0.2], [0.0, -0.1, 0.4], [0.2, 0.5, 0.1]])


def meshes(geometry, element, domain):
    cell = Cell(geometry=geometry, mesh=MeshSettings(size=0.3, fluid_size=0.17, element=element))
    return cell.make_mesh("solid", domain), cell.make_mesh("fluid", domain).quadratic


@pytest.mark.parametrize("element", ["linear", "quadratic-straight", "quadratic-curved"])
def test_the_wall_is_exact_for_affine_fields(element):
    solid, fluid = meshes(OrthogonalChannels(radius=0.25), element, "eighth")
    wall = wall_interpolation(solid, fluid)
    nodes, matrix = wall.nodes, wall.matrix
    assert set(nodes) == set(np.unique(fluid.wall))
    np.testing.assert_allclose(matrix @ (solid.points @ A.T), fluid.points[nodes] @ A.T, atol=1e-12)


@pytest.mark.parametrize(
    "geometry",
    [
        OrthogonalChannels(radius=0.25),
        SpherePores(kind="sphere-pores", radius=0.38, lattice="cubic", throat=0.15),
        TriplyPeriodic(kind="tpms", surface="gyroid", void_fraction=0.5),
    ],
    ids=["channels", "spheres", "surface"],
)
def test_the_wall_of_the_whole_cell_is_periodic_and_near_a_smooth_field(geometry):
    solid, fluid = meshes(geometry, "quadratic-curved", "whole")
    wall = wall_interpolation(solid, fluid)
    nodes, matrix = wall.nodes, wall.matrix
    images = fluid.periodic_class[nodes]

    def smooth(points):
        return np.sin(2 * np.pi * points[:, [1, 2, 0]]) + np.cos(2 * np.pi * points)

    found = matrix @ smooth(solid.points)
    for k in range(3):
        values = np.bincount(images, found[:, k]) / np.maximum(np.bincount(images), 1)
        np.testing.assert_allclose(found[:, k], values[images], atol=1e-12)
    error = np.abs(found - smooth(fluid.points[nodes]))
    assert np.sqrt((error**2).mean()) < 0.05
    assert error.max() < 0.4


@pytest.mark.parametrize("domain", ["eighth", "whole"])
def test_the_extension_keeps_planes_wall_and_periodicity(domain):
    solid, fluid = meshes(OrthogonalChannels(radius=0.25), "quadratic-curved", domain)
    X = solid.points
    u = 0.02 * np.sin(2 * np.pi * X) * (1 + np.cos(2 * np.pi * X[:, [1, 2, 0]]))
    moved = HarmonicExtension(solid, fluid)(u)
    for plane in (-0.5, 0.0, 0.5):
        for axis in range(3):
            assert np.abs(moved[fluid.points[:, axis] == plane, axis]).max(initial=0) < 1e-12
    wall = wall_interpolation(solid, fluid)
    nodes, matrix = wall.nodes, wall.matrix
    expected = matrix @ u
    if domain == "eighth":
        expected[np.isin(fluid.points[nodes], (0.0, 0.5))] = 0.0
    np.testing.assert_allclose(moved[nodes], expected, atol=1e-15)
    images = fluid.periodic_class
    first = np.unique(images, return_index=True)[1]
    np.testing.assert_allclose(moved, moved[first][images], atol=1e-12)
    assert (np.abs(moved).max(axis=0) <= np.abs(moved[nodes]).max(axis=0) + 1e-12).all()


def test_eighth_and_whole_are_the_same_field():
    found = []
    for domain in ("eighth", "whole"):
        solid, fluid = meshes(OrthogonalChannels(radius=0.25), "quadratic-curved", domain)
        u = 0.02 * np.sin(2 * np.pi * solid.points) * (1 + np.cos(2 * np.pi * solid.points[:, [1, 2, 0]]))
        inside = (fluid.points >= 0).all(axis=1)
        order = np.lexsort(fluid.points[inside].round(9).T)
        found.append(HarmonicExtension(solid, fluid)(u)[inside][order])
    np.testing.assert_allclose(*found, atol=1e-12)


def test_a_wall_that_goes_far_takes_the_inside_along():
    """The channels widen to twice their radius: no element is turned inside out."""
    solid, fluid = meshes(OrthogonalChannels(radius=0.15, axes="x"), "quadratic-curved", "eighth")
    r = np.maximum(np.hypot(*solid.points[:, 1:].T), 1e-3)
    outward = np.column_stack([0 * r, *(solid.points[:, 1:] / r[:, None]).T])
    moved = HarmonicExtension(solid, fluid)(outward * (0.15 * np.maximum(1 - (r - 0.15) / 0.35, 0))[:, None])
    assert volumes(fluid.points + moved, fluid.cells).min() > 1.5 * volumes(fluid.points, fluid.cells).min()


def test_walls_that_do_not_belong_together_are_refused():
    solid, _ = meshes(OrthogonalChannels(radius=0.1, axes="x"), "linear", "eighth")
    _, fluid = meshes(OrthogonalChannels(radius=0.3, axes="z"), "linear", "eighth")
    with pytest.raises(PorocoreError, match="needs the same pore wall in the meshes of solid and fluid"):
        wall_interpolation(solid, fluid)
