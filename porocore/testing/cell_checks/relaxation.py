"""Checks of a cell whose solid relaxes (RelaxingCells), of a solver that declares to follow one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.cell.materials.prony import Branch, Relaxation
from porocore.interfaces.cell import CellSolver
from porocore.states import CellResponse, MacroState, Status
from porocore.testing.cell_checks.exact import STATES, CellSuite, state_label
from porocore.testing.expect import holds, near, require

#: State at which the solid relaxes: a diagonal one is solved on the eighth, where there is one.
STATE = "compressed"
#: Strength and time of the branch; a strain in which the solid is linear.
STRENGTH, TIME, SMALL = 1.5, 2.0, 1e-7
#: A pressure that no cell bears, in units of the modulus of its solid.
IMPOSSIBLE = 1e6


class RelaxingCells(CellSuite):
    """Part of :class:`porocore.testing.cell_checks.base.CellSolverSuite`."""

    #: Of responses, relative to the largest entry.
    relaxed: float = 1e-8

    @pytest.fixture
    @classmethod
    def relaxing(cls, solver: CellSolver) -> CellSolver:
        """The solver, where it follows a cell whose solid relaxes."""
        cls.needs(type(solver).relaxes, "relaxes = False: it follows no cell whose solid relaxes")
        return solver

    def relaxed_as(
        self, found: CellResponse, row: int, wanted: CellResponse, stiffer: float, state: str
    ) -> None:
        """Hold stress and fluid volume of a row against those of a solid in equilibrium, ``stiffer`` times as stiff."""
        for name, factor in (("stress", stiffer), ("fluid_volume", 1.0)):
            expected = factor * require(name, getattr(wanted, name), state)[0]
            value = require(name, getattr(found, name), state)[row]
            near(name, value, expected, state, within=self.relaxed * float(np.abs(expected).max()))

    def test_a_sudden_load_meets_a_stiffer_solid(self, relaxing: CellSolver, prepared: Any) -> None:
        """W_a(H, p) = a W(H, p/a) with a = 1 + γ at once, and W in the end."""
        H, p = STATES[STATE]
        states = MacroState(np.stack([np.zeros((3, 3)), H, H]), np.array([0.0, p, p]))
        branch = Branch(strength=STRENGTH, time=TIME)
        times = np.array([1.0, 1.0, 1.0 + 1e14 * TIME])
        found = relaxing.relax(prepared, states, times, Relaxation(branches=(branch,))).response
        for row, stiffer, when in ((1, 1 + STRENGTH, "at once"), (2, 1.0, "in the end")):
            wanted = relaxing.solve_one(prepared, H, p / stiffer, tangent=False)
            self.relaxed_as(found, row, wanted, stiffer, f"{state_label(STATE)}, {when}")

    def test_without_strength_a_path_is_elastic(self, relaxing: CellSolver, prepared: Any) -> None:
        H, p = STATES[STATE]
        states = MacroState(np.stack([0.5 * H, H, 0.3 * H]), np.array([p, 0.0, 0.5 * p]))
        none = Relaxation(branches=(Branch(strength=0.0, time=TIME),))
        found = relaxing.relax(prepared, states, np.arange(3.0), none).response
        for row in range(3):
            wanted = relaxing.solve(prepared, states[row : row + 1], tangent=False).response
            self.relaxed_as(found, row, wanted, 1.0, f"state {row} of an elastic path")

    def test_a_small_stress_relaxes_with_the_series(self, relaxing: CellSolver, prepared: Any) -> None:
        """P_E = (1 + γ e^(−t/τ)) C:H after a sudden drained strain that is held."""
        rest = relaxing.solve_one(prepared, np.zeros((3, 3)))
        state = f"H of size {SMALL:g}, held"
        C: Any = require("derivatives", rest.tangent, state).stress_grad_u
        H = SMALL * np.diag([0.3, -1.0, 0.2])
        times = np.array([0.0, 0.0, 0.5, 3.0])
        states = MacroState(np.stack([np.zeros((3, 3)), H, H, H]), np.zeros(4))
        branch = Branch(strength=STRENGTH, time=TIME)
        found = relaxing.relax(prepared, states, times, Relaxation(branches=(branch,))).response
        stress = require("stress", found.stress, state)
        elastic = np.einsum("ijkl,kl->ij", C[0], H)
        for row in (1, 2, 3):
            wanted = (1 + STRENGTH * np.exp(-times[row] / TIME)) * elastic
            within = 1e-5 * float(np.abs(elastic).max())
            near("stress", stress[row], wanted, f"{state} for t = {times[row]:g}", within=within)

    def test_nothing_comes_behind_a_lost_state(self, relaxing: CellSolver, prepared: Any) -> None:
        """Rows behind one without values have its status, since their past is not known."""
        H = np.diag([0.0, -0.05, 0.0])
        states = MacroState(np.stack([H, H, H]), np.array([0.0, IMPOSSIBLE, 0.0]))
        branch = Branch(strength=STRENGTH, time=TIME)
        found = relaxing.relax(prepared, states, np.arange(3.0), Relaxation(branches=(branch,))).response
        statuses = [Status(int(status)) for status in found.status]
        state = f"p = 0, {IMPOSSIBLE:g} and 0"
        holds(statuses[0].has_values, state, "values of the first state", statuses[0].name)
        holds(not statuses[1].has_values, state, "no values of the second state", statuses[1].name)
        holds(
            statuses[2] is statuses[1], state, f"the status {statuses[1].name} of the last", statuses[2].name
        )
