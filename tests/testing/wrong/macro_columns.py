"""Macro solvers with a mesh of their own that break one law each, made of the column of finite volumes."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from porocore.testing import MacroSolverSuite
from tests.helpers.partial.column import ColumnMacroSolver


class _Law(MacroSolverSuite):
    kit_version = "5"
    caught_by: ClassVar[str]
    solver: ClassVar[type[ColumnMacroSolver]] = ColumnMacroSolver

    @classmethod
    def make_solver(cls, **options):
        return cls.solver(**options)


class TestPromisesTooMuch(_Law):
    """It declares an accuracy that it does not reach."""

    caught_by = "test_prescribed_inflow_ends_in_a_linear_pressure"

    class solver(ColumnMacroSolver):
        accuracy = 1e-5


class TestForgetsTheDrain(_Law):
    """Its pressures are a tenth too large, beyond what it declares."""

    caught_by = "test_prescribed_pressure_scales_with_the_load"

    class solver(ColumnMacroSolver):
        def solve(self, prepared, law, **how):
            found = super().solve(prepared, law, **how)
            return replace(found, profiles=tuple(replace(p, p=1.1 * p.p) for p in found.profiles))
