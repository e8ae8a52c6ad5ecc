"""The checks of this plugin for pytest; 'porocore plugin check' runs the same checks."""

from porocore_cell_layered.conformance import TestLayeredCellSolver

__all__ = ["TestLayeredCellSolver"]
