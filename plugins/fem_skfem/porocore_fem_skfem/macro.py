"""The macro solver on scikit-fem: the core's time loop on scikit-fem's shape functions and SciPy's SuperLU."""

from __future__ import annotations

from porocore.macro.boundary import boundary_data
from porocore.macro.mesh import BoxMesh
from porocore.macro.solver import MarchingMacroSolver
from porocore.problem import MacroProblem
from porocore_fem_skfem.macro_assembly import Assembler


class SkfemMacroSolver(MarchingMacroSolver):
    """Boxes of hexahedra (27-node displacement, 8-node pressure, 3 × 3 × 3 Gauss points), solved directly.

    Parameters
    ----------
    checkpoint_seconds
        Wall time between two checkpoints; 0 writes one after every step.
    """

    def __init__(self, *, checkpoint_seconds: float = 5.0) -> None:
        super().__init__()
        self.checkpoint_seconds = checkpoint_seconds

    def prepare(self, problem: MacroProblem) -> Assembler:
        """Boundary data, constant matrices and sparsity.

        Raises
        ------
        ConfigurationError
            Two faces contradict each other, or a translation is not held.
        """
        mesh = BoxMesh.make(problem)
        return Assembler(mesh, boundary_data(mesh))
