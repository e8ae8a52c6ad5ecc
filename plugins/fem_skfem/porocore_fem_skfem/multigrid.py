"""Algebraic multigrid by smoothed aggregation (Multigrid), as a preconditioner.

One cycle is a symmetric and positive definite approximation of the inverse, even of a matrix that is not quite positive
definite: a Chebyshev polynomial has |p| < 1 on (0, b], b above the largest eigenvalue, and p > 1 below 0, so the part
(1 − p²)/t of a smoother is positive on both sides of 0, and the coarsest matrix is factorised by Cholesky. Where
Cholesky's factor of that matrix, or of the block of a node, does not exist, the fine matrix is indefinite, for they are
its restrictions to subspaces.

A group's motions are known from the places of its nodes, so they are also right where it lies across the faces of a
periodic cell. Rotations about the middle of the cell, which are usual as near kernel, have a jump there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve

from porocore.cell.equilibrium.discrete import FactorError
from porocore.states import Array, IntArray
from porocore_fem_skfem.node_grid import NodeGrid, PaddedPattern
from porocore_fem_skfem.products import Product, SparseMatrix, block_of, in_blocks

#: Squared norms of a group's motions, of the largest, below which one depends on the others.
DEPENDENT = 1e-8


@dataclass(frozen=True, eq=False)
class Nodes:
    """Nodes of one level of multigrid.

    Attributes
    ----------
    points : (nodes, 3)
        Their places.
    motions : (nodes, b, m)
        Values of the b unknowns of a node in the m fields of least energy: six rigid motions about the node itself, or
        the constant for a scalar. Zero where an unknown is held.
    spans : (3,)
        Periods of the cell; infinite without them.
    """

    points: Array
    motions: Array
    spans: Array


def aggregated(matrix: SparseMatrix, nodes: Nodes) -> tuple[SparseMatrix, Nodes, npt.NDArray[np.bool_]]:
    """Return the prolongation from groups of nodes, the groups, and which of their unknowns take part (unknowns,).

    Nodes that share an entry of ``matrix`` are neighbours, whatever its value. The columns are orthonormal.
    """
    count, block, motions = nodes.motions.shape
    group = _groups(matrix, block)
    groups = int(group.max()) + 1
    first = np.zeros(groups, dtype=np.int64)
    first[group[::-1]] = np.arange(count)[::-1]
    away = nodes.points - nodes.points[first[group]]
    away = away - np.where(np.isfinite(nodes.spans), nodes.spans, 0.0) * np.round(away / nodes.spans)
    size = np.bincount(group, minlength=groups)[:, None]
    mean = np.stack([np.bincount(group, column, groups) for column in away.T], axis=1) / size
    fields = nodes.motions @ _about_another_point(away - mean[group]) if motions == 6 else nodes.motions
    products = fields.transpose(0, 2, 1) @ fields
    flat = products.reshape(count, -1)
    gram = np.stack([np.bincount(group, column, groups) for column in flat.T], axis=1)
    values, vectors = np.linalg.eigh(gram.reshape(groups, motions, motions))
    kept = values > DEPENDENT * np.maximum(values[:, -1:], np.finfo(float).tiny)
    roots = np.sqrt(np.where(kept, values, 1.0))
    fields = fields @ (vectors * (kept / roots)[:, None, :])[group]
    blocks = sparse.bsr_matrix((fields, group, np.arange(count + 1)), shape=(count * block, groups * motions))
    of_groups = (kept * roots)[:, :, None] * vectors.transpose(0, 2, 1)
    return (
        in_blocks(blocks, block, motions),
        Nodes(nodes.points[first] + mean, of_groups, nodes.spans),
        kept.ravel(),
    )


def _groups(matrix: SparseMatrix, block: int) -> IntArray:
    """Return the number of each node's group; a node without neighbours is a group of its own."""
    from pyamg.aggregation import standard_aggregation

    blocks = matrix.tobsr(blocksize=(block, block))
    count = matrix.shape[0] // block
    graph = sparse.csr_matrix(
        (np.ones(len(blocks.indices)), blocks.indices, blocks.indptr), shape=(count, count)
    )
    found = standard_aggregation(graph)[0]
    group, alone = np.full(count, -1, dtype=np.int64), np.diff(found.indptr) == 0
    group[~alone] = found.indices
    group[alone] = found.shape[1] + np.arange(int(alone.sum()))
    return group


def _about_another_point(away: Array) -> Array:
    """Return the maps (k, 6, 6) of a rigid motion about a point to that about a point ``away`` (k, 3) from it."""
    maps = np.tile(np.eye(6), (len(away), 1, 1))
    x, y, z = away.T
    maps[:, 0, 4], maps[:, 0, 5] = z, -y
    maps[:, 1, 3], maps[:, 1, 5] = -z, x
    maps[:, 2, 3], maps[:, 2, 4] = y, -x
    return maps


