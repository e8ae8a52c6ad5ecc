from porocore.testing.cell import CellSolverConformance
from porocore_fem_skfem.cell_solver import SkfemCellSolver


class TestSkfemCellSolver(CellSolverConformance):
    @classmethod
    def make_solver(cls):
        return SkfemCellSolver()
