"""Constant operators of a mesh: gradients at the quadrature points, weights, sparsity, scattering.

Fields are component-first, (3, nodes) and (3, 3, points), with periodic nodes merged, so that a gradient is
one sparse product and an assembly one batched product followed by one sparse scatter.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse
from skfem import Element, ElementTetP1, ElementTetP2

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.quadrature import tetrahedron_rule
from porocore.states import Array, IntArray
from porocore_fem_skfem.checks import Indices

ELEMENTS = {4: ElementTetP1(), 10: ElementTetP2()}


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
    keys : (nnz,)
        row · n + column, ascending.
    n : int
        Number of rows.
    """

    def __init__(self, keys: IntArray, n: int) -> None:
        self.keys, self.n = keys, n
        self.rows, self.indices = keys // n, (keys % n).astype(np.int32)

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
        return Pattern(np.union1d(self.keys, keys), self.n)

    def spread(self, entries: Array, places: Pattern) -> Array:
        """Return the entries (nnz) of this pattern from those of a part of it."""
        out = np.zeros(len(self.keys))
        out[np.searchsorted(self.keys, places.keys)] = entries
        return out

    def sum(self, keys: IntArray, values: Array) -> Array:
        """Return the entries (nnz) from values at some of the places."""
        return np.asarray(np.bincount(np.searchsorted(self.keys, keys), values, len(self.keys)), float)


class Scatter:
    """Sum of element blocks into the upper triangle of a matrix whose pattern is computed once.

    Parameters
    ----------
    dofs : (elements, m)
        Unknown of each row of an element block.
    n : int
        Number of unknowns.
    """

    def __init__(self, dofs: IntArray, n: int) -> None:
        elements, m = dofs.shape
        rows = np.repeat(dofs, m, axis=1).ravel()
        columns = np.tile(dofs, (1, m)).ravel()
        kept = np.flatnonzero(rows <= columns)
        # Every row needs its diagonal, and it comes first because the rest of the row lies right of it.
        keys = rows[kept] * n + columns[kept]
        unique, slot = np.unique(np.concatenate([keys, np.arange(n) * (n + 1)]), return_inverse=True)
        slot = slot.reshape(-1)[: len(keys)]
        self.pattern = Pattern(unique, n)
        self._sum = sparse.csr_matrix(
            (np.ones(len(kept)), (slot, kept)), shape=(len(unique), elements * m * m)
        )

    def __call__(self, blocks: Array) -> Array:
        """Return the entries (nnz) from blocks (elements, m, m)."""
        return np.asarray(self._sum @ blocks.ravel())
