"""Linear solver of the u–p problem: factor or GMRES by size, fallback to a factor, errors of a failure."""

from __future__ import annotations

from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, gmres

from porocore.cell.equilibrium.discrete import FactorError
from porocore.macro.integration.discretisation import StepFailed
from porocore.macro.linear_systems.choice import Solver, choose_solver
from porocore.macro.linear_systems.coarse import linear_level
from porocore.macro.linear_systems.memory import available_bytes, factor_bytes, fits, spoken_bytes
from porocore.macro.linear_systems.schur import pressure_mass
from porocore.macro.linear_systems.work import LinearWork
from porocore.states import Array
from porocore_fem_skfem import pardiso
from porocore_fem_skfem.factor import OutOfMemoryError, SingularError
from porocore_fem_skfem.linalg import superlu
from porocore_fem_skfem.macro_iterative import IterativeSolver, Supports

if TYPE_CHECKING:
    from porocore_fem_skfem.macro_assembly import SkfemDiscretisation, System

#: Unknowns above which a step by the iteration takes less time than one by PARDISO, and than one by SuperLU where
#: that is not installed: four fifths of it at 12,000 unknowns, a half at 28,000, a third at 84,000.
ABOVE, ABOVE_SUPERLU = 20_000, 5_000
#: Memory of PARDISO's factor in double precision [GiB] at a size, and its growth. PARDISO tells 0.095 GiB for a cube of
#: 12,322 unknowns, 0.42 for 36,599 and 1.32 for 84,362; the law 0.09, 0.41 and 1.31. Larger bodies and other shapes
#: were not measured; for them the law is extrapolated.
FACTOR_GIB, FACTOR_AT, FACTOR_GROWTH = 1.3, 84_000, 1.4
#: Systems in a row that the iteration does not solve, after which it is not tried again. Those of a step that Newton's
#: method does not solve either are fewer.
MOST_FAILURES = 4
#: Below this number of unknowns SuperLU is as fast: the columns of the benchmark, no more than a few elements in 3D.
SMALL = 3_000
#: Relative tolerance of the iteration, steps between two restarts, and number of restarts.
ACCURACY, STEPS, RESTARTS = 1e-10, 20, 3
NOT_FINITE = "the tangent or the residual is not finite"
NOT_HELD = "the body may not be held against rigid motions"


class MacroLinearSolver:
    """Solver of the linear systems of one body.

    Parameters
    ----------
    d
        Discretisation of the body, whose record it fills.
    solver
        As the user has chosen.
    """

    def __init__(self, d: SkfemDiscretisation, solver: Solver) -> None:
        self._d, self._unknowns = d, int(d.leading.sum())
        above, why = ABOVE, ""
        if pardiso.library() is None:
            above, why = ABOVE_SUPERLU, "without MKL"
        iterates, d.linear.choice = choose_solver(solver, self._unknowns, above, why)
        self._direct = SparseLinearSolver(d.linear)
        self._iterative: IterativeSolver | None = None
        if iterates:
            plates = tuple(d.free[places] for places in d.plates)
            supports = Supports(d.prescribed, plates, d.mesh.size)
            level = linear_level(d.mesh, d.boundary)
            self._iterative = IterativeSolver(supports, level, d.mesh.n_u, d.linear)
        self._failures = 0
        #: Last system that was solved directly, and its matrix: further right-hand sides take its factor.
        self._last: tuple[System, sparse.csr_matrix] | None = None

    def forget(self) -> None:
        """Make a new preconditioner for the next system."""
        self._failures = 0
        if self._iterative is not None:
            self._iterative.forget()

    def solve(self, system: System, right: Array, *, again: bool, accuracy: float) -> Array:
        """Return the change of the free unknowns.

        Raises
        ------
        StepFailed
            The matrix is singular or not finite, or the iteration does not converge and a factor does not fit.
        """
        d = self._d
        if self._iterative is not None and self._failures < MOST_FAILURES:
            if not all(np.isfinite(values.sum()) for values in (*system.blocks, right)):
                raise StepFailed(NOT_FINITE)
            solved = self._iterative.solve(
                d.matrices(system),
                right,
                lambda: d.mass(pressure_mass(system.tangent, len(d.mesh.element.weights))),
                again=again,
                accuracy=accuracy,
            )
            if solved.reached(accuracy):
                self._failures, self._last = 0, None
                self._direct.release()
                return solved.x[d.free]
            self._failures += 1
            self._require_memory(solved.iterations, solved.reduction)
        if self._last is None or self._last[0] is not system:
            self._last = system, d.equation_matrix(system)
        return self._direct.solve(self._last[1], d.equations(right), again=again)[d.of_free]

    def _require_memory(self, iterations: int, reduction: float) -> None:
        """Tell that a factor takes over.

        Raises
        ------
        StepFailed
            It does not fit into memory.
        """
        needed, free = factor_bytes(self._unknowns, FACTOR_AT, FACTOR_GIB, FACTOR_GROWTH), available_bytes()
        failed = (
            f"the iteration for {self._unknowns:,} unknowns left {reduction:.1g} of the residual "
            f"after {iterations} steps"
        )
        factor = f"a direct factorisation takes about {spoken_bytes(needed)}"
        if free is not None:
            factor += f", and {spoken_bytes(free)} are free"
        if not fits(needed, free):
            raise StepFailed(
                f"{failed}; {factor}. Use elements that are less stretched, fewer elements, dolfinx on several "
                f"processes, or a machine with more memory and macro.options.solver = direct. Or {NOT_HELD}"
            )
        self._d.linear.note(f"{failed}; {factor}, and is used instead")


