"""The macro solver: the u–p problem of the homogenised body under a macroscopic law."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

from porocore.laws import MacroLaw
from porocore.parallel import World
from porocore.problem import MacroProblem
from porocore.solution import MacroSolution, StepReport


class MacroSolver(ABC):
    """Finds u, p with ∫ P_E:∇δu = ∫ t̄·δu and ∫ Δstorage δp − Δt ∫ q·∇δp + Δt ∫ q̄ δp = 0 (backward Euler).

    The law is asked once an iteration for all quadrature points and returns the exact tangent; a step whose
    Newton iteration fails is halved. Inf–sup stable: quadratic u, linear p.
    ``porocore.macro`` has what all implementations share, and ``porocore.testing.macro`` tests them.
    """

    #: Whether several MPI processes can share one problem; those that can set :attr:`world` too.
    distributed: ClassVar[bool] = False
    #: The processes that solve together, all of which call :meth:`prepare` and :meth:`solve`.
    world: World = World()

    def __init__(self, **options: Any) -> None:
        if options:
            raise TypeError(f"{type(self).__name__} takes no options, got {sorted(options)}")

    @abstractmethod
    def prepare(self, problem: MacroProblem) -> Any:
        """Mesh, bases and boundary data; shared by solves with other laws."""

    @abstractmethod
    def solve(
        self,
        prepared: Any,
        law: MacroLaw,
        *,
        checkpoint: Path | None = None,
        on_step: Callable[[StepReport], None] | None = None,
    ) -> MacroSolution:
        """Run through the time plan of the problem.

        With ``checkpoint``, the state is written there from time to time, and a run that finds the file
        continues from it to the same solution.

        Raises
        ------
        SolveError
            Newton's iteration fails at the smallest step.
        DataError
            The checkpoint belongs to another problem or law.
        """
