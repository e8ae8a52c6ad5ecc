"""Division of curved facets of a body into plane pieces, and the facets that face the viewer."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from porocore.states import Array, IntArray

#: Corners of a facet in its own coordinates.
SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
TRIANGLE = SQUARE[:2] + SQUARE[3:]


def pieces(nodes: int, parts: int) -> tuple[Array, IntArray, IntArray]:
    """Return how a quadratic facet is cut, with ``parts`` pieces along each edge.

    Parameters
    ----------
    nodes
        9 of a quadrilateral or 6 of a triangle: corners, middles of the edges, and the middle.
    parts
        2 or more.

    Returns
    -------
    values : (k, nodes)
        Shape functions at the corners of the pieces.
    polygons : (m, 4 or 3)
        Corners of each piece.
    outline : (n,)
        Corners around the facet, closed.
    """
    i, j = (grid.ravel() for grid in np.indices((parts + 1, parts + 1)))
    if nodes == 9:
        return _square_values(i / parts, j / parts), _squares(parts), _around(parts, SQUARE)
    inside = i + j <= parts
    number = np.cumsum(inside) - 1
    values = _triangle_values(i[inside] / parts, j[inside] / parts)
    return values, number[_triangles(parts)], number[_around(parts, TRIANGLE)]


def front(facets: Array, view: Array) -> npt.NDArray[np.bool_]:
    """Return which facets (k, nodes, 3), seen from height and azimuth in radians, do not turn their back (k,)."""
    height, azimuth = view
    toward = [np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)]
    corners = 4 if facets.shape[1] == 9 else 3
    around = facets[:, :corners] - facets[:, :corners].mean(axis=1, keepdims=True)
    normals = np.cross(around, np.roll(around, -1, axis=1)).sum(axis=1)
    return np.asarray(normals @ toward > 0)


def _square_values(s: Array, t: Array) -> Array:
    a, b = (np.stack([(1 - x) * (1 - 2 * x), x * (2 * x - 1), 4 * x * (1 - x)]) for x in (s, t))
    order = [(0, 0), (1, 0), (1, 1), (0, 1), (2, 0), (1, 2), (2, 1), (0, 2), (2, 2)]
    return np.stack([a[m] * b[n] for m, n in order], axis=1)


def _triangle_values(s: Array, t: Array) -> Array:
    corners = (1 - s - t, s, t)
    edges = [4 * corners[m] * corners[(m + 1) % 3] for m in range(3)]
    return np.stack([*(c * (2 * c - 1) for c in corners), *edges], axis=1)


def _squares(parts: int) -> IntArray:
    """Return the squares of a grid, by the numbers of its points."""
    i, j = (grid.ravel() for grid in np.indices((parts, parts)))
    first = i * (parts + 1) + j
    return np.stack([first, first + parts + 1, first + parts + 2, first + 1], axis=1)


def _triangles(parts: int) -> IntArray:
    """Return the halves of the squares on one side of the grid's diagonal."""
    squares = _squares(parts)
    i, j = np.divmod(squares[:, 0], parts + 1)
    lower, upper = squares[i + j < parts][:, [0, 1, 3]], squares[i + j < parts - 1][:, [1, 2, 3]]
    return np.concatenate([lower, upper])


def _around(parts: int, corners: tuple[tuple[int, int], ...]) -> IntArray:
    """Return the points of the grid along a closed line from corner to corner."""
    start, end = np.array(corners), np.roll(corners, -1, axis=0)
    steps = np.arange(parts)[:, None]
    line = np.concatenate([parts * a + steps * (b - a) for a, b in zip(start, end, strict=True)])
    return np.append(line, line[:1], axis=0) @ [parts + 1, 1]
