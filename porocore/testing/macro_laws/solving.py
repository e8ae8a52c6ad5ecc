"""Shared part of the suite of macro solvers: problems, preparation, solve, tangent against differences."""

from __future__ import annotations

from typing import Any

import numpy as np

from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.solution import MacroSolution
from porocore.macro.problem import MacroProblem
from porocore.study.preflight.abilities import lacking
from porocore.testing.suite import Suite
from porocore.testing.synthetic.response import CONDUCTIVITY, SOLID_FRACTION, linear_law, mean_gradient_law

LINEAR, NONLINEAR = linear_law(), mean_gradient_law()
COEFFICIENTS, PHI_S, K = LINEAR.coefficients, SOLID_FRACTION, CONDUCTIVITY
C22, ALPHA = COEFFICIENTS.stiffness[1, 1, 1, 1], COEFFICIENTS.biot[1, 1]
SHORT: dict[str, Any] = {"end": 6.0, "step": 0.5, "ramp_increments": 4, "ramp_step": 0.05, "profiles": (1.0,)}
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
    def offered(cls, problem: MacroProblem) -> MacroSolver:
        """A new solver; the law is skipped where it does not declare what the problem needs."""
        solver = cls.make_solver()
        missing = lacking(type(solver), problem)
        cls.needs(not missing, f"the solver does not offer {missing}")
        return solver

    @classmethod
    def prepare(cls, problem: MacroProblem) -> Any:
        """Prepare a problem with a new solver."""
        return cls.offered(problem).prepare(problem)

    @classmethod
    def solve(cls, problem: MacroProblem, law: Any, **how: Any) -> MacroSolution:
        """Solve a problem with a new solver."""
        solver = cls.offered(problem)
        return solver.solve(solver.prepare(problem), law, **how)

    @classmethod
    def discretise(cls, problem: MacroProblem) -> Any:
        """Return the ``porocore.macro`` discretisation of a new solver; skip the law where it has none."""
        cls.needs_core_mesh()
        return cls.prepare(problem)

    @staticmethod
    def tangent_and_slope(d: Any, load: float) -> tuple[Any, Any, Any]:
        """Return the system of the tangent, the slope of the residual along a random direction, and the direction.

        All unknowns are free to move, the law is nonlinear, and the state has no symmetry.
        """
        rng = np.random.default_rng(0)
        x, old = 0.02 * rng.standard_normal((2, d.mesh.size))
        states, _ = d.states(old)
        memory = NONLINEAR.respond(states, np.zeros((len(states), 3)), NONLINEAR.initial(len(states))).memory
        loads = d.loads(load)

        def residual(x: Any) -> Any:
            states, grad_p = d.states(x)
            response = NONLINEAR.respond(states, grad_p, memory)
            return d.residual(response, 0.3, loads, x).values, response

        tangent = residual(x)[1].tangent
        direction, h = rng.standard_normal(d.mesh.size), 1e-5
        slope = (residual(x + h * direction)[0] - residual(x - h * direction)[0]) / (2 * h)
        return d.system(tangent, 0.3, d.follower_tangent(x, loads)), slope, direction

    @classmethod
    def needs_core_mesh(cls) -> None:
        """Skip where the solver has a mesh of its own."""
        cls.needs(
            type(cls.make_solver()).meshes == "core",
            "meshes = 'own': it prepares no discretisation of porocore.macro",
        )

    @classmethod
    def needs_checkpoints(cls) -> None:
        """Skip where the solver writes no checkpoints."""
        cls.needs(type(cls.make_solver()).checkpoints, "checkpoints = False: it writes none")

    @classmethod
    def within(cls, exact: float) -> float:
        """``exact`` on the core's mesh, whose elements reproduce the solution; on another the declared accuracy."""
        solver = type(cls.make_solver())
        return exact if solver.meshes == "core" else max(exact, solver.accuracy)
