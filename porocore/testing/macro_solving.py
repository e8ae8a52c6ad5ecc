"""What the conformance suite of macro solvers solves, and how."""

from __future__ import annotations

from typing import Any

from porocore.interfaces.macro import MacroSolver
from porocore.problem import MacroProblem
from porocore.solution import MacroSolution
from porocore.testing.suite import Suite
from porocore.testing.synthetic import CONDUCTIVITY, SOLID_FRACTION, linear_law, mean_gradient_law

LINEAR, NONLINEAR = linear_law(), mean_gradient_law()
COEFFICIENTS, PHI_S, K = LINEAR.coefficients, SOLID_FRACTION, CONDUCTIVITY
C22, ALPHA = COEFFICIENTS.stiffness[1, 1, 1, 1], COEFFICIENTS.biot[1, 1]
SHORT: dict[str, Any] = {
    "end": 6.0,
    "step": 0.5,
    "ramp_increments": 4,
    "ramp_step": 0.05,
    "profiles": (1.0,),
}
SIDES: dict[str, Any] = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
HELD: dict[str, Any] = {"displacement": (0, 0, 0)}


class Solving(Suite):
    """A suite that solves macro problems with the solver under test."""

    @classmethod
    def make_solver(cls, **options: Any) -> MacroSolver:
        """The solver under test with the options: ``checkpoint_seconds``, and one that it has to refuse."""
        raise cls.undefined(
            "make_solver(cls, **options)", "MyMacroSolver(**options)", "a new porocore.MacroSolver"
        )

    @classmethod
    def prepare(cls, problem: MacroProblem) -> Any:
        """By a new solver."""
        return cls.make_solver().prepare(problem)

    @classmethod
    def solve(cls, problem: MacroProblem, law: Any, **how: Any) -> MacroSolution:
        """By a new solver."""
        solver = cls.make_solver()
        return solver.solve(solver.prepare(problem), law, **how)
