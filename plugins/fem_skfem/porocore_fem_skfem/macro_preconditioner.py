"""Blocks of the preconditioner of a macro step: multigrid cycles with Chebyshev smoothers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from porocore.cell.equilibrium.discrete import FactorError
from porocore.macro.linear_systems import LinearLevel
from porocore.states import Array, IntArray
from porocore_fem_skfem import pardiso
from porocore_fem_skfem.products import Product

Apply = Callable[[Array], Array]
#: Nodes are solved for together where an entry that couples them is larger than this share of the diagonal.
STRONG = 0.3
#: Degree of the polynomial, and the part of the spectrum [λ / REACH, ABOVE λ] that it damps.
DEGREE, REACH, ABOVE = 3, 15.0, 1.1
#: Steps of Arnoldi's method that λ comes from.
ARNOLDI = 10


class ChebyshevSmoother:
    """Chebyshev's polynomial of B A with a sparse B, the dense inverses of groups of nodes.

    Parameters
    ----------
    matrix
        Blocks of 3 × 3 of all nodes.
    apply
        Product with it under the supports, from and to vectors (3 nodes,) that are zero where they hold.
    held : (nodes, 3) bool
        True where an unknown takes no part.
    shared
        Diagonal entries (unknown, value) of those unknowns that stand for several.

    Raises
    ------
    LinAlgError
        A group of nodes is singular, or the matrix is zero or not finite.
    """

    def __init__(
        self,
        matrix: sparse.bsr_matrix,
        apply: Apply,
        held: npt.NDArray[np.bool_],
        shared: tuple[IntArray, Array],
    ) -> None:
        blocks, inner = _free_blocks(matrix, held, shared)
        groups = _groups(matrix, blocks, inner)
        self._inverse = Product(_inverses(matrix, blocks, held, groups), np.float32)
        self._free = ~held.ravel()
        largest = self._largest(apply)
        if not 0 < largest < np.inf:
            raise np.linalg.LinAlgError("the tangent is zero or not finite")
        low, high = largest / REACH, ABOVE * largest
        self._centre, self._half = (high + low) / 2, (high - low) / 2

    def smooth(self, apply: Apply, r: Array) -> tuple[Array, Array]:
        """Return an approximate solution d of A d = r, and the residual r − A d."""
        scale = self._centre / self._half
        rho = 1 / scale
        d = self._scaled(r) / self._centre
        x = d.copy()
        r = r - apply(d)
        for _ in range(DEGREE - 1):
            after = 1 / (2 * scale - rho)
            d = after * rho * d + 2 * after / self._half * self._scaled(r)
            rho = after
            x += d
            r = r - apply(d)
        return x, r

    def _scaled(self, r: Array) -> Array:
        return np.asarray(self._inverse @ r)

    def _largest(self, apply: Apply) -> float:
        """Return the largest magnitude of an eigenvalue of B A, by a few steps of Arnoldi's method."""
        v = np.random.default_rng(0).standard_normal(len(self._free)) * self._free
        basis = [v / np.linalg.norm(v)]
        H = np.zeros((ARNOLDI + 1, ARNOLDI))
        for k in range(ARNOLDI):
            w = self._scaled(apply(basis[k]))
            for i, b in enumerate(basis):
                H[i, k] = b @ w
                w = w - H[i, k] * b
            H[k + 1, k] = np.linalg.norm(w)
            if not H[k + 1, k] > 0:
                return float(np.abs(np.linalg.eigvals(H[: k + 1, : k + 1])).max())
            basis.append(w / H[k + 1, k])
        return float(np.abs(np.linalg.eigvals(H[:ARNOLDI])).max())


