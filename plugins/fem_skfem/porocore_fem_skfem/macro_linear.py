"""Linear systems of a macro step: sparse factor, or flexible GMRES with a block preconditioner."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, gmres

from porocore.cell.equilibrium.discrete import FactorError
from porocore.macro.integration.discretisation import StepFailed
from porocore.macro.linear_systems import (
    LinearLevel,
    LinearWork,
    ReusePolicy,
    Solver,
    available_bytes,
    choose_solver,
    factor_bytes,
    fits,
    linear_level,
    pressure_mass,
    spoken_bytes,
)
from porocore.states import Array, IntArray
from porocore_fem_skfem import pardiso
from porocore_fem_skfem.factor import OutOfMemoryError, SingularError
from porocore_fem_skfem.linalg import superlu
from porocore_fem_skfem.macro_preconditioner import (
    ChebyshevSmoother,
    DisplacementCycle,
    Solve,
    pressure_cycle,
)
from porocore_fem_skfem.products import Product

if TYPE_CHECKING:
    from porocore_fem_skfem.macro_assembly import SkfemDiscretisation, System


#: Iterations between two restarts.
RESTART = 80
#: A direction of which the second orthogonalisation leaves less than this share is round-off.
BREAKDOWN = 1e-14


@dataclass(frozen=True)
class IterationResult:
    """Solution of an iteration."""

    x: Array
    iterations: int
    reduction: float  #: of the residual, true at the end

    def reached(self, accuracy: float) -> bool:
        """Tell whether the true residual is as small as it was to be, but for round-off."""
        return bool(self.reduction <= 2 * accuracy)


def flexible_gmres(
    apply: Callable[[Array], Array],
    right: Array,
    precondition: Callable[[Array], Array],
    *,
    accuracy: float,
    limit: int,
) -> IterationResult:
    """Solve A x = ``right`` by GMRES, preconditioned from the right, orthogonalised twice [Saad 1993].

    Parameters
    ----------
    apply, precondition
        A, and an approximate inverse of it, which need not be quite the same at every call.
    accuracy
        Residual, as a share of the right-hand side, that ends the iteration.
    limit
        Iterations at most.
    """
    size = float(np.linalg.norm(right))
    x, r, count = np.zeros_like(right), right, 0
    if size == 0:
        return IterationResult(x, 0, 0.0)
    left = size
    while count < limit:
        change, steps = _cycle(apply, r, precondition, accuracy * size, min(RESTART, limit - count))
        count += steps
        x = x + change
        r = right - apply(x)
        before, left = left, float(np.linalg.norm(r))
        if not left > 1.5 * accuracy * size or not left < 0.9 * before:
            break
    return IterationResult(x, count, left / size if np.isfinite(left) else np.inf)


def _cycle(
    apply: Callable[[Array], Array],
    r: Array,
    precondition: Callable[[Array], Array],
    goal: float,
    steps: int,
) -> tuple[Array, int]:
    """Return the change of x after so many steps at most, and how many there were."""
    # Memory that is never written to is never taken.
    basis, z = np.empty((steps + 1, len(r))), np.empty((steps, len(r)))
    beta = float(np.linalg.norm(r))
    basis[0] = r / beta
    H = np.zeros((steps + 1, steps))
    y = np.zeros(0)
    for k in range(steps):
        z[k] = precondition(basis[k])
        w = apply(z[k])
        length = float(np.linalg.norm(w))
        for _ in range(2):
            share = basis[: k + 1] @ w
            w -= share @ basis[: k + 1]
            H[: k + 1, k] += share
        H[k + 1, k] = np.linalg.norm(w)
        if not np.isfinite(H[: k + 2, k]).all():
            return y @ z[:k], k
        e = np.zeros(k + 2)
        e[0] = beta
        y = np.linalg.lstsq(H[: k + 2, : k + 1], e, rcond=None)[0]
        left = float(np.linalg.norm(e - H[: k + 2, : k + 1] @ y))
        if left <= goal or H[k + 1, k] <= BREAKDOWN * length:
            return y @ z[: k + 1], k + 1
        basis[k + 1] = w / H[k + 1, k]
    return y @ z, steps


#: Iterations at most. Bodies that converge take up to 40, so one that takes these will not.
LIMIT = 120

Matrices = tuple[tuple[sparse.bsr_matrix, sparse.bsr_matrix], tuple[sparse.bsr_matrix, sparse.bsr_matrix]]


@dataclass(frozen=True, eq=False)
class Supports:
    """Prescribed unknowns, and those of plates, in vectors of all unknowns of a body.

    Attributes
    ----------
    prescribed
        Unknowns that are zero in every solution.
    plates
        Unknowns that are one; the first of each stands for all.
    """

    prescribed: IntArray
    plates: Sequence[IntArray]
    size: int

    def expanded(self, x: Array) -> Array:
        """Return unknowns with those of plates from the first of them."""
        if self.plates:
            x = x.copy()
            for plate in self.plates:
                x[plate] = x[plate[0]]
        return x

    def collected(self, y: Array) -> Array:
        """Return, in place, the equations: sums in the first row of plates, zero in the others and where prescribed."""
        y[self.prescribed] = 0.0
        for plate in self.plates:
            total = y[plate].sum()
            y[plate] = 0.0
            y[plate[0]] = total
        return y

    def of_displacements(self, n_u: int) -> Supports:
        """Return those of the displacements, which are the first ``n_u``."""
        return Supports(self.prescribed[self.prescribed < n_u], self.plates, n_u)

    @property
    def held(self) -> npt.NDArray[np.bool_]:
        """(unknowns,) those that do not stand for themselves."""
        found = np.zeros(self.size, bool)
        found[self.prescribed] = True
        for plate in self.plates:
            found[plate[1:]] = True
        return found


class IterativeSolver:
    """Solver by GMRES with a lower triangular block preconditioner.

    Parameters
    ----------
    supports
        Of all unknowns, displacements first.
    level
        Linear displacements.
    work
        Record of what is done.
    """

    def __init__(self, supports: Supports, level: LinearLevel, n_u: int, work: LinearWork) -> None:
        self._supports, self._of_u = supports, supports.of_displacements(n_u)
        self._level, self._n_u, self._work = level, n_u, work
        self._policy = ReusePolicy()
        self._cycle: DisplacementCycle | None = None
        self._pressure: Solve | None = None
        self._scale = np.ones(supports.size)
        self._held_p = supports.held[n_u:]

    def forget(self) -> None:
        """Make a new preconditioner for the next system."""
        self._cycle = None

    def solve(
        self,
        matrices: Matrices,
        right: Array,
        mass: Callable[[], sparse.csr_matrix],
        *,
        again: bool,
        accuracy: float,
    ) -> IterationResult:
        """Return the solution of A x = ``right`` (unknowns,), which is zero where prescribed.

        A preconditioner that has served before and does not do is made anew.

        Parameters
        ----------
        matrices
            Forces and volumes by displacements and pressures, whatever is prescribed.
        mass
            Makes the mass matrix of the pressures in the Schur complement.
        again
            The last mass matrix may serve.
        accuracy
            Residual as a share of the right-hand side.
        """
        right = self._supports.collected(right.copy())
        fresh = self._cycle is None or self._policy.due
        try:
            self._set_up(matrices, mass, whole=fresh, pressure=fresh or not again)
            solved = self._iterate(matrices, right, accuracy)
            if not (solved.reached(accuracy) or fresh):
                self._set_up(matrices, mass, whole=True, pressure=True)
                solved = self._iterate(matrices, right, accuracy)
        except (FactorError, np.linalg.LinAlgError, RuntimeError):
            # A group of nodes or the coarsest level is singular, or what the preconditioner is applied to overflows.
            solved = IterationResult(right, 0, np.inf)
        if not solved.reached(accuracy):
            self._policy.expire()
        return replace(solved, x=self._supports.expanded(solved.x))

    def _set_up(
        self, matrices: Matrices, mass: Callable[[], sparse.csr_matrix], *, whole: bool, pressure: bool
    ) -> None:
        began = perf_counter()
        (uu, _), (_, pp) = matrices
        if whole:
            self._cycle = None  # its memory serves the next one
            leaders = np.array([plate[0] for plate in self._supports.plates], dtype=np.int64)
            values = np.array([self._shared(uu, leader) for leader in leaders])
            smoother = ChebyshevSmoother(
                uu, partial(self._forces, uu), self._of_u.held.reshape(-1, 3), (leaders, values)
            )
            self._cycle = DisplacementCycle(uu, self._level, smoother)
            diagonal = uu.diagonal()
            diagonal[leaders] = values
            self._scale[: self._n_u] = _inverse_roots(diagonal)
            self._policy.renewed()
        if pressure:
            schur = (pp.tocsr() + mass()).tocsr()
            self._pressure = pressure_cycle(schur, self._held_p)
            self._scale[self._n_u :] = _inverse_roots(schur.diagonal())
        if whole or pressure:
            self._work.add_set_up(perf_counter() - began, whole=whole)

    def _shared(self, uu: sparse.bsr_matrix, leader: int) -> float:
        """Return the entry on the diagonal of the first unknown of a plate."""
        unit = np.zeros(self._n_u)
        unit[leader] = 1.0
        return float(self._forces(uu, unit)[leader])

    def _forces(self, uu: sparse.bsr_matrix | Product, u: Array) -> Array:
        return self._of_u.collected(uu @ self._of_u.expanded(u))

    def _iterate(self, matrices: Matrices, right: Array, accuracy: float) -> IterationResult:
        began, n_u, scale = perf_counter(), self._n_u, self._scale
        (uu, up), (pu, pp) = matrices
        assert self._cycle is not None
        assert self._pressure is not None
        cycle, pressure = self._cycle, self._pressure
        # Half the memory is read. Flexible GMRES bears a preconditioner that is not quite linear.
        product = Product(uu)
        forces = partial(self._forces, Product(uu, np.float32))

        def apply(x: Array) -> Array:
            x = self._supports.expanded(x)
            u, p = x[:n_u], x[n_u:]
            return scale * self._supports.collected(np.concatenate([product @ u + up @ p, pu @ u + pp @ p]))

        def precondition(r: Array) -> Array:
            r = r / scale
            u = cycle.solve(forces, r[:n_u].astype(np.float32)).astype(float)
            volumes = r[n_u:] - pu @ self._of_u.expanded(u)
            volumes[self._held_p] = 0.0
            return np.concatenate([u, pressure(volumes)])

        solved = flexible_gmres(apply, scale * right, precondition, accuracy=accuracy, limit=LIMIT)
        self._work.add_solve(solved.iterations, perf_counter() - began)
        self._policy.add(solved.iterations, solved.reduction)
        return solved


def _inverse_roots(diagonal: Array) -> Array:
    """Return 1/√|diagonal|, and 1 where it is zero."""
    size = np.abs(diagonal)
    return np.where(size > 0, 1 / np.sqrt(np.where(size > 0, size, 1.0)), 1.0)


#: Unknowns above which a step by the iteration takes less time than one by PARDISO, and than one by SuperLU where
#: that is not installed: four fifths of it at 12,000 unknowns, a half at 28,000, a third at 84,000.
ABOVE, ABOVE_SUPERLU = 20_000, 5_000
#: Memory of PARDISO's factor in double precision [GiB] at a size, and its growth. PARDISO needs 0.095 GiB for a cube of
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
        factor = (
            f"a direct factorisation takes about {spoken_bytes(needed)}, and {spoken_bytes(free)} are free"
        )
        if not fits(needed, free):
            raise StepFailed(
                f"{failed}; {factor}. Use elements that are less stretched, fewer elements, dolfinx on several "
                f"processes, or a machine with more memory and macro.options.solver = direct. Or {NOT_HELD}"
            )
        self._d.linear.note(f"{failed}; {factor}, and is used instead")


class SparseLinearSolver:
    """Solver of linear systems of one pattern.

    The factor of a large one is of single precision, which takes half the time and half the memory; the iteration makes
    up for it. A system for which that is not enough gets one of double precision, and so do those that follow. Rows and
    columns are scaled before: in a wide meridian, where elements at the axis and far away differ by their size and by
    the circle they stand for, their entries lie fifteen orders apart, and no residual would fall below the round-off of
    the largest.
    """

    def __init__(self, work: LinearWork) -> None:
        self._work = work
        self._factor: pardiso.GeneralFactor | None = None
        #: Scales of the rows and columns of the matrix that has the factor.
        self._scales = np.empty(0)
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
            x = _iterate(_scaled(matrix, self._scales), self._scales * right, self._factor)
            if x is not None:
                return self._scales * x
        self._scales = _scales(matrix)
        scaled = _scaled(matrix, self._scales)
        while True:
            began = perf_counter()
            if self._factor is None:
                self._factor = pardiso.GeneralFactor(matrix.indptr, matrix.indices, single=self._single)
            self._factor.factor(scaled.data)
            self._add_set_up(began)
            x = _iterate(scaled, self._scales * right, self._factor)
            if x is not None:
                return self._scales * x
            if not self._single:
                return None
            self._factor, self._single = None, False


def _scales(matrix: sparse.csr_matrix) -> Array:
    """Return the roots (n,) of one over the largest entry of each row, as powers of two, which leave no round-off."""
    largest = np.zeros(matrix.shape[0])
    np.maximum.at(largest, np.repeat(np.arange(len(largest)), np.diff(matrix.indptr)), np.abs(matrix.data))
    return np.asarray(np.exp2(np.round(-0.5 * np.log2(np.where(largest > 0, largest, 1.0)))))


def _scaled(matrix: sparse.csr_matrix, scales: Array) -> sparse.csr_matrix:
    """Return a matrix with rows and columns times ``scales``, in the same pattern."""
    data = matrix.data * np.repeat(scales, np.diff(matrix.indptr)) * scales[matrix.indices]
    return sparse.csr_matrix((data, matrix.indices, matrix.indptr), shape=matrix.shape)


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
