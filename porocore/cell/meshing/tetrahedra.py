"""Tetrahedra as a geometry hands them to the mesh, and what is the same for every way of making them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from porocore.cell.meshing.quadrature import tetrahedron_rule
from porocore.cell.meshing.shape_functions import shape_functions
from porocore.states import Array, IntArray

Phase = Literal["solid", "fluid"]
Element = Literal["linear", "quadratic-straight", "quadratic-curved"]
#: Corners of a tetrahedron between which its further nodes lie (VTK order).
EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
#: Of the rule at whose points the volume elements of curved tetrahedra are looked at, besides their nodes.
DEGREE = 4


@dataclass(frozen=True, eq=False)
class Tetrahedra:
    """One phase of a part of the cell.

    Attributes
    ----------
    points : (N, 3)
        Nodes.
    cells : (M, 4) or (M, 10)
        In VTK order, positively oriented.
    regions : (M,)
        Index of each into ``region_names``; empty where none are told apart.
    region_names
        Of the parts of the phase; empty where none are told apart.
    """

    points: Array
    cells: IntArray
    regions: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    region_names: tuple[str, ...] = ()


def used(points: Array, cells: IntArray) -> tuple[Array, IntArray]:
    """The nodes that some tetrahedra use, and the tetrahedra in their numbers."""
    kept, numbered = np.unique(cells, return_inverse=True)
    return points[kept], numbered.reshape(cells.shape)


def with_middles(points: Array, cells: IntArray) -> tuple[Array, IntArray, IntArray]:
    """Linear tetrahedra with a further node in the middle of each edge.

    Returns
    -------
    points : (N + E, 3)
        The middles behind the corners.
    cells : (M, 10)
        In VTK order.
    edges : (E, 2)
        Ends of the edge of each middle.
    """
    pairs = np.sort(cells[:, EDGES].reshape(-1, 2), axis=1)
    edges, inverse = np.unique(pairs, axis=0, return_inverse=True)
    quadratic = np.concatenate([cells, inverse.reshape(-1, 6) + len(points)], axis=1)
    return np.concatenate([points, points[edges].mean(axis=1)]), quadratic, edges


def oriented(points: Array, cells: IntArray) -> IntArray:
    """Linear tetrahedra with a positive volume: two corners of those that have a negative one are exchanged."""
    cells = cells.copy()
    negative = volumes(points, cells) < 0
    cells[negative] = cells[negative][:, [1, 0, 2, 3]]
    return cells


def volumes(points: Array, cells: IntArray) -> Array:
    """Signed volume of each tetrahedron with straight edges, by its corners, (M,)."""
    corners = points[cells[:, :4]]
    found: Array = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6
    return found


def volume(points: Array, cells: IntArray) -> float:
    """Of all tetrahedra, curved as they are."""
    at, weights = tetrahedron_rule(DEGREE)
    return float((determinants(points, cells, at) @ weights).sum()) if len(cells) else 0.0


def determinants(points: Array, cells: IntArray, at: Array) -> Array:
    """det ∂X/∂ξ of each tetrahedron at points (q, 3) of the unit one, (M, q)."""
    _, dN = shape_functions(at, cells.shape[1])
    found: Array = np.linalg.det(np.einsum("eai,qaj->eqij", points[cells], dN, optimize=True))
    return found


def least_stretch(points: Array, cells: IntArray) -> Array:
    """Smallest det ∂X/∂ξ of each tetrahedron over that of the one with straight edges, (M,).

    1 where the edges are straight; 0 or less where a curved element folds over itself. Looked at in its nodes and
    in the fourteen points of a quadrature rule.
    """
    corners = np.vstack([np.zeros(3), np.eye(3)])
    at = np.concatenate([corners, corners[EDGES].mean(axis=1), tetrahedron_rule(DEGREE)[0]])
    found: Array = determinants(points, cells, at).min(axis=1) / (6 * volumes(points, cells))
    return found
