from porocore.testing.cell import CellSolverConformance
from porocore_fem_dolfinx.cell_solver import DolfinxCellSolver


class TestDolfinxCellSolver(CellSolverConformance):
    @classmethod
    def make_solver(cls):
        return DolfinxCellSolver()
