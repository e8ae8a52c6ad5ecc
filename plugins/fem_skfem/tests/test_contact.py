from porocore.testing.cell_contact import CellContactConformance
from porocore_fem_skfem.cell_solver import SkfemCellSolver


class TestSkfemCellContact(CellContactConformance):
    @classmethod
    def make_solver(cls):
        return SkfemCellSolver()
