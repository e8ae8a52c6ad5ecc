"""Connectivity of a phase across the periodic cell, and solids that are not connected."""

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.equilibrium.solver import PreparedCell
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.geometry.spheres import SpherePores, Throat
from porocore.cell.level_sets.tpms import TriplyPeriodic
from porocore.cell.meshing.connectivity import blocked, joined_by_nodes, pieces, why_disconnected
from porocore.cell.meshing.mesh import MeshSettings, block, make_mesh
from porocore.cell.meshing.tetrahedra import volume
from porocore.errors import ConfigurationError

MESH = MeshSettings(size=0.25, fluid_size=0.25, element="linear")
OBLIQUE = SpherePores(
    kind="sphere-pores",
    centres=((0.1, 0.1, 0.1),),
    radius=0.3,
    throat=0.2,
    throats=(Throat(join=(0, 0), shift=(1, 1, 0)),),
)


def found(geometry, phase, settings=MESH):
    return pieces(make_mesh(geometry, settings, phase, "whole"))


@pytest.mark.parametrize(
    ("axes", "rank"), [("x", 1), ("y", 1), ("yz", 2), ("xyz", 3)], ids=["x", "y", "yz", "xyz"]
)
def test_channels_run_on_along_their_axes(axes, rank):
    geometry = OrthogonalChannels(axes=axes)
    (pore,) = found(geometry, "fluid")
    assert (pore.rank, pore.axes) == (rank, axes)
    assert blocked([pore]) == "".join(axis for axis in "xyz" if axis not in axes)
    (solid,) = found(geometry, "solid")
    assert (solid.rank, solid.axes) == (3, "xyz")
    mesh = make_mesh(geometry, MESH, "solid", "whole")
    assert solid.volume == pytest.approx(volume(mesh.points, mesh.cells))


def test_an_oblique_channel_has_one_direction_and_two_axes():
    (pore,) = found(OBLIQUE, "fluid")
    assert (pore.rank, pore.axes) == (1, "xy")


def test_closed_pores_and_a_solid_in_pieces():
    bcc = SpherePores(kind="sphere-pores", lattice="bcc", radius=0.3)
    closed = found(bcc, "fluid")
    assert [(piece.rank, piece.axes) for piece in closed] == [(0, ""), (0, "")]
    assert blocked(closed) == "xyz"
    assert why_disconnected(found(bcc, "solid")) == ""
    # The mirror image in the phases: two spheres of solid.
    assert why_disconnected(closed).startswith("it falls into 2 pieces that do not touch, of the volumes 0.")
    assert "of an image: 'drop_grains: true'" in why_disconnected(closed)
    assert "along x and y and z" in why_disconnected(closed[:1])


def test_the_labyrinths_of_a_sheet_are_two_pieces_that_run_through():
    sheet = TriplyPeriodic(kind="tpms", surface="gyroid", void_fraction=0.5, solid="sheet")
    labyrinths = found(sheet, "fluid", MeshSettings(size=0.15, fluid_size=0.15, element="linear"))
    assert [piece.rank for piece in labyrinths] == [3, 3]
    assert labyrinths[0].volume == pytest.approx(labyrinths[1].volume, rel=0.05)
    assert "falls into 2 pieces" in why_disconnected(labyrinths)


def test_a_block_of_cells_is_as_connected_as_one():
    tiled = block(make_mesh(OrthogonalChannels(axes="xy"), MESH, "fluid", "whole"), (1, 1, 2))
    assert [(piece.rank, piece.axes) for piece in pieces(tiled)] == [(2, "xy"), (2, "xy")]


def test_parts_that_share_a_pressure():
    bcc = SpherePores(kind="sphere-pores", lattice="bcc", radius=0.3)
    for domain in ("whole", "eighth"):
        mesh = make_mesh(bcc, MESH, "fluid", domain)
        part = joined_by_nodes(mesh)
        assert len(np.unique(part)) == 2
        near = np.linalg.norm(mesh.points, axis=1) < 0.35
        assert len(np.unique(part[near])) == 1
        assert len(np.unique(part[~near])) == 1


class Solver:
    """Of which nothing may be asked."""

    def solid(self, cell, mesh):
        raise AssertionError

    def flow(self, mesh):
        raise AssertionError


def test_a_floating_solid_is_refused():
    islands = TriplyPeriodic(kind="tpms", surface="schwarz-p", level=1.5)
    prepared = PreparedCell(Solver(), Cell(geometry=islands, mesh=MESH))
    with pytest.raises(
        ConfigurationError, match=r"no stiffness.*does not reach the next cell along x and y and z"
    ):
        prepared.solid_for(np.zeros((3, 3)))
