"""The box as a mesh: nodes on a regular lattice, triquadratic hexahedra, and their quadrature points.

Numbers of nodes, elements and points run along x first, then y, then z; every backend reports in this order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.problem import MacroProblem
from porocore.states import Array, IntArray

#: VTK's order of the 27 nodes of a triquadratic hexahedron, in half edges; the first 8 are the corners.
VTK_NODES = np.array(
    [
        *[(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)],
        *[(1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2)],
        *[(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)],
        *[(0, 1, 1), (2, 1, 1), (1, 0, 1), (1, 2, 1), (1, 1, 0), (1, 1, 2), (1, 1, 1)],
    ]
)
#: Degree up to which the quadrature is exact in each direction: that of the square of the quadratic displacement.
DEGREE = 5
#: Quadrature points of an element.
POINTS = 27


@dataclass(frozen=True, eq=False)
class BoxMesh:
    """Hexahedra that carry the displacement at 27 nodes and the pressure at their 8 corners.

    Unknowns are numbered displacements first, 3 · node + component, then the pressures.

    Attributes
    ----------
    problem
        What it was made for.
    points : (nodes, 3)
        Nodes of the displacement.
    p_nodes : (p_nodes,)
        Which of them are corners and carry a pressure, ascending.
    cells : (elements, 27)
        Nodes of each element in VTK's order.
    p_cells : (elements, 8)
        Places in ``p_nodes`` of the corners of each element, in VTK's order.
    """

    problem: MacroProblem
    points: Array
    p_nodes: IntArray
    cells: IntArray
    p_cells: IntArray

    @classmethod
    def make(cls, problem: MacroProblem) -> BoxMesh:
        """Of the problem's size and numbers of elements."""
        counts = np.array(problem.elements)
        ends = 2 * counts + 1
        lattice = _lattice(ends)
        # One multiplication for each coordinate, so that the far faces lie exactly at the size.
        points = lattice / (2 * counts) * np.array(problem.size)
        strides = np.array([1, ends[0], ends[0] * ends[1]])
        corner_strides = np.array([1, counts[0] + 1, (counts[0] + 1) * (counts[1] + 1)])
        first = _lattice(counts)
        return cls(
            problem,
            points,
            np.flatnonzero((lattice % 2 == 0).all(axis=1)),
            (2 * first[:, None] + VTK_NODES) @ strides,
            (first[:, None] + VTK_NODES[:8] // 2) @ corner_strides,
        )

    @property
    def n_u(self) -> int:
        """Number of displacement unknowns."""
        return 3 * len(self.points)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.n_u + len(self.p_nodes)

    @property
    def edges(self) -> Array:
        """(3,) edge lengths of an element; all are congruent."""
        return np.asarray(np.array(self.problem.size) / np.array(self.problem.elements))

    def node_at(self, places: Array) -> IntArray:
        """(n,) numbers of the nodes at ``places`` (n, 3)."""
        halves = np.rint(2 * places / self.edges).astype(np.int64)
        ends = 2 * np.array(self.problem.elements) + 1
        return np.asarray(halves @ np.array([1, ends[0], ends[0] * ends[1]]))

    @property
    def weights(self) -> Array:
        """(27,) of the quadrature points of an element, its volume in them."""
        return gauss_weights() * float(np.prod(self.edges))

    @property
    def stretch(self) -> float:
        """Largest ∫ Σ_j |∂N/∂X_j| dX over the body of a displacement node's shape function N."""
        x = gauss_points()
        # Quadratic Lagrange functions of the three nodes of an edge, and their slopes: (points, axes, 3).
        N = np.stack([(1 - x) * (1 - 2 * x), 4 * x * (1 - x), x * (2 * x - 1)], axis=-1)
        slope = np.stack([4 * x - 3, 4 - 8 * x, 4 * x - 1], axis=-1)
        i, j, k = VTK_NODES.T
        grad = (
            np.stack(
                [
                    slope[:, 0, i] * N[:, 1, j] * N[:, 2, k],
                    N[:, 0, i] * slope[:, 1, j] * N[:, 2, k],
                    N[:, 0, i] * N[:, 1, j] * slope[:, 2, k],
                ],
                axis=-1,
            )
            / self.edges
        )
        local = np.einsum("q,qaj->a", self.weights, np.abs(grad))
        return float(np.bincount(self.cells.ravel(), np.tile(local, len(self.cells))).max())

    def pressure_everywhere(self, p: Array) -> Array:
        """(nodes,) the trilinear pressure at all nodes, from its values (p_nodes,) at the corners."""
        at_nodes = (1 - np.abs(VTK_NODES[:, None] - VTK_NODES[None, :8]) / 2).prod(axis=2)
        everywhere = np.empty(len(self.points))
        everywhere[self.cells] = p[self.p_cells] @ at_nodes.T
        return everywhere


def gauss_points() -> Array:
    """(27, 3) points of the 3 × 3 × 3 Gauss rule in the unit cube."""
    along_edge = np.array([0.5 - np.sqrt(0.15), 0.5, 0.5 + np.sqrt(0.15)])
    return np.asarray(along_edge[_lattice(np.array([3, 3, 3]))])


def gauss_weights() -> Array:
    """(27,) weights of :func:`gauss_points`; their sum is 1."""
    along_edge = np.array([5 / 18, 8 / 18, 5 / 18])
    return np.asarray(along_edge[_lattice(np.array([3, 3, 3]))].prod(axis=1))


def _lattice(ends: Any) -> Any:
    """(n, 3) all (i, j, k) below ``ends``, i running fastest."""
    k, j, i = np.indices(ends[::-1])
    return np.stack([i.ravel(), j.ravel(), k.ravel()], axis=1)