class SparseLinearSolver:
    """Solver of linear systems of one pattern.

    The factor of a large one is of single precision, which takes half the time and half the memory; the iteration makes
    up for it. A system for which that is not enough gets one of double precision, and so do those that follow.
    """

    def __init__(self, work: LinearWork) -> None:
        self._work = work
        self._factor: pardiso.GeneralFactor | None = None
        self._single = True
        #: Last matrix with a factor by SuperLU, and the factor.
        self._last: tuple[sparse.csr_matrix, Any] | None = None

    def release(self) -> None:
        """Free the memory of the factors."""
        self._factor = self._last = None

    def solve(self, matrix: sparse.csr_matrix, right: Array, *, again: bool) -> Array:
        """Return x with A x = ``right``; with ``again`` the last factor may still serve.

        Parameters
        ----------
        matrix
            Square, CSR, with a sorted and symmetric pattern.

        Raises
        ------
        StepFailed
            The matrix is singular or not finite, or its factor does not fit into memory.
        """
        began = perf_counter()
        self._set_up_seconds = 0.0
        try:
            if not (np.isfinite(matrix.data).all() and np.isfinite(right).all()):
                raise FactorError(NOT_FINITE)
            if len(right) <= SMALL or pardiso.library() is None:
                if self._last is None or self._last[0] is not matrix:
                    self._last = matrix, superlu(matrix)
                    self._add_set_up(began)
                x: Array | None = self._last[1].solve(right)
            else:
                x = self._by_factor(matrix, right, again)
            if x is None or not np.isfinite(x).all():
                raise SingularError("the tangent is singular")
        except FactorError as error:
            self.release()
            raise StepFailed(_message(error)) from error
        self._work.add_solve(0, perf_counter() - began - self._set_up_seconds)
        return x

    def _add_set_up(self, began: float) -> None:
        seconds = perf_counter() - began
        self._set_up_seconds += seconds
        self._work.add_set_up(seconds)

    def _by_factor(self, matrix: sparse.csr_matrix, right: Array, again: bool) -> Array | None:
        if again and self._factor is not None:
            x = _iterate(matrix, right, self._factor)
            if x is not None:
                return x
        while True:
            began = perf_counter()
            if self._factor is None:
                self._factor = pardiso.GeneralFactor(matrix.indptr, matrix.indices, single=self._single)
            self._factor.factor(matrix.data)
            self._add_set_up(began)
            x = _iterate(matrix, right, self._factor)
            if x is not None or not self._single:
                return x
            self._factor, self._single = None, False


def _iterate(matrix: sparse.csr_matrix, right: Array, factor: pardiso.GeneralFactor) -> Array | None:
    """Return GMRES' solution with a factor as preconditioner, None if it does not converge."""
    inverse = LinearOperator(matrix.shape, matvec=factor.solve, dtype=float)
    try:
        x, info = gmres(matrix, right, rtol=ACCURACY, atol=0.0, restart=STEPS, maxiter=RESTARTS, M=inverse)
    except FactorError:  # what it would have to be applied to is not finite
        return None
    return x if info == 0 else None


def _message(error: FactorError) -> str:
    if isinstance(error, SingularError):
        return f"{error}: {NOT_HELD}"
    if isinstance(error, OutOfMemoryError):
        return f"{error}: take fewer elements, or dolfinx on several processes"
    return str(error)
