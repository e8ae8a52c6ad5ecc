from porocore.testing import MeshedCellSuite
from porocore_fem_dolfinx.cell_solver import DolfinxCellSolver


class TestDolfinxCellSolver(MeshedCellSuite):
    kit_version = "1"

    @classmethod
    def make_solver(cls):
        return DolfinxCellSolver()
