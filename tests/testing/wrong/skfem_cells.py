"""The cell solver on scikit-fem, whose answers can be altered."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import pytest

from porocore.interfaces.cell import CellSolution
from porocore.testing import CellContactSuite, MeshedCellSuite

SkfemCellSolver: Any = pytest.importorskip("porocore_fem_skfem.cell_solver").SkfemCellSolver


class Altered(SkfemCellSolver):
    """Answers what ``alter`` makes of the right response."""

    def alter(self, response, cell):
        return response

    def solve(self, prepared, states, *, start=None, tangent=True, fields=False):
        solution = super().solve(prepared, states, start=start, tangent=tangent, fields=fields)
        return CellSolution(self.alter(solution.response, prepared.cell), solution.fields)


def with_slopes(response, **changed):
    """With some derivatives replaced, where there are any."""
    if response.tangent is None:
        return response
    slopes = {name: change(getattr(response.tangent, name)) for name, change in changed.items()}
    return replace(response, tangent=replace(response.tangent, **slopes))


class _Skfem:
    kit_version = "5"
    caught_by: ClassVar[str]
    solver_class: ClassVar[type[Any]] = Altered

    @classmethod
    def make_solver(cls):
        return cls.solver_class()


class Meshed(_Skfem, MeshedCellSuite):
    """Of a solver of any geometry."""


class Contact(_Skfem, CellContactSuite):
    """Of a wall that touches itself."""