#: Degree of the smoothing polynomials, and largest over smallest eigenvalue that they damp. At 46,000 unknowns eleven
#: right-hand sides take 28 iterations and 2.7 s to 1e-10, with degree 3 and a ratio of 15 they take 23 and 3.0 s.
DEGREE, RATIO = 2, 10.0
#: The same on the levels of groups, which are small.
COARSE_RATIO = 8.0
#: Unknowns of the coarsest level, which is factorised as a full matrix.
COARSEST = 1_500
#: What it may have where nodes do not group any further.
LARGEST_COARSEST = 6_000
#: Steps of Lanczos' iteration for the largest eigenvalue, and the factor on what they find.
STEPS, SAFETY = 12, 1.1
#: Damping of the interpolation from groups, over the largest eigenvalue.
SMOOTHING = 4 / 3

#: np.float32 or np.float64.
Precision = type[np.floating[Any]]


class IndefiniteError(FactorError):
    """The matrix is not positive definite, as its restriction to a subspace shows."""


class _Level:
    """A matrix, the inverse of its diagonal blocks, and a Chebyshev polynomial of their product as smoother."""

    def __init__(self, matrix: SparseMatrix, ratio: float, dtype: Precision) -> None:
        blocks = _diagonal_blocks(matrix)
        try:
            np.linalg.cholesky(blocks)
        except np.linalg.LinAlgError as error:
            raise IndefiniteError("the block of a node is not positive definite") from error
        self.inverse = _block_diagonal(np.linalg.inv(blocks))
        self.largest = _largest_eigenvalue(matrix, self.inverse)
        self._matrix, self._inverse = Product(matrix, dtype), Product(self.inverse, dtype)
        high = SAFETY * self.largest
        self._middle, self._half = (high + high / ratio) / 2, (high - high / ratio) / 2

    def smooth(self, r: Any) -> tuple[Any, Any]:
        """Return the smoother's answer to a residual, and the residual that it leaves."""
        x, r, d = self._smoothed(r)
        return x, r - self._matrix @ d

    def answer(self, r: Any) -> Any:
        """Return the smoother's answer to a residual."""
        return self._smoothed(r)[0]

    def _smoothed(self, r: Any) -> tuple[Any, Any, Any]:
        """Return the answer, the residual before its last step, and that step."""
        sigma = self._middle / self._half
        rho = 1 / sigma
        d = (self._inverse @ r) * r.dtype.type(1 / self._middle)
        x = d
        for _ in range(1, DEGREE):
            r = r - self._matrix @ d
            last, rho = rho, 1 / (2 * sigma - rho)
            d = d.dtype.type(rho * last) * d + d.dtype.type(2 * rho / self._half) * (self._inverse @ r)
            x = x + d
        return x, r, d

    def apply(self, x: Any) -> Any:
        """Return the product of the matrix with x."""
        return self._matrix @ x


class Multigrid:
    """Cycles of multigrid for matrices of one pattern.

    Parameters
    ----------
    pattern
        Pattern of the matrices.
    grid
        Nodes of their unknowns.
    dtype
        Precision of a cycle. A single one takes half the time and serves conjugate gradients as well; iterations of
        short recurrences for indefinite systems want the double one.
    """

    def __init__(self, pattern: PaddedPattern, grid: NodeGrid, dtype: Precision = np.float32) -> None:
        self._dtype = dtype
        corners, to_corners = np.unique(grid.ends[pattern.used], return_inverse=True)
        present = np.isin(corners, pattern.used)
        self._linear: SparseMatrix | None = None
        points, free, b = grid.points[pattern.used], pattern.free, grid.components
        if len(corners) < len(pattern.used):
            numbers = np.searchsorted(pattern.used, corners[present])
            points, free = points[numbers], free.reshape(-1, b)[numbers].ravel()
            self._linear = _interpolation(to_corners.reshape(-1, 2), present, pattern.free, free, b)
        #: Unknowns of the linear level that are held.
        self._held = ~free
        motions = np.zeros((len(points), b, 6 if b == 3 else 1))
        motions[:, range(b), range(b)] = free.reshape(-1, b)
        self._nodes = Nodes(points, motions, grid.spans)
        self._groups: list[tuple[SparseMatrix, Nodes, npt.NDArray[np.bool_]]] = []
        self._levels: list[_Level] = []

    @property
    def sizes(self) -> list[int]:
        """Unknowns of the levels."""
        return [*(level.inverse.shape[0] for level in self._levels), len(self._coarsest[0])]

    def set_up(self, matrix: SparseMatrix) -> None:
        """Set up for a matrix of the pattern.

        Raises
        ------
        IndefiniteError
            It is not positive definite.
        FactorError
            Its nodes do not group into few enough.
        """
        self._levels, self._between = [], list[tuple[Product, Product]]()
        if self._linear is not None:
            self._levels.append(_Level(matrix, RATIO, self._dtype))
            matrix = _filled(self._restricted(matrix, self._linear, block_of(matrix)[0]), self._held)
        depth = 0
        while matrix.shape[0] > COARSEST:
            level = _Level(matrix, COARSE_RATIO, self._dtype)
            if depth == len(self._groups):
                self._groups.append(aggregated(matrix, self._nodes if not depth else self._groups[-1][1]))
            tentative, groups, active = self._groups[depth]
            if tentative.shape[1] >= matrix.shape[0]:
                break
            self._levels.append(level)
            smoothed = tentative - (SMOOTHING / level.largest) * (level.inverse @ (matrix @ tentative))
            matrix = _filled(self._restricted(matrix, smoothed, groups.motions.shape[1]), ~active)
            depth += 1
        if matrix.shape[0] > LARGEST_COARSEST:
            raise FactorError(f"no level of multigrid below {matrix.shape[0]:,} unknowns was found")
        try:
            self._coarsest = cho_factor(matrix.toarray())
        except np.linalg.LinAlgError as error:
            raise IndefiniteError("the coarsest level is not positive definite") from error
        self._coarsest = (self._coarsest[0].astype(self._dtype), self._coarsest[1])

    def cycle(self, residual: Array) -> Array:
        """Return the approximate inverse applied to (n,) or (n, k)."""
        return np.asarray(self._cycle(residual.astype(self._dtype), 0), np.float64)

    def _restricted(self, matrix: SparseMatrix, prolongation: SparseMatrix, columns: int) -> SparseMatrix:
        """Return the matrix of the next level, with blocks of so many unknowns."""
        rows, transposed = block_of(matrix)[0], prolongation.T
        self._between.append((Product(prolongation, self._dtype), Product(transposed.tocsr(), self._dtype)))
        blocks = in_blocks(prolongation, rows, columns)
        return in_blocks(transposed, columns, rows) @ (matrix @ blocks)

    def _cycle(self, r: Any, depth: int) -> Any:
        if depth == len(self._levels):
            return cho_solve(self._coarsest, r, check_finite=False)
        level, (prolong, restrict) = self._levels[depth], self._between[depth]
        x, r = level.smooth(r)
        correction = prolong @ self._cycle(restrict @ r, depth + 1)
        x = x + correction
        x += level.answer(r - level.apply(correction))
        return x


