"""pytest finds the laws where 'porocore plugin check' finds them too."""

from porocore_cell_layered.conformance import TestLayeredCellSolver

__all__ = ["TestLayeredCellSolver"]
