"""Macro solver on scikit-fem: its options, and the discretisation that it makes of a problem."""

from __future__ import annotations

from porocore.macro.boundary.conditions import boundary_data
from porocore.macro.integration.solver import TimeSteppingMacroSolver
from porocore.macro.linear_systems import checked_solver
from porocore.macro.problem import MacroProblem, body_mesh
from porocore_fem_skfem.macro_assembly import SkfemDiscretisation


class SkfemMacroSolver(TimeSteppingMacroSolver):
    """Triquadratic hexahedra or quadratic tetrahedra with linear pressure, solved by a factor or an iteration.

    Bodies in two dimensions have biquadratic quadrilaterals or quadratic triangles.

    Parameters
    ----------
    solver : {"auto", "direct", "iterative"}
        Solver of the linear systems: ``direct``, a factor by PARDISO or SuperLU; ``iterative``, GMRES with multigrid,
        which takes less time and memory for large bodies; ``auto`` iterates above 20,000 unknowns.
    checkpoint_seconds : float, at least 0
        Wall time between two checkpoints, in seconds; 0 writes one after every step.
    """

    def __init__(self, *, solver: str = "auto", checkpoint_seconds: float = 5.0) -> None:
        super().__init__(checkpoint_seconds=checkpoint_seconds)
        self.solver = checked_solver(solver)

    def prepare(self, problem: MacroProblem) -> SkfemDiscretisation:
        """Return mesh, boundary data, shape functions and sparsity.

        Raises
        ------
        ConfigurationError
            Two surfaces contradict each other, a translation is not held, or the body cannot be meshed.
        """
        mesh = body_mesh(problem)
        return SkfemDiscretisation(problem, mesh, boundary_data(mesh, problem), self.solver)
