"""PETSc's solver of the coupled linear system, by default MUMPS; large systems reuse its factor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from porocore.errors import ConfigurationError
from porocore.macro.integration.discretisation import StepFailed
from porocore.states import Array, IntArray
from porocore_fem_dolfinx.petsc_options import OptionValue, SolverOptions, explanation

Mask: TypeAlias = npt.NDArray[np.bool_]
KEY = "macro.options.petsc"
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
#: Largest residual of a solution, relative to the right-hand side.
LARGEST_RESIDUAL = 1e-5


class PetscLinearSolver:
    """Solver of the free rows and columns of matrices of one pattern.

    Parameters
    ----------
    comm
        MPI communicator.
    petsc
        The user's PETSc options, which override :data:`DEFAULTS`. The fields of a field split are ``u`` and ``p``.
    free : (f,)
        Free rows of this process, displacements first.
    is_force : (equations,)
        True for the unknowns of this process's equations that are displacements.
    expansion
        Matrix T from them to the free unknowns, so that TᵀAT is solved with; None where they are the same.

    Raises
    ------
    ConfigurationError
        An option is of a kind that PETSc refuses at once.
    """

    def __init__(
        self,
        comm: MPI.Intracomm,
        petsc: Mapping[str, OptionValue],
        free: IntArray,
        is_force: Mask,
        expansion: PETSc.Mat | None = None,
    ) -> None:
        self._comm, self._free, self._expansion = comm, free, expansion
        self._rows: PETSc.IS | None = None
        self._free_matrix: PETSc.Mat | None = None
        self._matrix: PETSc.Mat | None = None
        self._options = SolverOptions(DEFAULTS, petsc, KEY)
        self._ksp = PETSc.KSP().create(comm)
        self._ksp.setTolerances(rtol=ACCURACY, max_it=ITERATIONS)
        self._options.apply(self._ksp)
        #: True if a factor may serve again: the user has chosen no other solver, and the system is large.
        self._keeps = not petsc and comm.allreduce(len(is_force)) > LARGE
        if self._keeps:
            self._ksp.setType("gmres")
            self._ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
            self._ksp.setPCSide(PETSc.PC.Side.RIGHT)
        if self._ksp.getPC().getType() == "fieldsplit":
            self._split(is_force)

    def _split(self, is_force: Mask) -> None:
        """Tell the preconditioner which unknowns are displacements."""
        size, n_u = len(is_force), int(is_force.sum())
        start = self._comm.scan(size) - size
        u = PETSc.IS().createStride(n_u, start, 1, comm=self._comm)
        p = PETSc.IS().createStride(size - n_u, start + n_u, 1, comm=self._comm)
        self._ksp.getPC().setFieldSplitIS(("u", u), ("p", p))

    def destroy(self) -> None:
        """Free the factor and the matrices; all processes must do so together."""
        for part in (self._ksp, self._matrix, self._free_matrix, self._expansion):
            if part is not None:
                part.destroy()

    @contextmanager
    def trial(self) -> Iterator[None]:
        """Guard a solve that fails only if the options are at fault.

        Raises
        ------
        ConfigurationError
            PETSc refuses an option, makes no use of it, or the chosen solver does not converge.
        """
        try:
            yield
        except StepFailed as failure:
            cause = failure.__cause__
            if isinstance(cause, PETSc.Error):
                raise self._options.refused(cause) from failure
            raise ConfigurationError(
                f"{KEY}: the chosen solver fails on an elastic body: {failure}"
            ) from failure
        self._options.check_used()

    def solve(self, matrix: PETSc.Mat, right: Array, *, again: bool = False) -> Array:
        """Return x (f,) with A x = ``right`` (equations,), A being the free rows and columns of ``matrix``.

        ``again``: the factor of the system before may still serve.

        Raises
        ------
        StepFailed
            The matrix is singular, or the iteration does not converge.
        """
        if self._rows is None:
            start = matrix.getOwnershipRange()[0]
            self._rows = PETSc.IS().createGeneral((start + self._free).astype(np.int32), comm=self._comm)
        self._free_matrix = matrix.createSubMatrix(self._rows, self._rows, self._free_matrix)
        if self._expansion is None:
            self._matrix = self._free_matrix
        elif self._matrix is None:
            self._matrix = self._free_matrix.ptap(self._expansion)
        else:
            self._free_matrix.ptap(self._expansion, result=self._matrix)
        self._ksp.setOperators(self._matrix)
        x, b = self._matrix.createVecs()
        b.array = right
        norm = b.norm()
        # Norms are the same on all processes, and not finite if any entry is not.
        if not np.isfinite([norm, self._matrix.norm(PETSc.NormType.FROBENIUS)]).all():
            raise StepFailed("the tangent or the residual is not finite")
        reason = -1
        if again and self._keeps:
            reason = self._iterate(b, x, reuse=True)
        if reason < 0:
            reason = self._iterate(b, x, reuse=False)
        if reason == PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED or not np.isfinite(x.norm()):
            raise StepFailed(self._breakdown())
        if reason < 0:
            iterations = self._ksp.getIterationNumber()
            raise StepFailed(
                f"PETSc's solver stopped for reason {reason} after {iterations} iterations: the body may not be held "
                "against rigid motions, or the solver is not for this matrix"
            )
        self._matrix.multAdd(-x, b, b)
        left = b.norm()
        if left > LARGEST_RESIDUAL * norm:
            raise StepFailed(
                f"PETSc's solution is off by {left / norm:.1g} of the right-hand side: the body may not be held "
                "against rigid motions, or the solver is not for this matrix, which is not symmetric"
            )
        if self._expansion is not None:
            x = self._expansion * x
        solution: Array = x.array.copy()
        return solution

    def _breakdown(self) -> str:
        """Return the reason that there is no factor, of MUMPS by its code; -10 is a pivot that vanished."""
        pc = self._ksp.getPC()
        if pc.getType() == "lu" and pc.getFactorSolverType() == "mumps":
            code = pc.getFactorMatrix().getMumpsInfog(1)
            if code in OUT_OF_MEMORY:
                return f"MUMPS has not enough memory (error {code}): take fewer elements, or more machines"
            if code not in (0, -10):
                return f"MUMPS ended with error {code}"
        return "the tangent is singular: the body may not be held against rigid motions"

    def _iterate(self, b: PETSc.Vec, x: PETSc.Vec, *, reuse: bool) -> int:
        """Solve, and return PETSc's reason for stopping, which is negative without a solution."""
        self._ksp.getPC().setReusePreconditioner(reuse)
        if self._keeps:
            self._ksp.setTolerances(rtol=ACCURACY, max_it=STEPS if reuse else ITERATIONS)
        try:
            self._ksp.solve(b, x)
        except PETSc.Error as error:
            raise StepFailed(f"PETSc: {explanation(error)}") from error
        return int(self._ksp.getConvergedReason())
