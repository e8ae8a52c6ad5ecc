from porocore_fem_dolfinx.conformance import TestDolfinxCellContact

__all__ = ["TestDolfinxCellContact"]
