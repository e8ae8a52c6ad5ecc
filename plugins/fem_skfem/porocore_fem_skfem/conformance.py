"""The laws that the solvers of this plugin are held to, by its tests and by ``porocore plugin check``."""

from __future__ import annotations

from typing import Any

from porocore.testing import CellContactSuite, MacroSolverSuite, MeshedCellSuite
from porocore_fem_skfem.cell_solver import SkfemCellSolver
from porocore_fem_skfem.macro import SkfemMacroSolver


class TestSkfemCellSolver(MeshedCellSuite):
    """Any pore geometry."""

    kit_version = "3"

    @classmethod
    def make_solver(cls) -> SkfemCellSolver:
        return SkfemCellSolver()


class TestSkfemCellContact(CellContactSuite):
    """Pore walls that touch themselves."""

    kit_version = "3"

    @classmethod
    def make_solver(cls) -> SkfemCellSolver:
        return SkfemCellSolver()


class TestSkfemMacroSolver(MacroSolverSuite):
    """Any body."""

    kit_version = "3"

    @classmethod
    def make_solver(cls, **options: Any) -> SkfemMacroSolver:
        return SkfemMacroSolver(**options)
