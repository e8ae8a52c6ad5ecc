"""Test classes that hold this plugin's cell and macro solver to the checks of the conformance kit."""

from __future__ import annotations

from typing import Any

from porocore.testing import CellContactSuite, MacroSolverSuite, MeshedCellSuite
from porocore_fem_skfem.cell_solver import SkfemCellSolver
from porocore_fem_skfem.macro import SkfemMacroSolver


class _CellSolver:
    kit_version = "5"

    @classmethod
    def make_solver(cls) -> SkfemCellSolver:
        return SkfemCellSolver()


class TestSkfemCellSolver(_CellSolver, MeshedCellSuite):
    """Checks of cells with any pore geometry."""


class TestSkfemCellContact(_CellSolver, CellContactSuite):
    """Checks of cells whose pore surface touches itself."""


class TestSkfemMacroSolver(MacroSolverSuite):
    """Checks of bodies of any shape."""

    kit_version = "5"

    @classmethod
    def make_solver(cls, **options: Any) -> SkfemMacroSolver:
        return SkfemMacroSolver(**options)
