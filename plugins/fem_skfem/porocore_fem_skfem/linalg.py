"""Symmetric linear systems: choice by size, SuperLU, iterative refinement, conjugate gradients.

A factor may be of single precision, of a neighbouring state or no factor at all; the iteration makes up
for it and notices negative curvature. Patterns are upper triangles in CSR with the diagonal first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse.linalg import SuperLU, splu

from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray
from porocore_fem_skfem import pardiso
from porocore_fem_skfem.factor import Indices, OutOfMemoryError, SingularError, SymmetricFactor

#: Beyond this number of unknowns multigrid is taken. A state with its derivatives takes 3.1 s by multigrid and 3.2 s by
#: factors at 46,000 unknowns, 15 s by both at 126,000; the first state takes 3 and 21 s more by factors.
DIRECT_LIMIT = 50_000
#: Up to this number of unknowns a factor takes over where multigrid fails, as of an indefinite tangent. At 314,000 it
#: takes 87 s and 7 GB with a state.
FACTOR_LIMIT = 350_000
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


def iterates(n: int, solver: str, limit: int = DIRECT_LIMIT) -> bool:
    """Return whether n unknowns are solved by multigrid; ``solver`` forces one of pardiso, superlu, amg.

    ``limit`` is the number of unknowns up to which PARDISO is faster.

    Raises
    ------
    ConfigurationError
        There is no such solver, or it is not installed.
    """
    if solver not in ("auto", "pardiso", "superlu", "amg"):
        raise ConfigurationError(
            f"fem.options.solver: expected auto, pardiso, superlu or amg (pip install pyamg), got '{solver}'"
        )
    have_amg = find_spec("pyamg") is not None
    if solver == "amg" and not have_amg:
        raise ConfigurationError("fem.options.solver: amg is not installed; run pip install pyamg")
    limit = SUPERLU_LIMIT if pardiso.library() is None else limit
    return solver == "amg" or (solver == "auto" and have_amg and n > limit)


def choice_in_words(n: int, solver: str, iteration: str = "") -> str:
    """Return unknowns and linear solver for the log; ``iteration`` is what takes the place of a factor, if any."""
    if iteration:
        return f"{n:,} unknowns by {iteration} with multigrid"
    name = "SuperLU" if solver == "superlu" or pardiso.library() is None else "PARDISO"
    return f"{n:,} unknowns by factors of {name}"


def choose_factor(indptr: Indices, indices: Indices, *, solver: str, single: bool = True) -> SymmetricFactor:
    """Return the fastest installed factor; ``solver`` forces one of pardiso and superlu.

    ``single`` precision is for a factor that preconditions; only PARDISO offers it.
    """
    have_pardiso = pardiso.library() is not None
    if solver == "pardiso" and not have_pardiso:
        raise ConfigurationError("fem.options.solver: pardiso is not installed; run pip install mkl")
    if solver != "superlu" and have_pardiso:
        return pardiso.PardisoFactor(indptr, indices, single=single)
    return SuperLUFactor(indptr, indices)


#: Entries of a product with a sparse matrix are wrong by so much at most, as shares of the sum of magnitudes.
ROUND_OFF = 2 * np.finfo(float).eps
#: Least part of a unit column outside of the others for which one orthonormalisation is enough.
INDEPENDENT = 1e-3


@dataclass(frozen=True)
class Iteration:
    """Result of an iterative solve."""

    x: Array
    iterations: int
    converged: bool
    indefinite: bool  #: a direction of negative curvature was met
    product: Array | None = None  #: the matrix times x, where it is known


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
    r, product = rhs.copy(), x
    worst = np.inf
    for iterations in range(limit + 1):
        norms = np.linalg.norm(r, axis=0)
        if (norms <= goal).all():
            return Iteration(x, iterations, True, False, product)
        relative = (norms / np.where(goal > 0, goal, 1.0)).max()
        if not relative < worst:
            break
        worst = relative
        x = x + solve(r)
        product = matrix @ x
        r = rhs - product
    good = bool((norms <= np.maximum(goal, _round_off(matrix, x, rhs))).all())
    return Iteration(x, iterations, good, False, product)


def _round_off(matrix: sparse.csr_matrix, x: Array, rhs: Array) -> Array:
    """Return the norms (k,) of the residuals that round-off leaves if each entry of x is right to the last bit."""
    return np.asarray(ROUND_OFF * np.linalg.norm(abs(matrix) @ np.abs(x) + np.abs(rhs), axis=0))


def conjugate_gradients(
    apply: Callable[[Array], Array],
    rhs: Array,
    precondition: Callable[[Array], Array],
    *,
    tolerance: float | Array,
    limit: int = 200,
) -> Iteration:
    """Solve for (n,), or for the columns of (n, k) at once, by preconditioned conjugate gradients.

    ``apply`` multiplies by the matrix. Stops when every residual is below ``tolerance``, one for all or one for each
    column, times its right-hand side.
    """
    single = rhs.ndim == 1
    b = rhs[:, None] if single else rhs
    goal = tolerance * np.linalg.norm(b, axis=0)
    x, step = np.zeros_like(b), np.empty_like(b)
    r = b.copy()
    p = z = precondition(r)
    rz = _products(r, z)
    iterations, indefinite = 0, False
    active = ~(np.sqrt(_products(r, r)) <= goal)  # what is not a number is not small
    while active.any() and iterations < limit:
        q = apply(p)
        curvature = _products(p, q)
        if (curvature[active] <= 0).any():
            indefinite = True
            break
        alpha = np.where(active, rz / np.where(curvature > 0, curvature, 1.0), 0.0)
        x += np.multiply(alpha, p, out=step)
        r -= np.multiply(alpha, q, out=step)
        iterations += 1
        active = ~(np.sqrt(_products(r, r)) <= goal)
        if not active.any():
            break
        z = precondition(r)
        rz_new = _products(r, z)
        p = z + np.multiply(np.where(active, rz_new / np.where(rz != 0, rz, 1.0), 0.0), p, out=step)
        rz = rz_new
    return Iteration(x[:, 0] if single else x, iterations, not active.any(), indefinite)


def block_conjugate_gradients(
    apply: Callable[[Array], Array],
    rhs: Array,
    precondition: Callable[[Array], Array],
    *,
    group: IntArray,
    tolerance: float | Array,
    limit: int = 200,
) -> Iteration:
    """Solve as :func:`conjugate_gradients`, the columns of a group (k,) in the Krylov space of all of them.

    That takes fewer iterations where a few eigenvalues are small. Residuals are kept in an orthonormal basis (Dubrulle,
    Electron. Trans. Numer. Anal. 12, 2001, 216-233). Where one does not exist, or the curvature in the space is not
    positive, each column is solved for by itself from the start.
    """
    same, goal = np.equal.outer(group, group), tolerance * np.linalg.norm(rhs, axis=0)
    x = np.zeros_like(rhs)
    try:
        basis, shares = _orthonormal(rhs, same)
        p = z = precondition(basis)
        rho = same * (basis.T @ z)
        for iterations in range(1, limit + 1):
            q = apply(p)
            curvature = same * (p.T @ q)
            alpha = cho_solve(cho_factor((curvature + curvature.T) / 2), rho)
            x += p @ (alpha @ shares)
            basis, change = _orthonormal(basis - q @ alpha, same)
            shares = change @ shares
            if (np.linalg.norm(shares, axis=0) <= goal).all():
                return Iteration(x, iterations, True, False)
            z = precondition(basis)
            rho, last = same * (basis.T @ z), rho
            p = z + p @ np.linalg.solve(last, change.T @ rho)
    except (np.linalg.LinAlgError, ValueError):  # the second one where something is not finite
        return conjugate_gradients(apply, rhs, precondition, tolerance=tolerance, limit=limit)
    return Iteration(x, limit, False, False)


def _orthonormal(columns: Array, same: npt.NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return an orthonormal basis of each group of columns, and the shares (k, k) that make the columns of it."""
    shares = np.eye(columns.shape[1])
    for _ in range(2):
        gram = same * (columns.T @ columns)
        scale = np.sqrt(np.diag(gram))
        if not scale.all():
            raise np.linalg.LinAlgError("a column vanishes")
        upper = np.linalg.cholesky(gram / np.outer(scale, scale)).T
        columns = columns @ (np.linalg.inv(upper) / scale[:, None])
        shares = upper * scale @ shares
        if np.diag(upper).min() > INDEPENDENT:
            break
    return columns, shares


def _products(one: Array, other: Array) -> Array:
    """Return the inner products (k,) of the columns of two (n, k)."""
    return np.asarray(np.einsum("ij,ij->j", one, other))
