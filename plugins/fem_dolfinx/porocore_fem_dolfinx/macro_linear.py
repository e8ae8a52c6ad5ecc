"""Linear systems of a macro step in PETSc: the default solver, or as options say."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from time import perf_counter

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from porocore.errors import ConfigurationError
from porocore.macro.integration.discretisation import StepFailed
from porocore.macro.linear_systems import (
    LinearWork,
    ReusePolicy,
    available_bytes,
    factor_bytes,
    fits,
    spoken_bytes,
)
from porocore.states import Array, IntArray
from porocore_fem_dolfinx.macro_multigrid import ITERATIONS, MultigridSolver
from porocore_fem_dolfinx.petsc_options import OPTION_ERRORS, OptionValue, SolverOptions, explanation

DEFAULTS: dict[str, OptionValue] = {
    "ksp_type": "preonly",
    "pc_type": "lu",
    "pc_factor_mat_solver_type": "mumps",
}
#: Relative tolerance of an iteration that the user chose, too small for Newton's method to notice, and its limit.
ACCURACY, CONFIGURED_ITERATIONS = 1e-10, 1000
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
        self._ksp.setTolerances(rtol=ACCURACY, max_it=CONFIGURED_ITERATIONS)
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
            self._ksp.setTolerances(rtol=ACCURACY, max_it=STEPS if reuse else CONFIGURED_ITERATIONS)
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


KEY = "macro.options.petsc"
#: Largest residual of a solution, relative to the right-hand side; of an iteration, relative to what was asked for.
LARGEST_RESIDUAL, OFF = 1e-5, 10.0
#: Residual of an iteration that always is small enough; iterations a digit beyond which its smoother is too weak.
LEAST, SLOW = 1e-9, 5.0
#: Unknowns, GiB of MUMPS' factor of them with a margin of a third, and growth: processes took 0.1, 0.6 and 1.9 GiB more
#: than without it at 14,000, 40,000 and 91,000.
FACTOR_AT, FACTOR_GIB, FACTOR_EXPONENT = 91_000, 2.5, 1.4


class PetscLinearSolver:
    """Solver of the free rows and columns of matrices of one pattern.

    Parameters
    ----------
    comm
        MPI communicator.
    free : (f,)
        Free rows of this process, displacements first.
    work
        Record that is filled.
    configured
        Maker of the solver by options.
    multigrid
        Iteration that goes before it, which takes over where that does not converge; None without one.
    expansion
        Matrix T from the unknowns of the equations to the free unknowns, so that TᵀAT is solved with; None where they
        are the same.
    """

    def __init__(
        self,
        comm: MPI.Intracomm,
        free: IntArray,
        work: LinearWork,
        configured: Callable[[], ConfiguredSolver],
        multigrid: MultigridSolver | None,
        expansion: PETSc.Mat | None = None,
    ) -> None:
        self._comm, self._free, self._work, self._expansion = comm, free, work, expansion
        self._make_configured, self._multigrid = configured, multigrid
        self._configured = None if multigrid is not None else configured()
        self._policy = ReusePolicy()
        self._rows: PETSc.IS | None = None
        self._free_matrix: PETSc.Mat | None = None
        self._matrix: PETSc.Mat | None = None
        self._taken = False  # the equations are those of the present matrix

    def destroy(self) -> None:
        """Free factors, hierarchies and matrices; all processes must do so together."""
        parts = (self._configured, self._multigrid, self._matrix, self._free_matrix, self._expansion)
        for part in parts:
            if part is not None:
                part.destroy()

    def begin(self) -> None:
        """Have the next system make a hierarchy of its own."""
        self._policy.expire()

    def renew(self) -> None:
        """Take note that the matrix of all unknowns has changed."""
        self._taken = False

    @property
    def keeps_factor(self) -> bool:
        """True if a matrix that was solved with is solved with again by its factor, on one process."""
        return self._comm.size == 1 and self._configured is not None and self._configured.is_default

    @contextmanager
    def trial(self) -> Iterator[None]:
        """Guard a solve that fails only if the options are at fault.

        Raises
        ------
        ConfigurationError
            PETSc refuses an option, makes no use of it, or the chosen solver does not converge.
        """
        solver = self._configured or self._multigrid
        assert solver is not None
        try:
            yield
        except StepFailed as failure:
            cause = failure.__cause__
            if isinstance(cause, PETSc.Error):
                raise solver.options.refused(cause) from failure
            raise ConfigurationError(
                f"{KEY}: the chosen solver fails on an elastic body: {failure}"
            ) from failure
        solver.options.check_used()

    def solve(
        self,
        matrix: PETSc.Mat,
        right: Array,
        schur: Callable[[], PETSc.Mat],
        *,
        again: bool,
        accuracy: float,
    ) -> Array:
        """Return x (f,) with A x = ``right`` (equations,), A being the free rows and columns of ``matrix``.

        Parameters
        ----------
        schur
            Function that returns the approximate Schur complement of the matrix.
        again
            The matrix is close to the one before.
        accuracy
            Relative residual that an iteration may leave.

        Raises
        ------
        StepFailed
            The matrix is singular, or neither an iteration nor a factor solves the system.
        """
        self._take(matrix)
        assert self._matrix is not None
        x, b = self._matrix.createVecs()
        b.array = right
        norm = b.norm()
        # Norms are the same on all processes, and not finite if any entry is not.
        if not np.isfinite([norm, self._matrix.norm(PETSc.NormType.FROBENIUS)]).all():
            raise StepFailed("the tangent or the residual is not finite")
        if self._multigrid is None or not self._iterate(b, x, norm, schur, again, accuracy):
            self._by_options(b, x, norm, again)
        if self._expansion is not None:
            x = self._expansion * x
        solution: Array = x.array.copy()
        return solution

    def _by_options(self, b: PETSc.Vec, x: PETSc.Vec, norm: float, again: bool) -> None:
        """Solve by the solver of options, and check the solution."""
        if self._configured is None:
            self._fall_back()
        assert self._configured is not None
        assert self._matrix is not None
        self._configured.solve(self._matrix, b, x, again=again)
        self._matrix.multAdd(-x, b, b)
        left = b.norm()
        if left > LARGEST_RESIDUAL * norm:
            raise StepFailed(
                f"PETSc's solution is off by {left / norm:.1g} of the right-hand side: the body may not be held "
                "against rigid motions, or the solver is not for this matrix, which is not symmetric"
            )

    def _take(self, matrix: PETSc.Mat) -> None:
        """Take the equations out of the matrix of all unknowns, unless they are known: a factor of them then serves."""
        if self._taken:
            return
        self._taken = self._comm.size == 1
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

    def _iterate(
        self,
        b: PETSc.Vec,
        x: PETSc.Vec,
        norm: float,
        schur: Callable[[], PETSc.Mat],
        again: bool,
        accuracy: float,
    ) -> bool:
        """Solve by multigrid, with the hierarchy of an earlier system if that still serves; return whether it did."""
        multigrid, policy = self._multigrid, self._policy
        assert multigrid is not None
        fresh = policy.due
        while True:
            iterations, left = self._attempt(b, x, schur if fresh or not again else None, fresh, accuracy)
            # A norm that is no number fails too.
            if left <= max(OFF * accuracy, LEAST) * norm:
                reduction = left / norm if norm > 0 else 1.0
                policy.add(iterations, reduction)
                is_slow = 0 < reduction < 0.1 and iterations > SLOW * -np.log10(reduction)
                if fresh and is_slow and multigrid.strengthen():
                    self._work.note(
                        "the smoother of the iteration is made stronger: elements may be stretched"
                    )
                    policy.expire()
                return True
            policy.expire()
            if fresh and not multigrid.strengthen():
                return False
            fresh = True

    def _attempt(
        self,
        b: PETSc.Vec,
        x: PETSc.Vec,
        schur: Callable[[], PETSc.Mat] | None,
        fresh: bool,
        accuracy: float,
    ) -> tuple[int, float]:
        """Iterate once; return the iterations and the norm of the residual, infinite where there is no solution.

        Parameters
        ----------
        schur
            Function that returns the approximate Schur complement; None: the last one serves.
        fresh
            The hierarchy is made anew.
        """
        multigrid, work, began = self._multigrid, self._work, perf_counter()
        assert multigrid is not None
        try:
            if fresh:
                multigrid.set_up(self._matrix)
                self._policy.renewed()
            if schur is not None:
                multigrid.set_up_pressure(schur())
            ready = perf_counter()
            reason, iterations = multigrid.solve(self._matrix, b, x, accuracy)
        except PETSc.Error as error:
            if error.ierr in OPTION_ERRORS and multigrid.options.chosen:
                raise StepFailed(f"PETSc: {explanation(error)}") from error
            return 0, np.inf
        if fresh:
            work.add_set_up(ready - began)
        work.add_solve(iterations, perf_counter() - (ready if fresh else began))
        if reason <= 0:
            return iterations, np.inf
        assert self._matrix is not None
        rest = b.duplicate()
        self._matrix.mult(x, rest)
        rest.axpy(-1.0, b)
        left = float(rest.norm())
        rest.destroy()
        return iterations, left

    def _fall_back(self) -> None:
        """Have a factor take over for good.

        Raises
        ------
        StepFailed
            It would not fit into memory.
        """
        assert self._matrix is not None
        unknowns = self._matrix.getSize()[0]
        needed = factor_bytes(unknowns, FACTOR_AT, FACTOR_GIB, FACTOR_EXPONENT)
        left = self._available()
        said = f"the iteration for {unknowns:,} unknowns does not converge in {ITERATIONS} steps"
        share = f"about {spoken_bytes(needed)} of the {spoken_bytes(left)} left"
        if not fits(needed, left):
            raise StepFailed(
                f"{said}, and a direct factor would take {share}: take elements that are less stretched, fewer "
                "elements or more memory, start more processes on more machines, or choose PETSc options by "
                "macro.options.petsc"
            )
        self._work.note(f"{said}; a direct factor takes over, {share}")
        assert self._multigrid is not None
        self._multigrid.destroy()
        self._multigrid, self._configured = None, self._make_configured()

    def _available(self) -> float:
        """Return the memory that is left on all machines together."""
        machine = self._comm.Split_type(MPI.COMM_TYPE_SHARED)
        found = available_bytes() if machine.rank == 0 else 0.0
        machine.Free()
        return float(self._comm.allreduce(found))
