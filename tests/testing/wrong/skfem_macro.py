"""The macro solver on scikit-fem, of which discretisation, problem, law and solution can be altered."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar

import pytest

from porocore.errors import ConfigurationError
from porocore.macro.boundary.conditions import boundary_data
from porocore.macro.problem import body_mesh
from porocore.testing import MacroSolverSuite

Right: Any = pytest.importorskip("porocore_fem_skfem.macro").SkfemMacroSolver
Discretisation: Any = pytest.importorskip("porocore_fem_skfem.macro_assembly").SkfemDiscretisation


class Elements(Discretisation):
    """As those of a large body, whose systems are blocks of nodes."""

    largest_small = 0


class Altered(Right):
    """Solves the problem that ``problem`` makes of the right one, under the law ``law``, and returns ``solution``."""

    elements: ClassVar[Any] = Elements

    def problem(self, problem):
        return problem

    def law(self, law):
        return law

    def solution(self, solution):
        return solution

    def prepare(self, problem):
        problem = self.problem(problem)
        mesh = body_mesh(problem)
        return self.elements(problem, mesh, boundary_data(mesh, problem))

    def solve(self, prepared, law, **how):
        return self.solution(super().solve(prepared, self.law(law), **how))


class Law(MacroSolverSuite):
    """Of a macro solver with other elements, or altered otherwise."""

    kit_version = "5"
    caught_by: ClassVar[str]
    elements: ClassVar[Any] = Elements
    solver: ClassVar[Any] = Altered

    @classmethod
    def make_solver(cls, **options):
        solver = cls.solver(**options)
        solver.elements = cls.elements
        return solver


class Loaded(Elements):
    """What is prescribed is altered."""

    def alter(self, loads):
        return loads

    def loads(self, acting):
        return self.alter(super().loads(acting))


class TakesAnything(Altered):
    """Where a problem is refused it leaves out what it cannot use."""

    @abstractmethod
    def without(self, problem):
        """What is left of it."""

    def prepare(self, problem):
        try:
            return super().prepare(problem)
        except ConfigurationError:
            return super().prepare(self.without(problem))


def with_boundary(problem, **faces):
    """With other faces."""
    return problem.model_copy(update={"boundary": problem.boundary | faces})


def with_time(problem, **plan):
    """With another time plan."""
    return problem.model_copy(update={"time": problem.time.model_copy(update=plan)})


def with_fields(solution, **altered):
    """With altered fields in every profile: name → function of its values."""
    profiles = tuple(
        replace(profile, **{name: alter(getattr(profile, name)) for name, alter in altered.items()})
        for profile in solution.profiles
    )
    return replace(solution, profiles=profiles)


def with_history(solution, **altered):
    """With altered columns of the history: name → function of its values."""
    columns = {name: alter(getattr(solution.history, name)) for name, alter in altered.items()}
    return replace(solution, history=replace(solution.history, **columns))
