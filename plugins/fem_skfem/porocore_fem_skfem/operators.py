"""Constant operators of a mesh: gradients at the quadrature points, weights, sparsity, scattering.

Fields are component-first, (3, nodes) and (3, 3, points), with periodic nodes merged, so that a gradient is
one sparse product and an assembly one batched product followed by one sparse scatter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy import sparse
from skfem import Element, ElementTetP1, ElementTetP2

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.tetrahedra import tetrahedron_rule
from porocore.states import Array, IntArray
from porocore_fem_skfem.factor import Indices

ELEMENTS = {4: ElementTetP1(), 10: ElementTetP2()}
#: Pairs of nodes of the elements that are summed together.
BATCH = 2**18
#: Blocks of two components of some elements.
Parts: TypeAlias = Callable[[int, int], Array]


class Operators:
    """Isoparametric gradients of the mesh's own element, or of another one on the same geometry.

    Parameters
    ----------
    mesh
        Linear or quadratic tetrahedra.
    degree
        Polynomial degree that the quadrature integrates exactly; 2 (four points) is enough for the averages.
    cells
        Numbers of the unknowns of each element, (M, 4) or (M, 10).
    nodes
        Positions (N, 3) of the mesh's nodes; by default its points.
    """

    def __init__(self, mesh: CellMesh, degree: int, cells: IntArray, nodes: Array | None = None) -> None:
        nodes = mesh.points if nodes is None else nodes
        points, weights = tetrahedron_rule(degree)
        xi = points.T
        geometry = _shape(ELEMENTS[mesh.cells.shape[1]], xi)[1]  # (a, 3, q)
        jacobian = np.einsum("eai,ajq->eqij", nodes[mesh.cells], geometry, optimize=True)
        values, local = _shape(ELEMENTS[cells.shape[1]], xi)
        #: ∇N of each element, quadrature point and local node, (elements, q, a, 3).
        self.grad_N = np.einsum("ajq,eqji->eqai", local, np.linalg.inv(jacobian), optimize=True)
        #: N at the quadrature points, (a, q).
        self.values = values
        self.weights = (np.linalg.det(jacobian) * weights).reshape(-1)  # (points,)
        self.cells = cells
        self.n_points = len(self.weights)

    def gradient(self, n_nodes: int) -> sparse.csr_matrix:
        """Return the sparse gradient (3·points, nodes), whose row j·points + q is ∂/∂Y_j at point q."""
        e, q, a, _ = self.grad_N.shape
        points = np.arange(e * q).reshape(e, q)
        rows = np.stack([np.repeat(points[:, :, None], a, 2) + j * e * q for j in range(3)], axis=-1)
        columns = np.broadcast_to(self.cells[:, None, :, None], (e, q, a, 3))
        return sparse.csr_matrix(
            (self.grad_N.ravel(), (rows.ravel(), columns.ravel())), shape=(3 * e * q, n_nodes)
        )

    def laplacian(self) -> Array:
        """Return ∫ ∇N_a·∇N_b (elements, a, a)."""
        e, q, a, _ = self.grad_N.shape
        flat = self.grad_N.transpose(0, 2, 1, 3).reshape(e, a, q * 3)
        weights = np.repeat(self.weights.reshape(e, 1, q), 3, axis=2)
        return np.asarray(np.matmul(flat * weights, flat.transpose(0, 2, 1)))


def corner_values(points: Array) -> Array:
    """Return the linear shape functions (4, q) at points (q, 3) of the unit tetrahedron."""
    return _shape(ELEMENTS[4], points.T)[0]


def _shape(element: Element, xi: Array) -> tuple[Array, Array]:
    """Return the values (a, q) and reference gradients (a, 3, q) of a scikit-fem element."""
    pairs = [element.lbasis(xi, i) for i in range(element.doflocs.shape[0])]
    return np.array([np.broadcast_to(v, xi.shape[1:]) for v, _ in pairs]), np.array(
        [np.broadcast_to(g, (3, *xi.shape[1:])) for _, g in pairs]
    )


class Pattern:
    """Places of the upper triangle of a symmetric matrix of n rows, row by row; the diagonal is among them.

    Parameters
    ----------
    rows, indices : (nnz,)
        Row and column of each place, ascending.
    n : int
        Number of rows.
    """

    def __init__(self, rows: Indices, indices: Indices, n: int) -> None:
        self.rows, self.indices, self.n = rows, indices, n

    @cached_property
    def keys(self) -> IntArray:
        """Row · n + column of each place, (nnz,)."""
        return self.rows.astype(np.int64) * self.n + self.indices

    def restricted(self, free: IntArray) -> tuple[Indices, Indices, IntArray]:
        """Return the pattern (indptr, indices) of the rows and columns in ``free``, and the entries that it keeps."""
        number = np.full(self.n, -1, dtype=np.int64)
        number[free] = np.arange(len(free))
        kept = np.flatnonzero((number[self.rows] >= 0) & (number[self.indices] >= 0))
        rows = number[self.rows[kept]]
        indptr = np.searchsorted(rows, np.arange(len(free) + 1)).astype(np.int32)
        return indptr, number[self.indices[kept]].astype(np.int32), kept

    def upper(self, rows: IntArray, columns: IntArray) -> tuple[IntArray, IntArray]:
        """Return the keys and the numbers of the entries that lie in the upper triangle."""
        upper = np.flatnonzero(rows <= columns)
        return rows[upper] * self.n + columns[upper], upper

    def lacks(self, keys: IntArray) -> IntArray:
        """Return the keys that are not among the places."""
        unique = np.unique(keys)
        at = np.minimum(np.searchsorted(self.keys, unique), len(self.keys) - 1)
        return np.asarray(unique[self.keys[at] != unique])

    def widened(self, keys: IntArray) -> Pattern:
        """Return the pattern with further places."""
        keys = np.union1d(self.keys, keys)
        return Pattern((keys // self.n).astype(np.int32), (keys % self.n).astype(np.int32), self.n)

    def sum(self, keys: IntArray, values: Array) -> Array:
        """Return the entries (nnz) from values at some of the places."""
        return np.asarray(np.bincount(np.searchsorted(self.keys, keys), values, len(self.keys)), float)


@dataclass(frozen=True, eq=False)
class _Batch:
    """Elements that are summed together.

    Attributes
    ----------
    elements
        Which they are.
    pairs : (k,)
        Numbers of their pairs of nodes among all pairs.
    slot : (elements, a, a)
        Place of each element's pairs among these.
    """

    elements: slice
    pairs: IntArray
    slot: Indices

    @cached_property
    def slot_by_nodes(self) -> Indices:
        """The places by nodes and then elements, (a, a, elements)."""
        return np.ascontiguousarray(self.slot.transpose(1, 2, 0))


class Scatter:
    """Sum of element blocks into the upper triangle of a matrix whose pattern is computed once.

    The unknowns of a node are coupled to all of another one that shares an element, so pairs of nodes are sorted and
    not pairs of unknowns, of which a displacement has nine times as many. Elements are summed in batches, whose blocks
    fit into the processor's cache.

    Parameters
    ----------
    cells : (elements, a)
        Nodes of each element.
    n : int
        Number of nodes; component i of node k is unknown i · n + k.
    components : int
        Unknowns of a node.
    """

    def __init__(self, cells: IntArray, n: int, components: int = 1) -> None:
        self._shape = (-1, components, cells.shape[1], components, cells.shape[1])
        unique, self._batches = _numbered_pairs(cells, n)
        row, column = unique // n, unique % n
        upper = np.flatnonzero(row <= column)
        width, upper_width = np.bincount(row, minlength=n), np.bincount(row[upper], minlength=n)
        rank, upper_rank = _rank(row, width), _rank(row[upper], upper_width)
        widths = np.concatenate([upper_width + (components - 1 - i) * width for i in range(components)])
        starts = np.concatenate([[0], np.cumsum(widths)])
        rows = np.repeat(np.arange(components * n, dtype=np.int32), widths)
        indices = np.empty(starts[-1], dtype=np.int32)
        #: Component of the row and of the column, and where the sums of all pairs go; behind all entries go those below
        #: the diagonal.
        self._parts: list[tuple[int, int, IntArray]] = []
        for i in range(components):
            start = starts[i * n : (i + 1) * n]
            places = np.full(len(unique), len(indices))
            places[upper] = start[row[upper]] + upper_rank
            indices[places[upper]] = column[upper] + i * n
            self._parts.append((i, i, places))
            for j in range(i + 1, components):
                after = start + upper_width + (j - i - 1) * width
                self._parts.append((i, j, after[row] + rank))
                indices[self._parts[-1][2]] = column + j * n
        self.pattern = Pattern(rows, indices, components * n)

    def __call__(self, blocks: Array) -> Array:
        """Return the entries (nnz) from blocks (elements, components · a, components · a)."""
        return self.sum_of(lambda some: self.parts(blocks[some]))

    def parts(self, blocks: Array) -> Parts:
        """Return the parts of blocks (some, components · a, components · a) for :meth:`sum_of`."""
        whole = blocks.reshape(self._shape)
        return lambda i, j: whole[:, i, :, j]

    def sum_of(self, parts: Callable[[slice], Parts], *, by_nodes: bool = False) -> Array:
        """Return the entries (nnz) from the blocks of two components, (some, a, a), of some elements after the others.

        They are (a, a, some) where they come ``by_nodes``.
        """
        out = np.zeros(len(self.pattern.indices) + 1)
        for batch in self._batches:
            part, slot = parts(batch.elements), batch.slot_by_nodes if by_nodes else batch.slot
            for i, j, places in self._parts:
                sums = np.bincount(slot.ravel(), part(i, j).ravel(), len(batch.pairs))
                out[places[batch.pairs]] += sums
        return out[:-1]


def _numbered_pairs(cells: IntArray, n: int) -> tuple[IntArray, list[_Batch]]:
    """Return the pairs of nodes a · n + b that share an element, ascending, and the elements in batches."""
    step, found = max(1, BATCH // cells.shape[1] ** 2), []
    for k in range(0, len(cells), step):
        some = cells[k : k + step]
        pairs = some[:, :, None] * n + some[:, None, :]
        own, slot = np.unique(pairs, return_inverse=True)
        found.append((slice(k, k + step), own, slot.reshape(pairs.shape).astype(np.int32)))
    if not found:
        return np.empty(0, dtype=np.int64), []
    unique = found[0][1] if len(found) == 1 else np.unique(np.concatenate([own for _, own, _ in found]))
    return unique, [_Batch(some, np.searchsorted(unique, own), slot) for some, own, slot in found]


def empty_blocks(elements: int, nodes: int) -> Array:
    """Return blocks (elements, 3, nodes, 3, nodes) without values, in which those of two components lie together."""
    return np.empty((3, 3, elements, nodes, nodes)).transpose(2, 0, 3, 1, 4)


def _rank(row: IntArray, width: IntArray) -> IntArray:
    """Return the number of each entry within its row."""
    return np.asarray(np.arange(len(row)) - (np.cumsum(width) - width)[row])
