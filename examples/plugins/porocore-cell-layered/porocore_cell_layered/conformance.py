"""The checks of every cell solver, for this one."""

from importlib.resources import as_file, files

from porocore import Cell
from porocore.testing import CellSolverSuite
from porocore_cell_layered.cell_solver import LayeredCellSolver


class TestLayeredCellSolver(CellSolverSuite):
    kit_version = "5"

    @classmethod
    def make_solver(cls):
        return LayeredCellSolver()

    @classmethod
    def make_cell(cls, **others):
        """An image of 8³ voxels: one layer of fluid, three voxels thick, across z."""
        with as_file(files("porocore_cell_layered") / "layers.npy") as image:
            geometry = {"kind": "voxels", "path": str(image), "repeat": "periodic", "smoothing": 0.0}
            return Cell(geometry=geometry, **{"mesh": cls.mesh, **others})
