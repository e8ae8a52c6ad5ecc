"""Symmetric linear systems: a factor (or a multigrid cycle) as preconditioner, conjugate gradients on top.

A factor may be of single precision, of a neighbouring state or no factor at all; the iteration makes up
for it and notices negative curvature. Patterns are upper triangles in CSR with the diagonal first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray
from porocore_fem_skfem import pardiso
from porocore_fem_skfem.checks import Indices
from porocore_fem_skfem.factor import OutOfMemoryError, SingularError, SymmetricFactor

#: Beyond this number of unknowns multigrid is taken. At 314,000 a state with its derivatives takes 87 s and 7 GB with
#: factors; multigrid takes 23 s at 46,000, where factors take 2.3 s.
DIRECT_LIMIT = 350_000
#: Largest system in three dimensions for which SuperLU is fast enough.
SUPERLU_LIMIT = 6_000


def superlu(matrix: sparse.csr_matrix, **options: Any) -> SuperLU:
    """Return scipy's LU factors of a square matrix.

    Raises
    ------
    FactorError
        The matrix is singular, or its factors do not fit into memory.
    """
    try:
        return splu(matrix.tocsc(), **options)
    except RuntimeError as error:
        raise SingularError(f"SuperLU: {error}") from error
    except MemoryError as error:
        raise OutOfMemoryError(f"SuperLU: {error}") from error


class SuperLUFactor(SymmetricFactor):
    """scipy's SuperLU with symmetric ordering and diagonal pivots, so that their signs are the inertia."""

    def __init__(self, indptr: Indices, indices: Indices) -> None:
        super().__init__(indptr, indices)
        self._pattern = SymmetricPattern(indptr, indices)
        self.negative = 0

    def _factor(self, data: Array) -> None:
        symmetric = {
            "permc_spec": "MMD_AT_PLUS_A",
            "diag_pivot_thresh": 0.0,
            "options": {"SymmetricMode": True},
        }
        self._lu = superlu(self._pattern.full(data), **symmetric)
        self.negative = int((self._lu.U.diagonal() < 0).sum())

    def _solve(self, rhs: Array) -> Array:
        return np.asarray(self._lu.solve(np.ascontiguousarray(rhs)))