def _interpolation(
    ends: IntArray, present: npt.NDArray[np.bool_], free: npt.NDArray[np.bool_], free_corners: Any, block: int
) -> sparse.csr_matrix:
    """Return the interpolation from corners to nodes halfway between two of them, zero for what is held."""
    number = np.cumsum(present) - 1
    kept = present[ends]
    nodes = np.broadcast_to(np.arange(len(ends))[:, None], ends.shape)
    places = nodes[kept], number[ends[kept]]
    scalar = sparse.csr_matrix((np.full(len(places[0]), 0.5), places), shape=(len(ends), int(present.sum())))
    whole = sparse.kron(scalar, sparse.identity(block), format="csr")
    masked = (sparse.diags(free.astype(float)) @ whole @ sparse.diags(free_corners.astype(float))).tocsr()
    masked.eliminate_zeros()
    return masked


def _diagonal_blocks(matrix: SparseMatrix) -> Array:
    rows = np.repeat(np.arange(len(matrix.indptr) - 1), np.diff(matrix.indptr))
    near = np.flatnonzero(rows == matrix.indices)
    block = block_of(matrix)[0]
    blocks = np.zeros((matrix.shape[0] // block, block, block))
    blocks[rows[near]] = matrix.data[near].reshape(-1, block, block)
    return blocks


def _block_diagonal(blocks: Array) -> SparseMatrix:
    count, block = blocks.shape[:2]
    places = np.arange(count), np.arange(count + 1)
    return in_blocks(sparse.bsr_matrix((blocks, *places), shape=(count * block,) * 2), block, block)


def _filled(matrix: SparseMatrix, idle: npt.NDArray[np.bool_]) -> SparseMatrix:
    """Return a matrix with the mean of its diagonal where unknowns take no part."""
    block = block_of(matrix)[0]
    diagonal = np.where(idle, matrix.diagonal().mean(), 0.0).reshape(-1, block)
    return matrix + _block_diagonal(diagonal[:, :, None] * np.eye(block))


def _largest_eigenvalue(matrix: SparseMatrix, inverse: SparseMatrix) -> float:
    """Return the largest eigenvalue of inverse · matrix, from below, by Lanczos' iteration."""
    r = np.random.default_rng(0).normal(size=matrix.shape[0])
    z = inverse @ r
    norm, before = float(np.sqrt(r @ z)), np.zeros_like(r)
    diagonal, off = list[float](), list[float]()
    for _ in range(min(STEPS, len(r))):
        q, p = r / norm, z / norm
        r = matrix @ p - norm * before if off else matrix @ p
        diagonal.append(float(p @ r))
        r = r - diagonal[-1] * q
        z, before = inverse @ r, q
        norm = float(np.sqrt(max(r @ z, 0.0)))
        if norm <= 1e-12 * abs(diagonal[0]):
            break
        off.append(norm)
    off = off[: len(diagonal) - 1]
    return float(np.linalg.eigvalsh(np.diag(diagonal) + np.diag(off, 1) + np.diag(off, -1))[-1])
