"""Laws for the solvers of this plugin, in its tests and in ``porocore plugin check``."""

from __future__ import annotations

from typing import Any

from porocore.testing import CellContactSuite, MacroSolverSuite, MeshedCellSuite
from porocore_fem_skfem.cell_solver import SkfemCellSolver
from porocore_fem_skfem.macro import SkfemMacroSolver


class TestSkfemCellSolver(MeshedCellSuite):
    """Laws of cells with any pore geometry."""

    kit_version = "3"

    @classmethod
    def make_solver(cls) -> SkfemCellSolver:
        return SkfemCellSolver()


class TestSkfemCellContact(CellContactSuite):
    """Laws of cells whose pore surface touches itself."""

    kit_version = "3"

    @classmethod
    def make_solver(cls) -> SkfemCellSolver:
        return SkfemCellSolver()


class TestSkfemMacroSolver(MacroSolverSuite):
    """Laws of bodies of any shape."""

    kit_version = "3"

    @classmethod
    def make_solver(cls, **options: Any) -> SkfemMacroSolver:
        return SkfemMacroSolver(**options)
