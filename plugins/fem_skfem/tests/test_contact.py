from porocore_fem_skfem.conformance import TestSkfemCellContact

__all__ = ["TestSkfemCellContact"]
