"""PETSc's linear solvers for the cell: factors that count their negative pivots, or multigrid."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from petsc4py import PETSc

from porocore.cell.equilibrium.discrete import FactorError
from porocore.core.echo import echo
from porocore.errors import ConfigurationError
from porocore.states import Array
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.petsc_options import OPTION_ERRORS, OptionValue, SolverOptions, explanation

CHOICES = ("auto", "mumps", "cholmod", "gamg")
#: MUMPS counts negative pivots; CHOLMOD's LLᵀ only notices that there are some.
DEFAULTS: dict[str, dict[str, OptionValue]] = {
    "mumps": {
        "ksp_type": "preonly",
        "pc_type": "cholesky",
        "pc_factor_mat_solver_type": "mumps",
        # A symmetric indefinite factor may need far more room than predicted.
        "mat_mumps_icntl_14": 80,
    },
    "cholmod": {
        "ksp_type": "preonly",
        "pc_type": "cholesky",
        "pc_factor_mat_solver_type": "cholmod",
        # Its LDLᵀ for small matrices would accept indefinite ones.
        "mat_cholmod_factor": "supernodal",
        "mat_cholmod_print": 0,
    },
    # The translations, which PETSc takes from the block size, are enough of a near null space: with the rotations
    # the iterations fall from 31 to 26 at 79,000 unknowns, and the set-up takes three times as long.
    "gamg": {"ksp_type": "cg", "ksp_max_it": 400, "pc_type": "gamg", "mg_levels_pc_type": "jacobi"},
}
#: Beyond these numbers of unknowns CHOLMOD is faster than MUMPS, and multigrid than any factor.
MUMPS_LIMIT, DIRECT_LIMIT = 30_000, 100_000
#: PETSc's code for a Cholesky factorisation that met a pivot that is not positive.
NOT_DEFINITE = 81
_INDEFINITE = (
    PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_PC,
    PETSc.KSP.ConvergedReason.DIVERGED_INDEFINITE_MAT,
)


def choose_solver(solver: str, unknowns: int) -> str:
    """Return the solver, with ``auto`` resolved for a system of this size.

    Raises
    ------
    ConfigurationError
        The solver is none of the choices.
    """
    if solver not in CHOICES:
        raise ConfigurationError(
            f"fem.options.solver: expected {', '.join(CHOICES[:-1])} or {CHOICES[-1]}, got {echo(solver)}"
        )
    if solver == "auto":
        return "mumps" if unknowns <= MUMPS_LIMIT else "cholmod" if unknowns <= DIRECT_LIMIT else "gamg"
    return solver


class SymmetricSolver:
    """Solver of linear systems with symmetric matrices of one pattern.

    Parameters
    ----------
    solver
        One of :data:`CHOICES`.
    petsc
        Further PETSc options, which go before the defaults.

    Attributes
    ----------
    negative
        Number of negative pivots of the matrix in use, 1 standing for "some"; -1 where that is not known.
    """

    def __init__(self, solver: str, petsc: Mapping[str, OptionValue], unknowns: int) -> None:
        kind = choose_solver(solver, unknowns)
        self._options = SolverOptions(DEFAULTS[kind], petsc, "fem.options.petsc")
        self._ksp = self._make()
        self._checked = False
        self.negative = -1

    def _make(self) -> PETSc.KSP:
        ksp = compat.freed_with(self, PETSc.KSP().create(PETSc.COMM_SELF))
        self._options.apply(ksp)
        return ksp

    def destroy(self) -> None:
        """Free the factor at once."""
        self._ksp.destroy()

    @property
    def is_factor(self) -> bool:
        """True where one application solves the system, so that it may precondition that of another matrix."""
        return bool(self._ksp.getType() == "preonly")

    def use(self, matrix: PETSc.Mat, accuracy: float = 1e-12) -> None:
        """Set up for ``matrix``.

        Raises
        ------
        FactorError
            The matrix is not finite, or its factorisation broke down; that it is indefinite is no such case.
        ConfigurationError
            An option cannot be used.
        """
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        # The preconditioner is kept when the matrix changes, until the next call of this function.
        self._ksp.getPC().setReusePreconditioner(False)
        self._ksp.setOperators(matrix)
        self._ksp.setTolerances(rtol=accuracy)
        self.negative = -1
        if not np.isfinite(matrix.norm(PETSc.NormType.FROBENIUS)):
            raise FactorError("the matrix is not finite")
        try:
            self._ksp.setUp()
        except PETSc.Error as error:
            if error.ierr in OPTION_ERRORS and not self._checked:
                raise self._options.refused(error) from error
            self._ksp.destroy()  # not fit for another matrix
            self._ksp = self._make()
            if error.ierr != NOT_DEFINITE:
                raise FactorError(explanation(error)) from error
            self.negative = 1
            return
        pc = self._ksp.getPC()
        pc.setReusePreconditioner(True)
        if pc.getType() == "cholesky":
            kind = pc.getFactorSolverType()
            if kind == "mumps":
                factor = pc.getFactorMatrix()
                if factor.getMumpsInfog(1) < 0:
                    raise FactorError(f"MUMPS ended with error {factor.getMumpsInfog(1)}")
                self.negative = factor.getMumpsInfog(12)
            elif kind == "cholmod":
                self.negative = 0  # or setUp had failed

    def solve(self, rhs: Array) -> Array:
        """Return x (n,) with K x = rhs (n,).

        Raises
        ------
        FactorError
            The right-hand side is not finite, or the iteration does not converge; ``negative`` is 1 if it met a
            direction of negative curvature.
        ConfigurationError
            An option has had no effect.
        """
        if not np.isfinite(rhs).all():
            raise FactorError("the right-hand side is not finite")
        b = PETSc.Vec().createWithArray(rhs, comm=PETSc.COMM_SELF)
        x = b.duplicate()
        self._apply(b, x)
        solution: Array = x.array.copy()
        if not np.isfinite(solution).all():
            raise FactorError("the solution is not finite")
        return solution

    def _apply(self, b: PETSc.Vec, x: PETSc.Vec) -> None:
        try:
            self._ksp.solve(b, x)
        except PETSc.Error as error:
            raise FactorError(explanation(error)) from error
        if not self._checked:
            self._options.check_used()
            self._checked = True
        reason = self._ksp.getConvergedReason()
        if reason < 0:
            if reason in _INDEFINITE:
                self.negative = 1
            raise FactorError(f"PETSc's solver stopped for reason {reason}")

    def iterate(self, matrix: PETSc.Mat, rhs: Array, accuracy: float, limit: int) -> Array | None:
        """Return x with K x = rhs for another K, by conjugate gradients with this factor; None after ``limit`` steps.

        None, too, where the iteration meets a direction of negative curvature.
        """
        ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        ksp.setType("cg")
        ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
        ksp.setOperators(matrix)
        pc = ksp.getPC()
        pc.setType("python")
        pc.setPythonContext(_Preconditioner(self))
        ksp.setTolerances(rtol=accuracy, atol=0.0, max_it=limit)
        b = PETSc.Vec().createWithArray(rhs, comm=PETSc.COMM_SELF)
        x = b.duplicate()
        try:
            ksp.solve(b, x)
        except PETSc.Error:
            return None
        return x.array.copy() if ksp.getConvergedReason() > 0 else None


class _Preconditioner:
    """PETSc's interface to a solver as a preconditioner."""

    def __init__(self, solver: SymmetricSolver) -> None:
        self._solver = solver

    def apply(self, pc: PETSc.PC, b: PETSc.Vec, x: PETSc.Vec) -> None:
        self._solver._apply(b, x)
