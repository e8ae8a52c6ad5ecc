"""Cells whose pores stay open: no image and no minimal surface is an overlap under a strain of one percent."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from porocore.cell.cell import Cell
from porocore.cell.level_sets.tpms import TriplyPeriodic
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.meshing.mesh import MeshSettings
from porocore.states import Status
from porocore.testing.cell_checks.base import image_cell
from porocore_fem_skfem.cell_solver import SkfemCellSolver

SURFACES = [
    {"surface": surface, "solid": solid, "void_fraction": 0.3}
    for surface in ("gyroid", "diamond", "schwarz-p")
    for solid in ("network", "sheet")
]


def status(geometry, size, axis):
    cell = Cell(geometry=geometry, mesh=MeshSettings(size=size))
    solver = SkfemCellSolver()
    H = -0.01 * np.diag(np.eye(3)[axis])
    return Status(int(solver.solve_one(solver.prepare(cell), H, tangent=False).status[0]))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(14))
def test_images_stay_open(tmp_path, seed):
    geometry = image_cell(tmp_path / "image.npy", seed, 16)
    assert status(geometry, (0.2, 0.15)[seed % 2], seed % 3).has_values


@pytest.mark.slow
@pytest.mark.parametrize("keys", SURFACES, ids=lambda keys: f"{keys['surface']}-{keys['solid']}")
def test_minimal_surfaces_stay_open(keys):
    # A coarser mesh of the gyroid's sheet is refused.
    size = 0.15 if keys["solid"] == "sheet" else 0.2
    assert status(TriplyPeriodic(kind="tpms", **keys), size, 0).has_values


@pytest.mark.slow
def test_an_image_whose_faces_did_not_match_stays_open(tmp_path):
    """Nodes between corners on its faces had followed the wall on one side only, so the walls crossed there."""
    values = gaussian_filter(np.random.default_rng(4).normal(size=(64,) * 3), 3.5, mode="wrap")
    np.save(tmp_path / "image.npy", (values < np.median(values)).astype(np.uint8))
    geometry = Voxels(kind="voxels", path=str(tmp_path / "image.npy"), pore=1, repeat="periodic")
    assert status(geometry, 0.12, 0).has_values
