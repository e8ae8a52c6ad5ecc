"""What the conformance suites of cell solvers share: the solver under test, and a cell that it has prepared."""

from __future__ import annotations

from typing import Any

import pytest

from porocore.cell.cell import Cell
from porocore.cell.mesh import MeshSettings
from porocore.interfaces.cell import CellSolver
from porocore.testing.suite import Suite


class CellSuite(Suite):
    """Subclass a suite, name the class ``Test…`` and give it ``make_solver``."""

    #: Kept coarse; what is tested here holds on every mesh.
    mesh = MeshSettings(size=0.2, fluid_size=0.14)

    @classmethod
    def make_solver(cls) -> CellSolver:
        """The solver under test, with default options."""
        raise cls.undefined("make_solver(cls)", "MyCellSolver()", "a new porocore.CellSolver")

    @classmethod
    def make_cell(cls, **others: Any) -> Cell:
        """The cell that is solved, with ``others`` of its keys changed; one that the solver is made for."""
        return Cell(mesh=cls.mesh, **others)

    @pytest.fixture(scope="class")
    @classmethod
    def solver(cls) -> CellSolver:
        return cls.make_solver()

    @pytest.fixture(scope="class")
    @classmethod
    def prepared(cls, solver: CellSolver) -> Any:
        return solver.prepare(cls.make_cell())
