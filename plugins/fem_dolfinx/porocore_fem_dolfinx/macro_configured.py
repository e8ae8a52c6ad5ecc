"""Linear solver of the u–p system by PETSc options: MUMPS' factor, or what the user chose."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from porocore.macro.integration.discretisation import StepFailed
from porocore.macro.linear_systems.work import LinearWork
from porocore_fem_dolfinx.petsc_options import OptionValue, SolverOptions, explanation

DEFAULTS: dict[str, OptionValue] = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}
#: Relative tolerance of an iteration that the user chose, too small for Newton's method to notice, and its limit.
ACCURACY, ITERATIONS = 1e-10, 1000
#: Beyond this number of unknowns GMRES uses the factor of an earlier system, for so many steps at most.
LARGE, STEPS = 3_000, 30
#: MUMPS' codes for lack of memory: work space, allocation.
OUT_OF_MEMORY = (-8, -9, -11, -13, -19)
SINGULAR = int(PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED)


class ConfiguredSolver:
    """Solver of matrices of one pattern.

    Parameters
    ----------
    comm
        MPI communicator.
    petsc
        The user's PETSc options, which override :data:`DEFAULTS`. The fields of a field split are ``u`` and ``p``.
    key
        Place in the configuration, for messages.
    is_force : (equations,)
        True for the unknowns of this process's equations that are displacements, which come first.
    work
        Record that is filled.

    Raises
    ------
    ConfigurationError
        An option is of a kind that PETSc refuses at once.
    """

    def __init__(
        self,
        comm: MPI.Intracomm,
        petsc: Mapping[str, OptionValue],
        key: str,
        is_force: npt.NDArray[np.bool_],
        work: LinearWork,
    ) -> None:
        self._comm, self._work = comm, work
        self.options = SolverOptions(DEFAULTS, petsc, key)
        self._ksp = PETSc.KSP().create(comm)
        self._ksp.setTolerances(rtol=ACCURACY, max_it=ITERATIONS)
        self.options.apply(self._ksp)
        #: State of the matrix of the last factor.
        self._factored: int | None = None
        #: True if the factor of another matrix may serve: the user has chosen no other solver, and the system is large.
        self.is_default = not petsc
        self._keeps = self.is_default and comm.allreduce(len(is_force)) > LARGE
        if self._keeps:
            self._ksp.setType("gmres")
            self._ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
            self._ksp.setPCSide(PETSc.PC.Side.RIGHT)
        if self._ksp.getPC().getType() == "fieldsplit":
            self._split(is_force)

    def _split(self, is_force: npt.NDArray[np.bool_]) -> None:
        """Tell the preconditioner which unknowns are displacements."""
        size, n_u = len(is_force), int(is_force.sum())
        start = self._comm.scan(size) - size
        u = PETSc.IS().createStride(n_u, start, 1, comm=self._comm)
        p = PETSc.IS().createStride(size - n_u, start + n_u, 1, comm=self._comm)
        self._ksp.getPC().setFieldSplitIS(("u", u), ("p", p))

    def destroy(self) -> None:
        """Free the factor; all processes must do so together."""
        self._ksp.destroy()

    def solve(self, matrix: PETSc.Mat, b: PETSc.Vec, x: PETSc.Vec, *, again: bool) -> None:
        """Solve; ``again``: the factor of the system before may still serve.

        Raises
        ------
        StepFailed
            The matrix is singular, its factor does not fit, or the iteration does not converge.
        """
        self._ksp.setOperators(matrix)
        reason = -1
        if again and self._keeps:
            reason = self._attempt(b, x, reuse=True)
        if reason < 0:
            reason = self._attempt(b, x, reuse=False)
        if reason == SINGULAR or not np.isfinite(x.norm()):
            raise StepFailed(self._breakdown())
        if reason < 0:
            iterations = self._ksp.getIterationNumber()
            raise StepFailed(
                f"PETSc's solver stopped for reason {reason} after {iterations} iterations: the body may not be held "
                "against rigid motions, or the solver is not for this matrix"
            )

    def _breakdown(self) -> str:
        """Return the reason that there is no factor, of MUMPS by its code; -10 is a pivot that vanished."""
        pc = self._ksp.getPC()
        if pc.getType() == "lu" and pc.getFactorSolverType() == "mumps":
            code = pc.getFactorMatrix().getMumpsInfog(1)
            if code in OUT_OF_MEMORY:
                return (
                    f"MUMPS has not enough memory (error {code}): choose macro.options.solver: iterative, take fewer "
                    "elements, or more machines"
                )
            if code not in (0, -10):
                return f"MUMPS ended with error {code}"
        return "the tangent is singular: the body may not be held against rigid motions"

    def _attempt(self, b: PETSc.Vec, x: PETSc.Vec, *, reuse: bool) -> int:
        """Solve, and return PETSc's reason for stopping, which is negative without a solution."""
        self._ksp.getPC().setReusePreconditioner(reuse)
        if self._keeps:
            self._ksp.setTolerances(rtol=ACCURACY, max_it=STEPS if reuse else ITERATIONS)
        began = perf_counter()
        try:
            self._ksp.setUp()
            ready = perf_counter()
            self._ksp.solve(b, x)
        except PETSc.Error as error:
            raise StepFailed(f"PETSc: {explanation(error)}") from error
        state = self._ksp.getOperators()[1].stateGet()
        if not reuse and state != self._factored:
            self._factored = state
            self._work.add_set_up(ready - began)
        iterates = self._ksp.getType() != "preonly"
        self._work.add_solve(self._ksp.getIterationNumber() if iterates else 0, perf_counter() - ready)
        return int(self._ksp.getConvergedReason())