def _free_blocks(
    matrix: sparse.bsr_matrix, held: npt.NDArray[np.bool_], shared: tuple[IntArray, Array]
) -> tuple[Array, Array]:
    """Return the diagonal blocks (nodes, 3, 3) with unit rows where held, and 1/√|diagonal| that is zero there."""
    n = len(held)
    rows = np.repeat(np.arange(n), np.diff(matrix.indptr))
    blocks = np.zeros((n, 3, 3))
    on = np.flatnonzero(rows == matrix.indices)
    blocks[rows[on]] = matrix.data[on]
    unknowns, values = shared
    blocks[unknowns // 3, unknowns % 3, unknowns % 3] = values
    free = (~held).astype(float)
    blocks *= free[:, :, None] * free[:, None, :]
    diagonal = np.einsum("nii->ni", blocks)
    size = np.abs(diagonal)
    inner = np.where(size > 0, 1 / np.sqrt(np.where(size > 0, size, 1.0)), 0.0)
    diagonal[size == 0] = 1.0
    return blocks, inner


def _groups(matrix: sparse.bsr_matrix, blocks: Array, inner: Array) -> IntArray:
    """Return the number (nodes,) of the group of each node."""
    from pyamg.aggregation import standard_aggregation

    n = len(blocks)
    rows, columns = np.repeat(np.arange(n), np.diff(matrix.indptr)), matrix.indices
    strong = np.zeros(len(columns), bool)
    chunk = 1_000_000
    for first in range(0, len(columns), chunk):
        part = slice(first, first + chunk)
        scale = inner[rows[part], :, None] * inner[columns[part], None, :]
        strong[part] = (np.abs(matrix.data[part]) * scale).max(axis=(1, 2)) > STRONG
    strong &= rows != columns
    graph = sparse.csr_matrix((np.ones(int(strong.sum())), (rows[strong], columns[strong])), shape=(n, n))
    graph = (graph + graph.T).tocsr()
    group = np.full(n, -1, dtype=np.int64)
    count = 0
    if graph.nnz:
        members = standard_aggregation(graph)[0].tocsr()
        of = np.diff(members.indptr) > 0
        group[of], count = members.indices, members.shape[1]
    alone = group < 0
    group[alone] = count + np.arange(int(alone.sum()))
    return group


def _inverses(
    matrix: sparse.bsr_matrix, blocks: Array, held: npt.NDArray[np.bool_], group: IntArray
) -> sparse.bsr_matrix:
    """Return the block diagonal matrix of the inverses of all groups, in blocks of nodes."""
    n = len(group)
    size = np.bincount(group)
    order = np.argsort(group, kind="stable")
    place = np.empty(n, dtype=np.int64)
    place[order] = np.arange(n) - np.repeat(np.cumsum(size) - size, size)
    rows, columns = np.repeat(np.arange(n), np.diff(matrix.indptr)), matrix.indices
    inside = np.flatnonzero((group[rows] == group[columns]) & (rows != columns))
    found: list[tuple[IntArray, IntArray, Array]] = []
    for s in np.unique(size).tolist():
        which = np.flatnonzero(size == s)
        number = np.full(len(size), -1)
        number[which] = np.arange(len(which))
        nodes = np.flatnonzero(size[group] == s)
        whole = np.zeros((len(which), s, 3, s, 3))
        whole[number[group[nodes]], place[nodes], :, place[nodes]] = blocks[nodes]
        own = inside[size[group[rows[inside]]] == s]
        i, j = rows[own], columns[own]
        coupled = matrix.data[own] * ~held[i][:, :, None] * ~held[j][:, None, :]
        whole[number[group[i]], place[i], :, place[j]] = coupled
        inverse = np.linalg.inv(whole.reshape(len(which), 3 * s, 3 * s)).reshape(len(which), s, 3, s, 3)
        members = np.empty((len(which), s), dtype=np.int64)
        members[number[group[nodes]], place[nodes]] = nodes
        shape = (len(which), s, s)
        found.append(
            (
                np.broadcast_to(members[:, :, None], shape).ravel(),
                np.broadcast_to(members[:, None, :], shape).ravel(),
                inverse.transpose(0, 1, 3, 2, 4).reshape(-1, 3, 3),
            )
        )
    row, column, data = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.lexsort((column, row))
    starts = np.searchsorted(row[order], np.arange(n + 1))
    return sparse.bsr_matrix((data[order], column[order], starts), shape=(3 * n, 3 * n))


#: Unknowns of the linear level up to which a factor solves on it: at more, multigrid is faster.
FACTORED = 50_000
#: Nodes of the coarsest level of multigrid, and its cycles for the displacements.
COARSEST, CYCLES = 600, 2

Solve = Callable[[Array], Array]


class DisplacementCycle:
    """Approximate inverse of the forces by displacements in single precision: smoother, linear level, smoother.

    Parameters
    ----------
    matrix
        Forces by displacements in blocks of all nodes, whatever is prescribed.
    apply
        Product with it under the supports.
    level
        Linear displacements.
    smoother
        On the quadratic displacements.
    """

    def __init__(self, matrix: sparse.bsr_matrix, level: LinearLevel, smoother: ChebyshevSmoother) -> None:
        self._smoother = smoother
        blocks = level.prolongation.tobsr(blocksize=(3, 3))
        coarse = (blocks.T.tobsr(blocksize=(3, 3)) @ (matrix @ blocks)).tobsr(blocksize=(3, 3))
        idle = ~level.active
        mean = float(np.abs(coarse.diagonal()[level.active]).mean()) if level.active.any() else 1.0
        coarse = (coarse + sparse.diags(mean * idle)).tobsr(blocksize=(3, 3))
        coarse.sort_indices()
        self._prolongation = level.prolongation.astype(np.float32)
        self._restriction = self._prolongation.T.tocsr()
        self._solve = _inverse(coarse, level.modes, "block_gauss_seidel", CYCLES)

    def solve(self, apply: Apply, r: Array) -> Array:
        """Return the inverse applied to forces that are zero where prescribed, all in single precision."""
        x, r = self._smoother.smooth(apply, r)
        change = self._prolongation @ self._solve(self._restriction @ r).astype(np.float32)
        after, _ = self._smoother.smooth(apply, r - apply(change))
        return np.asarray(x + change + after)


def _inverse(matrix: Any, modes: Array, relaxation: str, cycles: int) -> Solve:
    """Return an approximate inverse: a factor, or cycles of multigrid that knows fields of little energy."""
    if matrix.shape[0] <= FACTORED and pardiso.library() is not None:
        rows = _with_symmetric_pattern(matrix)
        factor = pardiso.GeneralFactor(rows.indptr, rows.indices, single=True)
        try:
            factor.factor(rows.data)
        except FactorError:
            pass
        else:
            return factor.solve
    return _multigrid(matrix, modes, relaxation, cycles)


def _with_symmetric_pattern(matrix: Any) -> sparse.csr_matrix:
    """Return the matrix in sorted CSR with zeros where sums and products of matrices have left them out."""
    m = matrix.tocoo()
    diagonal = np.arange(m.shape[0])
    rows, columns = (np.concatenate([*pair, diagonal]) for pair in ((m.row, m.col), (m.col, m.row)))
    data = np.concatenate([m.data, np.zeros(len(rows) - len(m.data))])
    found = sparse.csr_matrix((data, (rows, columns)), shape=m.shape)
    found.sort_indices()
    return found


def pressure_cycle(matrix: sparse.csr_matrix, held: npt.NDArray[np.bool_]) -> Solve:
    """Return an approximate inverse of the Schur complement, with unit rows where the pressure is prescribed."""
    free = sparse.diags((~held).astype(float))
    matrix = (free @ matrix @ free + sparse.diags(held * float(np.abs(matrix.diagonal()).mean()))).tocsr()
    matrix.sort_indices()
    return _inverse(matrix, (~held).astype(float)[:, None], "gauss_seidel", 1)


def _multigrid(matrix: Any, modes: Array, relaxation: str, cycles: int) -> Solve:
    from pyamg import smoothed_aggregation_solver

    smoother = (relaxation, {"sweep": "symmetric"})
    with _same_random_numbers():
        hierarchy = smoothed_aggregation_solver(
            matrix,
            B=modes,
            symmetry="symmetric",
            strength=("symmetric", {"theta": 0.0}),
            presmoother=smoother,
            postsmoother=smoother,
            max_coarse=COARSEST,
            improve_candidates=None,
            coarse_solver="splu",
        )

    def solve(r: Array) -> Array:
        return np.asarray(hierarchy.solve(r, x0=np.zeros_like(r), tol=1e-300, maxiter=cycles, cycle="V"))

    return solve


@contextmanager
def _same_random_numbers() -> Iterator[None]:
    """Have pyamg, which estimates eigenvalues from numpy's global random numbers, do so alike every time."""
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(state)  # noqa: NPY002
