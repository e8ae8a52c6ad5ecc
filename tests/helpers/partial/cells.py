"""A cell solver of the solid alone: no conductivity, no contact, no fields and no mesh of the core's."""

from __future__ import annotations

import sys
from pathlib import Path

from porocore.interfaces.cell import CellSolver
from porocore.testing import CellSolverSuite

sys.path.insert(0, str(Path(__file__).parents[3] / "examples/plugins/porocore-cell-layered"))
import porocore_cell_layered.conformance as layered
from porocore_cell_layered.cell_solver import LayeredCellSolver


class SolidCellSolver(CellSolver):
    """Plane layers of solid, whatever flows between them."""

    conductivities = ()

    def __init__(self, **options):
        super().__init__(**options)
        self.layers = LayeredCellSolver()

    def prepare(self, cell):
        return self.layers.prepare(cell)

    def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
        return self.layers.solve(prepared, states, tangent=tangent)


class TestSolid(CellSolverSuite):
    kit_version = "5"

    @classmethod
    def make_solver(cls):
        return SolidCellSolver()

    @classmethod
    def make_cell(cls, **others):
        return layered.TestLayeredCellSolver.make_cell(**others)
