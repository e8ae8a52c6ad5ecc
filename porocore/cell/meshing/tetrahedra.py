"""Tetrahedra of one phase, and operations on them: volumes, mid-edge nodes, facets, orientation."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from porocore.cell.meshing.quadrature import tetrahedron_rule
from porocore.cell.meshing.shape_functions import EDGES, FACETS, shape_functions
from porocore.states import Array, IntArray

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
    """Return linear tetrahedra with a positive volume; two corners of those with a negative one are exchanged."""
    cells = cells.copy()
    negative = volumes(points, cells) < 0
    cells[negative] = cells[negative][:, [1, 0, 2, 3]]
    return cells


def volumes(points: Array, cells: IntArray) -> Array:
    """Return the signed volume of each tetrahedron with straight edges, (M,)."""
    corners = points[cells[:, :4]]
    return np.asarray(np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6)


def volume(points: Array, cells: IntArray) -> float:
    """Return the volume of all tetrahedra with their curved edges."""
    return float(curved_volumes(points, cells).sum()) if len(cells) else 0.0


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
