"""Tetrahedra of one phase: volumes, shape functions, quadrature, facets matched by periodicity."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache, reduce
from itertools import permutations
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from scipy.special import roots_jacobi

from porocore.states import Array, IntArray

LARGEST_DEGREE = 12


@lru_cache(maxsize=16)
def tetrahedron_rule(degree: int) -> tuple[Array, Array]:
    """Return points (q, 3) and weights (q,) on the unit tetrahedron, exact for polynomials up to ``degree``.

    One point for degree 1, four for 2, fourteen up to 5 (Walkington 2000, Quadrature on simplices of arbitrary
    dimension), and products of Gauss–Jacobi rules beyond. The weights sum to 1/6; all are positive.

    Raises
    ------
    ValueError
        The degree is not between 1 and 12.
    """
    if not 1 <= degree <= LARGEST_DEGREE:
        raise ValueError(f"expected a degree from 1 to {LARGEST_DEGREE}, got {degree}")
    if degree == 1:
        rule = np.full((1, 3), 0.25), np.full(1, 1 / 6)
    elif degree == 2:
        rule = _corners((5 - np.sqrt(5)) / 20), np.full(4, 1 / 24)
    elif degree <= 5:
        near, far = 0.31088591926330060980, 0.092735250310891226402
        middle = 0.045503704125649649492
        edge = sorted(set(permutations([middle, middle, 0.5 - middle, 0.5 - middle])))
        points = np.concatenate([_corners(near), _corners(far), np.array(edge)[:, :3]])
        weights = np.repeat(
            [0.018781320953002641800, 0.012248840519393658257, 0.0070910034628469110730], [4, 4, 6]
        )
        rule = points, weights
    else:
        rule = _conical((degree + 2) // 2, 3)
    return _frozen(*rule)


def _corners(a: float) -> Array:
    """Return the four points with barycentric coordinates (a, a, a, 1 − 3a)."""
    return a + np.vstack([np.zeros(3), np.eye(3) * (1 - 4 * a)])


def _conical(n: int, d: int) -> tuple[Array, Array]:
    """Return the rule of n Gauss–Jacobi points along each side of the d-dimensional cube, collapsed to the simplex."""
    rules = [roots_jacobi(n, k, 0) for k in range(d)]
    grid = np.meshgrid(*((s + 1) / 2 for s, _ in rules), indexing="ij")
    points = [reduce(lambda x, y: x * (1 - y), grid[i + 1 :], grid[i]) for i in range(d)]
    weights = reduce(np.multiply.outer, (w / 2 ** (k + 1) for k, (_, w) in enumerate(rules)))
    return np.stack(points, axis=-1).reshape(-1, d), weights.ravel()


def _frozen(points: Array, weights: Array) -> tuple[Array, Array]:
    points.setflags(write=False)
    weights.setflags(write=False)
    return points, weights


@lru_cache(maxsize=16)
def triangle_rule(degree: int) -> tuple[Array, Array]:
    """Return points (q, 2) and weights (q,) on the unit triangle, exact for polynomials up to ``degree``.

    Products of Gauss–Jacobi rules; the weights sum to ½ and are positive.

    Raises
    ------
    ValueError
        The degree is not between 1 and 12.
    """
    if not 1 <= degree <= LARGEST_DEGREE:
        raise ValueError(f"expected a degree from 1 to {LARGEST_DEGREE}, got {degree}")
    return _frozen(*_conical(degree // 2 + 1, 2))


#: Corners at the ends of the edges with mid-edge nodes; a triangle has the first three edges.
EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
#: Corners, then mid-edge nodes, of the facets of a tetrahedron, outward; facet k is opposite to corner k.
FACETS = np.array([[1, 2, 3, 5, 9, 8], [0, 3, 2, 7, 9, 6], [0, 1, 3, 4, 8, 7], [0, 2, 1, 6, 5, 4]])


#: Nodes of a tetrahedron (VTK order, 4 or 10) after swapping its first two corners, which restores the orientation.
SWAPPED = np.array([1, 0, 2, 3, 4, 6, 5, 8, 7, 9])


def shape_functions(points: Array, nodes: int) -> tuple[Array, Array]:
    """Return N (q, a) and dN (q, a, d) of a triangle (d = 2) or a tetrahedron (d = 3) of ``nodes`` at points (q, d)."""
    count, d = points.shape
    L = np.column_stack([1 - points.sum(axis=1), points])
    dL = np.concatenate([-np.ones((1, d)), np.eye(d)])
    if nodes == d + 1:
        return L, np.broadcast_to(dL, (count, nodes, d)).copy()
    edges = EDGES[: nodes - d - 1]
    N = np.column_stack([L * (2 * L - 1), *(4 * L[:, i] * L[:, j] for i, j in edges)])
    corners = (4 * L - 1)[:, :, None] * dL
    middles = [4 * (L[:, [i]] * dL[j] + L[:, [j]] * dL[i]) for i, j in edges]
    return N, np.concatenate([corners, np.stack(middles, axis=1)], axis=1)


Phase = Literal["solid", "fluid"]
Element = Literal["linear", "quadratic-straight", "quadratic-curved"]
#: Degree of the rule at whose points, besides the nodes, the volume elements of curved tetrahedra are evaluated.
DEGREE = 4


@dataclass(frozen=True, eq=False)
class Tetrahedra:
    """One phase of a part of the cell.

    Attributes
    ----------
    points : (N, 3)
        Nodes.
    cells : (M, 4) or (M, 10)
        Tetrahedra in VTK order, positively oriented.
    regions : (M,)
        Index of each into ``region_names``; empty without regions.
    region_names
        Names of the regions of the phase; empty without regions.
    """

    points: Array
    cells: IntArray
    regions: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    region_names: tuple[str, ...] = ()


def used(points: Array, cells: IntArray) -> tuple[Array, IntArray]:
    """Return the nodes that some tetrahedra use, and the tetrahedra with these nodes renumbered."""
    kept, numbered = np.unique(cells, return_inverse=True)
    return points[kept], numbered.reshape(cells.shape)


def order_by_place(points: Array, cells: IntArray, corners: int = 4) -> tuple[IntArray, IntArray]:
    """Return an order of elements and one of nodes in which what is near in space is near in memory.

    The elements are taken leaf by leaf of a tree over their centres, the nodes as these elements meet them.

    Parameters
    ----------
    points : (N, 3)
        Nodes, all of them in some element.
    cells : (M, n)
        Elements of any kind, corners first.
    corners
        Corners of an element.

    Returns
    -------
    elements : (M,)
        The element that comes at each place.
    nodes : (N,)
        The node that comes at each place.
    """
    from scipy.spatial import cKDTree  # slow to import

    elements = cKDTree(points[cells[:, :corners]].mean(axis=1)).indices
    met = cells[elements].ravel()
    _, first = np.unique(met, return_index=True)
    return elements, met[np.sort(first)]


def with_middles(points: Array, cells: IntArray) -> tuple[Array, IntArray, IntArray]:
    """Return linear tetrahedra with a mid-edge node on each edge.

    Returns
    -------
    points : (N + E, 3)
        Corners, then mid-edge nodes.
    cells : (M, 10)
        Tetrahedra in VTK order.
    edges : (E, 2)
        Ends of the edge of each mid-edge node.
    """
    pairs = np.sort(cells[:, EDGES].reshape(-1, 2), axis=1)
    edges, inverse = np.unique(pairs, axis=0, return_inverse=True)
    quadratic = np.concatenate([cells, inverse.reshape(-1, 6) + len(points)], axis=1)
    return np.concatenate([points, points[edges].mean(axis=1)]), quadratic, edges


def boundary_facets(cells: IntArray) -> IntArray:
    """Return the facets of one tetrahedron only, (K, 3) or (K, 6) in VTK order, outward."""
    local = FACETS[:, : 3 if cells.shape[1] == 4 else 6]
    facets = cells[:, local].reshape(-1, local.shape[1])
    _, first, count = np.unique(np.sort(facets[:, :3], axis=1), axis=0, return_index=True, return_counts=True)
    return np.asarray(facets[first[count == 1]])


def oriented(points: Array, cells: IntArray) -> IntArray:
    """Return tetrahedra with a positive volume; two corners of those with a negative one are exchanged."""
    cells = cells.copy()
    negative = volumes(points, cells) < 0
    cells[negative] = cells[negative][:, SWAPPED[: cells.shape[1]]]
    return cells


def straightened(points: Array, cells: IntArray) -> Array:
    """Return the nodes of quadratic tetrahedra with the mid-edge nodes halfway between the corners."""
    points = points.copy()
    points[cells[:, 4:]] = points[cells[:, EDGES]].mean(axis=2)
    return points


def volumes(points: Array, cells: IntArray) -> Array:
    """Return the signed volume of each tetrahedron with straight edges, (M,)."""
    corners = points[cells[:, :4]]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6)


def volume(points: Array, cells: IntArray) -> float:
    """Return the volume of all tetrahedra with their curved edges."""
    return float(curved_volumes(points, cells).sum()) if len(cells) else 0.0


def porosity(points: Array, cells: IntArray, phase: Phase, copies: int = 1) -> float:
    """Return the porosity of a cell of volume 1 by the mesh of one phase, of which copies fill the cell."""
    share = copies * volume(points, cells)
    return 1 - share if phase == "solid" else share


def curved_volumes(points: Array, cells: IntArray) -> Array:
    """Return the volume of each tetrahedron with its curved edges, (M,)."""
    at, weights = tetrahedron_rule(DEGREE)
    return np.asarray(determinants(points, cells, at) @ weights)


def determinants(points: Array, cells: IntArray, at: Array) -> Array:
    """Return det ∂X/∂ξ of each tetrahedron at points (q, 3) of the unit one, (M, q)."""
    _, dN = shape_functions(at, cells.shape[1])
    return np.asarray(np.linalg.det(np.einsum("eai,qaj->eqij", points[cells], dN, optimize=True)))


def least_stretch(points: Array, cells: IntArray) -> Array:
    """Return the smallest det ∂X/∂ξ of each tetrahedron over that with straight edges, (M,).

    It is 1 for straight edges, and 0 or less where a curved element is folded. It is evaluated at the nodes and at the
    fourteen points of a quadrature rule.
    """
    corners = np.vstack([np.zeros(3), np.eye(3)])
    at = np.concatenate([corners, corners[EDGES].mean(axis=1), tetrahedron_rule(DEGREE)[0]])
    return np.asarray(determinants(points, cells, at).min(axis=1) / (6 * volumes(points, cells)))


def rows_of(table: npt.NDArray[Any], wanted: npt.NDArray[Any]) -> IntArray:
    """Return the row of a table (n, k) that each of the wanted ones (m, k) equals; −1 where there is none."""
    _, number = np.unique(np.concatenate([table, wanted]), axis=0, return_inverse=True)
    number = number.reshape(-1)
    row = np.full(int(number.max(initial=-1)) + 1, -1)
    row[number[: len(table)]] = np.arange(len(table))
    return np.asarray(row[number[len(table) :]])


def facet_classes(points: Array, facets: IntArray, first: Array, last: Array) -> IntArray:
    """Return the number (K,) of each facet (K, 3) of the box from ``first`` to ``last``; partners have the same one.

    Facets are identified by their nodes in the block, not by the periodic classes of these: where one or two elements
    span a period, different facets have corners of the same classes.
    """
    corners = np.sort(facets[:, :3], axis=1)
    for axis in range(3):
        low, high = (np.flatnonzero(points[:, axis] == side) for side in (first[axis], last[axis]))
        others = np.delete(points, axis, axis=1)
        partner = rows_of(others[low], others[high])
        below = np.full(len(points), -1)
        below[high[partner >= 0]] = low[partner[partner >= 0]]
        images = below[corners]
        there = (images >= 0).all(axis=1)
        corners[there] = np.sort(images[there], axis=1)
    return np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1)
