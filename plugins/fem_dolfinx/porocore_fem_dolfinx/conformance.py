"""Test classes that hold this plugin's cell and macro solver to the checks of the conformance kit."""

from __future__ import annotations

from typing import Any

from porocore.testing import CellContactSuite, MacroSolverSuite, MeshedCellSuite
from porocore_fem_dolfinx.cell_solver import DolfinxCellSolver
from porocore_fem_dolfinx.macro import DolfinxMacroSolver


class _CellSolver:
    kit_version = "5"

    @classmethod
    def make_solver(cls) -> DolfinxCellSolver:
        return DolfinxCellSolver()


class TestDolfinxCellSolver(_CellSolver, MeshedCellSuite):
    """Checks of cells with any pore geometry."""


class TestDolfinxCellContact(_CellSolver, CellContactSuite):
    """Checks of cells whose pore surface touches itself."""


class TestDolfinxMacroSolver(MacroSolverSuite):
    """Checks of bodies of any shape."""

    kit_version = "5"

    @classmethod
    def make_solver(cls, **options: Any) -> DolfinxMacroSolver:
        return DolfinxMacroSolver(**options)
