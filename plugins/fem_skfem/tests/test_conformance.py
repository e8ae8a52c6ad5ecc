from porocore_fem_skfem.conformance import TestSkfemCellSolver

__all__ = ["TestSkfemCellSolver"]
