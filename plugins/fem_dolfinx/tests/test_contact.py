from porocore.testing.cell_contact import CellContactConformance
from porocore_fem_dolfinx.cell_solver import DolfinxCellSolver


class TestDolfinxCellContact(CellContactConformance):
    @classmethod
    def make_solver(cls):
        return DolfinxCellSolver()
