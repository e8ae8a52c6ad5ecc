"""Laws of calls of a cell solver: batches, order, starts, inputs unchanged, failed rows."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, ClassVar

import numpy as np
import pytest

import porocore.testing.cell_laws.identities as identities
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import CellSolver
from porocore.states import CellResponse, MacroState, Status
from porocore.testing.cell_laws.suite import (
    RESPONSES,
    STATES,
    STEP,
    CellSuite,
    matches_difference,
    state_label,
)
from porocore.testing.expect import holds, near, options, refused, require, same, state_text, states_text


class Calls(CellSuite):
    """Part of :class:`porocore.testing.cell_laws.base.CellSolverSuite`."""

    #: Of responses, between solves that may take another way to the same equilibrium.
    same: ClassVar[float] = 1e-9

    def test_two_calls_give_the_same_to_the_last_bit(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any]
    ) -> None:
        """The same solver and cell repeat their result; so a repeated study is the same."""
        for name in ("compressed", "sheared"):
            again: Any = solver.solve_one(prepared, *STATES[name])
            state = f"{state_label(name)}, solved twice"
            for response in RESPONSES:
                same(response, getattr(again, response), getattr(responses[name], response), state)
            for slope, values in vars(responses[name].tangent).items():
                if values is not None:
                    same(f"tangent.{slope}", getattr(again.tangent, slope), values, state)

    @pytest.mark.parametrize("alone", ["p", "H"])
    def test_each_variable_alone_changes_the_answer(
        self, solver: CellSolver, prepared: Any, alone: str
    ) -> None:
        """Differences along p with the same H, and along H with the same p, beyond the other states' pressures."""
        H, p = np.diag([0.01, -0.03, 0.02]), 0.3
        dH, dp = (np.zeros((3, 3)), 1.0) if alone == "p" else (np.diag([0.3, -1.0, 0.5]), 0.0)
        state = f"{state_text(H, p)} and steps of {alone} alone"
        steps = identities.stencil_states(H, p, dH, dp, STEP)
        there_and_back = MacroState.concatenate([MacroState.single(H, p), *steps])
        solved = solver.solve(prepared, there_and_back).response
        found = identities.difference_quotients(
            [solved[row : row + 1] for row in range(1, len(solved))], STEP
        )
        for response, slope in identities.linear_changes(solved[:1], dH, dp).items():
            matches_difference(f"d{response}/d{alone}", found[response], slope, state)

    def test_rows_do_not_depend_on_the_batch_or_its_order(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any], batch: MacroState
    ) -> None:
        backwards = solver.solve(prepared, batch[::-1]).response[::-1]
        for row, name in enumerate(STATES):
            state = f"{state_label(name)} in a batch, against alone"
            self.assert_same(backwards[row : row + 1], responses[name], state)

    def test_a_new_solver_gives_the_same(self, responses: dict[str, Any]) -> None:
        solver = self.make_solver()
        name, state = next(iter(STATES.items()))
        found = solver.solve_one(solver.prepare(self.make_cell()), *state)
        self.assert_same(found, responses[name], f"{state_label(name)}, by a new solver")

    def test_derivatives_only_where_they_are_wanted(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any]
    ) -> None:
        name, at = next(iter(STATES.items()))
        plain = solver.solve_one(prepared, *at, tangent=False)
        state = f"{state_label(name)}, tangent=False"
        holds(plain.tangent is None, state, "no derivatives", "derivatives")
        for response in RESPONSES:
            self.assert_near(response, getattr(plain, response), getattr(responses[name], response), state)

    def test_inputs_are_not_changed(self, solver: CellSolver, prepared: Any, batch: MacroState) -> None:
        states = batch[:2]
        H, p = states.grad_u.copy(), states.p.copy()
        first: Any = solver.solve(prepared, states, fields=True)
        kept = [None if field is None else field.u.copy() for field in first.fields or []]
        solver.solve(prepared, states, start=first.fields, tangent=False)
        same("H", states.grad_u, H, f"{state_text(H[0], p[0])}, after the solve")
        same("p", states.p, p, f"{state_text(H[0], p[0])}, after the solve")
        for field, before in zip(first.fields or [], kept, strict=True):
            if field is not None and before is not None:
                same("u of the start", field.u, before, states_text(states))

    def test_a_state_without_solution_is_a_row_with_a_status(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any]
    ) -> None:
        """det (I + H) < 0 turns the cell inside out; its row holds NaN, and those around it hold what they held."""
        H, p = STATES["compressed"]
        states = MacroState(np.stack([H, np.diag([0.0, -1.2, 0.0]), H]), np.array([p, 0.0, p]))
        solution = solver.solve(prepared, states, fields=True)
        response = solution.response
        status, state = Status(int(response.status[1])), state_text(states.grad_u[1])
        holds(not status.has_values, state, "a status without values", status.name)
        for holder in (response, response.tangent, response.extrema):
            for name, values in vars(holder).items() if holder is not None else ():
                if isinstance(values, np.ndarray) and name not in ("status", "outside_training_range"):
                    lost = np.isnan(np.asarray(values[1], dtype=float)).all()
                    holds(lost, state, f"NaN for {name} of the failed row", values[1])
        for row in (0, 2):
            around = f"{state_label('compressed')} beside a failed row"
            self.assert_same(response[row : row + 1], responses["compressed"], around)
        if solution.fields is not None:
            found = [field is None for field in solution.fields]
            holds(found == [False, True, False], state, "no field for the failed row alone", found)

    def test_fields_are_returned_where_they_are_declared(self, solver: CellSolver, prepared: Any) -> None:
        """One for each row, on a domain whose mesh the core makes, and none where they are not asked for."""
        H, p = STATES["compressed"]
        self.needs(type(solver).returns_fields, "returns_fields = False: it returns no fields")
        state, states = state_label("compressed"), MacroState.single(H, p)
        found = require("fields", solver.solve(prepared, states, fields=True).fields, state)
        holds(len(found) == 1, state, "one field", len(found))
        field = require("the field of the row", found[0], state)
        same("H of the field", field.grad_u, H, state)
        same("p of the field", field.p, p, state)
        nodes = len(self.make_cell().make_mesh("solid", field.domain).points)  # type: ignore[arg-type]
        holds(field.u.shape == (nodes, 3), state, f"u of shape ({nodes}, 3)", field.u.shape)
        holds(solver.solve(prepared, states).fields is None, f"{state}, fields=False", "no fields", "fields")

    def test_a_start_changes_the_way_and_not_the_answer(self, solver: CellSolver, prepared: Any) -> None:
        near_by = solver.solve(prepared, MacroState.single(np.diag([0, -0.12, 0]), 0.1), fields=True)
        self.needs(near_by.fields is not None, "returns_fields = False: it returns no fields")
        target = MacroState.single(np.diag([0, -0.14, 0]), 0.1)
        warm = solver.solve(prepared, target, start=near_by.fields).response
        cold = solver.solve(prepared, target).response
        for name in RESPONSES:
            state = f"{states_text(target)}, from a neighbour and from the undeformed cell"
            near(name, getattr(warm, name), getattr(cold, name), state, within=1e-9)

    def test_unknown_options_are_refused(self, solver: CellSolver) -> None:
        with refused(
            ConfigurationError, TypeError, state=options({"no_such_option": 1}), naming=("no_such_option",)
        ):
            type(solver)(no_such_option=1)

    @classmethod
    def assert_near(
        cls, what: str, found: Any, expected: Any, state: str, share: float | None = None
    ) -> None:
        """Up to ``share`` of the largest entry, by default :attr:`same`."""
        size = max(float(np.abs(expected).max()), 1e-3)
        near(what, found, expected, state, within=(cls.same if share is None else share) * size)

    @classmethod
    def assert_same(cls, found: CellResponse, expected: CellResponse, state: str) -> None:
        """Up to :attr:`same` of the largest entry, derivatives included."""
        same("status", found.status, expected.status, state)
        for name in RESPONSES:
            cls.assert_near(name, getattr(found, name), getattr(expected, name), state)
        wanted, slopes = require("derivatives", expected.tangent, state), found.tangent
        for slope in fields(wanted):
            value = getattr(wanted, slope.name)
            if value is not None:
                got = getattr(require("derivatives", slopes, state), slope.name)
                cls.assert_near(f"tangent.{slope.name}", got, value, state, 100 * cls.same)