class MultigridFactor(SymmetricFactor):
    """One V-cycle of smoothed aggregation (pyamg).

    Parameters
    ----------
    near_kernel : (n, k)
        Fields of little energy, such as rigid motions.
    places : (n,)
        Place of each unknown in a list with three for every node, so that whole nodes are aggregated; None: a node has
        one unknown.
    """

    def __init__(
        self, indptr: Indices, indices: Indices, near_kernel: Array, places: IntArray | None = None
    ) -> None:
        super().__init__(indptr, indices)
        self._pattern = SymmetricPattern(indptr, indices)
        near = self._checked(near_kernel, ((self.n, near_kernel.shape[1]),), "near kernel")
        self._places: IntArray = np.arange(self.n) if places is None else _without_gaps(places)
        self._block = 1 if places is None else 3
        self._size = self._block * (int(self._places.max(initial=-1)) // self._block + 1)
        self._near_kernel = np.zeros((self._size, near.shape[1]))
        self._near_kernel[self._places] = near
        self.negative = -1

    def _factor(self, data: Array) -> None:
        from pyamg import smoothed_aggregation_solver

        hierarchy = smoothed_aggregation_solver(
            self._in_blocks(data),
            B=self._near_kernel,
            symmetry="symmetric",
            max_coarse=500,
            improve_candidates=None,
        )
        self._cycle = hierarchy.aspreconditioner()

    def _in_blocks(self, data: Array) -> sparse.bsr_matrix:
        """Return the matrix in blocks of nodes, with 1 on the diagonal for an unknown that a node lacks."""
        entries = self._pattern.full(data).tocoo()
        lacking = np.setdiff1d(np.arange(self._size), self._places)
        rows = np.concatenate([self._places[entries.row], lacking])
        columns = np.concatenate([self._places[entries.col], lacking])
        values = np.concatenate([entries.data, np.ones(len(lacking))])
        whole = sparse.csr_matrix((values, (rows, columns)), shape=(self._size, self._size))
        return whole.tobsr(blocksize=(self._block, self._block))

    def _solve(self, rhs: Array) -> Array:
        padded = np.zeros((self._size, *rhs.shape[1:]))
        padded[self._places] = rhs
        if rhs.ndim == 1:
            whole: Array = np.asarray(self._cycle @ padded)
        else:
            whole = np.stack([self._cycle @ column for column in padded.T], axis=1)
        return whole[self._places]


def _without_gaps(places: IntArray) -> IntArray:
    """Return the places in a list of those nodes alone that have an unknown."""
    _, node = np.unique(places // 3, return_inverse=True)
    return np.asarray(3 * node + places % 3)


class SymmetricPattern:
    """An upper triangular pattern and the full matrix that belongs to it."""

    def __init__(self, indptr: Indices, indices: Indices) -> None:
        n = len(indptr) - 1
        upper = sparse.csr_matrix(
            (np.arange(1, len(indices) + 1, dtype=np.int64), indices, indptr), shape=(n, n)
        )
        full = (upper + sparse.triu(upper, 1).T).tocsr()
        full.sort_indices()
        self._indptr, self._indices, self._source = full.indptr, full.indices, full.data - 1
        self._shape = (n, n)
        #: Places of the diagonal among the entries of the upper triangle.
        self.diagonal = np.asarray(indptr[:-1])

    def full(self, data: Array) -> sparse.csr_matrix:
        """Return the symmetric matrix in CSR from the entries of its upper triangle."""
        return sparse.csr_matrix((data[self._source], self._indices, self._indptr), shape=self._shape)


def choose_factor(
    indptr: Indices,
    indices: Indices,
    *,
    solver: str,
    near_kernel: Array,
    places: IntArray | None = None,
    single: bool = True,
) -> SymmetricFactor:
    """Return the fastest installed solver for the size; ``solver`` forces one of pardiso, superlu, amg.

    ``near_kernel`` and ``places`` are those of :class:`MultigridFactor`. ``single`` precision is for a factor that
    preconditions; only PARDISO offers it.
    """
    n = len(indptr) - 1
    have_pardiso = pardiso.library() is not None
    have_amg = find_spec("pyamg") is not None
    if solver == "auto":
        if have_amg and (n > DIRECT_LIMIT or (not have_pardiso and n > SUPERLU_LIMIT)):
            solver = "amg"
        else:
            solver = "pardiso" if have_pardiso else "superlu"
    if solver == "pardiso":
        if not have_pardiso:
            raise ConfigurationError("fem.options.solver: pardiso is not installed; run pip install mkl")
        return pardiso.PardisoFactor(indptr, indices, single=single)
    if solver == "amg" and have_amg:
        return MultigridFactor(indptr, indices, near_kernel, places)
    if solver == "superlu":
        return SuperLUFactor(indptr, indices)
    raise ConfigurationError(
        f"fem.options.solver: expected auto, pardiso, superlu or amg (pip install pyamg), got '{solver}'"
    )


#: Entries of a product with a sparse matrix are wrong by so much at most, as shares of the sum of magnitudes.
ROUND_OFF = 2 * np.finfo(float).eps


@dataclass(frozen=True)
class Iteration:
    """Result of an iterative solve."""

    x: Array
    iterations: int
    converged: bool
    indefinite: bool  #: a direction of negative curvature was met


def refine(
    matrix: sparse.csr_matrix,
    rhs: Array,
    solve: Callable[[Array], Array],
    *,
    tolerance: float,
    limit: int = 30,
) -> Iteration:
    """Solve for the columns of (n, k) by iterative refinement with a factor of ``matrix`` itself, definite or not.

    It ends when every residual is below ``tolerance`` times its right-hand side, or no longer falls. In the second case
    it has converged if the residuals are round-off of the product ``matrix @ x``: near an instability x is so large
    that no solver leaves smaller ones (backward error; Higham, Accuracy and Stability of Numerical Algorithms, 7.1).
    """
    goal = tolerance * np.linalg.norm(rhs, axis=0)
    x = np.zeros_like(rhs)
    r = rhs.copy()
    worst = np.inf
    for iterations in range(limit + 1):
        norms = np.linalg.norm(r, axis=0)
        if (norms <= goal).all():
            return Iteration(x, iterations, True, False)
        relative = (norms / np.where(goal > 0, goal, 1.0)).max()
        if not relative < worst:
            break
        worst = relative
        x += solve(r)
        r = rhs - matrix @ x
    return Iteration(
        x, iterations, bool((norms <= np.maximum(goal, _round_off(matrix, x, rhs))).all()), False
    )


def _round_off(matrix: sparse.csr_matrix, x: Array, rhs: Array) -> Array:
    """Return the norms (k,) of the residuals that round-off leaves if each entry of x is right to the last bit."""
    return np.asarray(ROUND_OFF * np.linalg.norm(abs(matrix) @ np.abs(x) + np.abs(rhs), axis=0))


def conjugate_gradients(
    apply: Callable[[Array], Array],
    rhs: Array,
    precondition: Callable[[Array], Array],
    *,
    tolerance: float,
    limit: int = 200,
) -> Iteration:
    """Solve for (n,), or for the columns of (n, k) at once, by preconditioned conjugate gradients.

    ``apply`` multiplies by the matrix. Stops when every residual is below ``tolerance`` times its right-hand side.
    """
    single = rhs.ndim == 1
    b = rhs[:, None] if single else rhs
    goal = tolerance * np.linalg.norm(b, axis=0)
    x = np.zeros_like(b)
    r = b.copy()
    p = z = precondition(r)
    rz = (r * z).sum(axis=0)
    iterations, indefinite = 0, False
    active = ~(np.linalg.norm(r, axis=0) <= goal)  # what is not a number is not small
    while active.any() and iterations < limit:
        q = apply(p)
        curvature = (p * q).sum(axis=0)
        if (curvature[active] <= 0).any():
            indefinite = True
            break
        alpha = np.where(active, rz / np.where(curvature > 0, curvature, 1.0), 0.0)
        x += alpha * p
        r -= alpha * q
        iterations += 1
        active = ~(np.linalg.norm(r, axis=0) <= goal)
        if not active.any():
            break
        z = precondition(r)
        rz_new = (r * z).sum(axis=0)
        p = z + np.where(active, rz_new / np.where(rz != 0, rz, 1.0), 0.0) * p
        rz = rz_new
    return Iteration(x[:, 0] if single else x, iterations, not active.any(), indefinite)
