"""Macro solvers that break one law each, made of the one that 'porocore plugin new' writes."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from porocore.scaffold.project import project_files
from porocore.testing import MacroSolverSuite

_FOLDER = tempfile.TemporaryDirectory()
for _name, _text in project_files("right", "macro", "porocore-macro-right").items():
    _path = Path(_FOLDER.name) / _name
    _path.parent.mkdir(parents=True, exist_ok=True)
    _path.write_text(_text, encoding="utf-8")
sys.path.insert(0, _FOLDER.name)
from porocore_macro_right.macro_solver import Elements, RightMacroSolver  # noqa: E402


class _Law(MacroSolverSuite):
    kit_version = "1"
    caught_by: ClassVar[str]
    elements: ClassVar[type[Elements]] = Elements
    solver: ClassVar[type[RightMacroSolver]] = RightMacroSolver

    @classmethod
    def make_solver(cls, **options):
        solver = cls.solver(**options)
        if cls.elements is not Elements:
            solver.prepare = cls.elements
        return solver


class TestWrongSign(_Law):
    caught_by = "test_newtons_iteration_converges_quadratically"

    class elements(Elements):
        def system(self, tangent, dt, follower=None):
            return super().system(replace(tangent, storage_grad_u=-tangent.storage_grad_u), dt, follower)


class TestForgetsFollowers(_Law):
    caught_by = "test_the_tangent_is_the_slope_of_the_residual_on_any_body"

    class elements(Elements):
        def system(self, tangent, dt, follower=None):
            return super().system(tangent, dt)


class TestTransposedGradient(_Law):
    caught_by = "test_fields_of_first_order_are_exact_on_any_body"

    class elements(Elements):
        def states_of(self, x):
            states, grad_p = super().states_of(x)
            return replace(states, grad_u=states.grad_u.swapaxes(1, 2)), grad_p


class TestLosesFluid(_Law):
    caught_by = "test_fluid_is_conserved"

    class elements(Elements):
        def contributions(self, response):
            forces, stored, moved = super().contributions(response)
            return forces, 0.9 * stored, moved


class TestLoosePlate(_Law):
    caught_by = "test_a_plate_moves_as_one_and_bears_its_force"

    class elements(Elements):
        def solve(self, system, right, jump, *, again=False):
            change = super().solve(system, right, jump, again=again)
            for places in self.plates:
                change[self.free[places[1:]]] *= 0.99
            return change


class TestBeginsAnew(_Law):
    caught_by = "test_a_finished_run_is_not_run_again"

    class solver(RightMacroSolver):
        def solve(self, prepared, law, *, checkpoint=None, on_step=None):
            return super().solve(prepared, law, on_step=on_step)


class TestWritesTooOften(_Law):
    caught_by = "test_checkpoints_wait_for_their_time"

    class solver(RightMacroSolver):
        def __init__(self, **options):
            super().__init__(checkpoint_seconds=0.0)


class TestTakesForeignCheckpoints(_Law):
    caught_by = "test_a_truncated_checkpoint_is_refused"

    class solver(RightMacroSolver):
        def solve(self, prepared, law, *, checkpoint=None, on_step=None):
            if checkpoint is not None and checkpoint.exists() and checkpoint.stat().st_size < 20_000:
                checkpoint.unlink()
            return super().solve(prepared, law, checkpoint=checkpoint, on_step=on_step)
