from porocore_fem_dolfinx.conformance import TestDolfinxCellSolver

__all__ = ["TestDolfinxCellSolver"]
