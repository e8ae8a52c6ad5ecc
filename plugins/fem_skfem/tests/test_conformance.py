from porocore.testing import MeshedCellSuite
from porocore_fem_skfem.cell_solver import SkfemCellSolver


class TestSkfemCellSolver(MeshedCellSuite):
    kit_version = "1"

    @classmethod
    def make_solver(cls):
        return SkfemCellSolver()
