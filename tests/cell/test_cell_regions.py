"""Parts of a phase that may differ in material: carried through unfolding, supercells and further nodes."""

from dataclasses import replace

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import CellMesh, MeshSettings, block
from porocore.cell.symmetry import exchanged_axes

LINEAR = Cell(mesh=MeshSettings(size=0.3, fluid_size=0.3, element="linear"))


def halves(mesh):
    """Two regions by the height of the elements' centres."""
    high = mesh.points[mesh.cells[:, :4]].mean(axis=1)[:, 2] > 0.2
    return replace(mesh, regions=high.astype(np.int64), region_names=("low", "high"))


def test_one_region_named_like_the_phase_where_none_are_given():
    for phase in ("solid", "fluid"):
        mesh = LINEAR.make_mesh(phase, "whole")
        assert mesh.region_names == (phase,)
        assert mesh.regions.shape == (len(mesh.cells),)
        assert not mesh.regions.any()


def test_regions_go_with_the_elements():
    mesh = halves(LINEAR.make_mesh("solid", "whole"))
    assert mesh.hash != replace(mesh, regions=1 - mesh.regions).hash
    assert (mesh.quadratic.regions == mesh.regions).all()
    tiled = block(mesh, (1, 2, 1))
    assert tiled.region_names == ("low", "high")
    centres = tiled.points[tiled.cells].mean(axis=1)
    assert ((centres[:, 2] > 0.2) == tiled.regions).all()
    assert 0 < tiled.regions.sum() < len(tiled.cells)


def test_axes_that_the_regions_tell_apart_are_not_exchanged():
    mesh = LINEAR.make_mesh("solid", "eighth")
    rest = np.zeros((3, 3)), np.zeros_like(mesh.points)
    assert exchanged_axes(mesh, *rest) == ("xy", "xz", "yz")
    assert exchanged_axes(halves(mesh), *rest) == ("xy",)


def test_regions_that_do_not_fit_the_elements_are_refused():
    mesh = LINEAR.make_mesh("solid", "eighth")
    for regions in (np.zeros(3, dtype=np.int64), np.full(len(mesh.cells), 2)):
        with pytest.raises(ValueError, match="regions: expected"):
            CellMesh("solid", "eighth", mesh.points, mesh.cells, regions=regions, region_names=("a", "b"))
