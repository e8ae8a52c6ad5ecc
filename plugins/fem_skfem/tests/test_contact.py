from porocore.testing import CellContactSuite
from porocore_fem_skfem.cell_solver import SkfemCellSolver


class TestSkfemCellContact(CellContactSuite):
    kit_version = "1"

    @classmethod
    def make_solver(cls):
        return SkfemCellSolver()
