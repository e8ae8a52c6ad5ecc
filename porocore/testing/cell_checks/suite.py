"""Shared part of the suites of cell solvers: solver under test, prepared cell, states, a comparison."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.meshing.mesh import MeshSettings
from porocore.interfaces.cell import CellSolver
from porocore.states import Array, MacroState
from porocore.testing.expect import near, state_text
from porocore.testing.suite import Suite

#: Three states away from zero: diagonal, diagonal under suction, and general with shear and pressure.
STATES: dict[str, tuple[Array, float]] = {
    "compressed": (np.diag([0.02, -0.08, 0.03]), 0.05),
    "stretched": (np.diag([0.10, -0.02, 0.05]), -0.04),
    "sheared": (np.array([[0.03, 0.08, -0.02], [0.01, -0.06, 0.04], [0.0, 0.05, 0.02]]), 0.08),
}
#: Of the differences that derivatives are held against.
STEP = 1e-3
RESPONSES = ("mean_grad", "potential", "stress", "fluid_volume")


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

    @pytest.fixture(scope="class")
    @classmethod
    def responses(cls, solver: CellSolver, prepared: Any) -> dict[str, Any]:
        """Responses at ``STATES``, one row each."""
        return {name: solver.solve_one(prepared, *state) for name, state in STATES.items()}

    @pytest.fixture(scope="class")
    @classmethod
    def batch(cls) -> MacroState:
        """Return ``STATES`` as one batch."""
        return MacroState.concatenate([MacroState.single(*state) for state in STATES.values()])


def state_label(name: str) -> str:
    """Return one of ``STATES`` as text."""
    return f"{name} ({state_text(*STATES[name])})"


def matches_difference(what: str, difference: Any, slope: Any, state: str) -> None:
    """Hold a derivative against a difference of the responses, up to 1e-6 of its largest entry."""
    size = float(np.abs(slope).max())
    near(f"{what} by differences,", slope, difference, state, within=max(1e-6 * size, 1e-9))
