from porocore.testing import CellContactSuite
from porocore_fem_dolfinx.cell_solver import DolfinxCellSolver


class TestDolfinxCellContact(CellContactSuite):
    kit_version = "1"

    @classmethod
    def make_solver(cls):
        return DolfinxCellSolver()
