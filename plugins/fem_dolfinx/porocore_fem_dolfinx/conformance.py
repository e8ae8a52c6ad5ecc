"""The laws that the solvers of this plugin are held to, by its tests and by ``porocore plugin check``."""

from __future__ import annotations

from typing import Any

from porocore.testing import CellContactSuite, MacroSolverSuite, MeshedCellSuite
from porocore_fem_dolfinx.cell_solver import DolfinxCellSolver
from porocore_fem_dolfinx.macro import DolfinxMacroSolver


class TestDolfinxCellSolver(MeshedCellSuite):
    """Any pore geometry."""

    kit_version = "3"

    @classmethod
    def make_solver(cls) -> DolfinxCellSolver:
        return DolfinxCellSolver()


class TestDolfinxCellContact(CellContactSuite):
    """Pore walls that touch themselves."""

    kit_version = "3"

    @classmethod
    def make_solver(cls) -> DolfinxCellSolver:
        return DolfinxCellSolver()


class TestDolfinxMacroSolver(MacroSolverSuite):
    """Any body."""

    kit_version = "3"

    @classmethod
    def make_solver(cls, **options: Any) -> DolfinxMacroSolver:
        return DolfinxMacroSolver(**options)
