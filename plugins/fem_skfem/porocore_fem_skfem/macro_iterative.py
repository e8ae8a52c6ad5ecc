"""GMRES on large u–p systems, supports and plates in vectors, and a preconditioner that is kept until it ages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter

import numpy as np
import numpy.typing as npt
from scipy import sparse

from porocore.cell.equilibrium.discrete import FactorError
from porocore.macro.linear_systems.coarse import LinearLevel
from porocore.macro.linear_systems.reuse import ReusePolicy
from porocore.macro.linear_systems.work import LinearWork
from porocore.states import Array, IntArray
from porocore_fem_skfem.krylov import IterationResult, flexible_gmres
from porocore_fem_skfem.macro_preconditioner import DisplacementCycle, Solve, pressure_cycle
from porocore_fem_skfem.macro_smoother import ChebyshevSmoother
from porocore_fem_skfem.products import Product

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
