"""Structured hexahedral meshes: boxes with graded edges, sectors and whole cylinders."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from porocore.macro.body.element import QUADRILATERAL_NODES, VTK_NODES, lattice
from porocore.macro.body.mesh import BodyMesh, boundary_facets, facet_middles
from porocore.states import Array, IntArray


def box(lines: tuple[Array, Array, Array]) -> BodyMesh:
    """Nodes, elements and points run along x first, then y, then z.

    Parameters
    ----------
    lines
        Edges of the elements along each axis, ascending.
    """
    counts = np.array([len(line) - 1 for line in lines])
    ends = 2 * counts + 1
    fine = [np.interp(np.arange(n), np.arange(0, n, 2), line) for n, line in zip(ends, lines, strict=True)]
    index = lattice(ends)
    points = np.stack([fine[a][index[:, a]] for a in range(3)], axis=1)
    strides = np.array([1, ends[0], ends[0] * ends[1]])
    cells = (2 * lattice(counts)[:, None] + VTK_NODES) @ strides
    facets = boundary_facets(cells)
    middles = facet_middles(points, facets)
    surfaces = {}
    for axis, name in enumerate("xyz"):
        for side, place in (("-", lines[axis][0]), ("+", lines[axis][-1])):
            surfaces[name + side] = facets[middles[:, axis] == place]
    return BodyMesh(points, cells, surfaces)


def graded(length: float, count: int, ratio: float) -> Array:
    """(count + 1,) edges from 0 to ``length`` whose last element is ``ratio`` times as long as the first."""
    if ratio == 1:
        # One multiplication for each, so that the last lies exactly at the length.
        return np.arange(count + 1) / count * length
    steps = np.geomspace(1.0, ratio, count)
    edges = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(edges / edges[-1] * length)


def sector(
    radius: float, height: float, angle: float, elements: tuple[int, int, int], grading: float
) -> BodyMesh:
    """About the y axis, from the plane z = 0 (angle 0) toward z > 0; a full turn gives the whole cylinder.

    A quarter is a block of squares round the axis and two blocks between it and the mantle; other sectors are
    quarters whose polar angle is stretched, and the whole cylinder is four quarters. The inner block takes as much of
    the radius as makes all elements equally long along it.

    Parameters
    ----------
    radius, height, angle
        The angle in radians, at most π/2, or 2π.
    elements
        Toward the mantle outside the inner block, along y, and around each block.
    grading
        Length of the outermost element over that of the innermost outside the inner block.
    """
    whole = angle > np.pi
    quarters = 4 if whole else 1
    part = np.pi / 2 if whole else angle
    n_r, n_y, n_t = elements
    core = n_t / (n_t + n_r)
    plane = [
        _flat(lambda s, t: _core(core, s, t), n_t, n_t, np.linspace(0, 1, n_t + 1)),
        _flat(lambda s, t: _shell(core, s, t, 0), n_r, n_t, graded(1.0, n_r, grading)),
        _flat(lambda s, t: _shell(core, s, t, 1), n_r, n_t, graded(1.0, n_r, grading)),
    ]
    points: list[Array] = []
    cells: list[IntArray] = []
    for turn in range(quarters):
        for nodes, quads in plane:
            r, polar = np.hypot(*nodes.T), np.arctan2(nodes[:, 1], nodes[:, 0])
            polar = polar * part / (np.pi / 2) + turn * np.pi / 2
            cells.append(quads + sum(len(part) for part in points))
            points.append(radius * np.column_stack([r * np.cos(polar), r * np.sin(polar)]))
    flat, quads = _merged(np.concatenate(points), np.concatenate(cells), radius)
    return _extruded(flat, quads, height, n_y, radius, None if whole else angle)


def _core(share: float, s: Array, t: Array) -> Array:
    """The inner block of the unit quarter: its outer corner is pulled in, so that angles stay moderate."""
    bulge = 1 - 0.12 * s * t
    return share * np.column_stack([s * bulge, t * bulge])


def _shell(share: float, s: Array, t: Array, which: int) -> Array:
    """One of the two blocks from the inner one (s = 0) to the mantle (s = 1); t runs with the polar angle."""
    one = np.ones_like(t)
    inner = _core(share, one, t) if which == 0 else _core(share, 1 - t, one)
    polar = np.pi / 4 * (t + which)
    outer = np.column_stack([np.cos(polar), np.sin(polar)])
    return np.asarray((1 - s[:, None]) * inner + s[:, None] * outer)


def _flat(mapping: Callable[[Array, Array], Array], n: int, m: int, line: Array) -> tuple[Array, IntArray]:
    """Nodes (k, 2) and 9-node quadrilaterals of a mapped square; ``line`` has the edges along s."""
    ends = np.array([2 * n + 1, 2 * m + 1])
    index = lattice(ends)
    s = np.interp(np.arange(ends[0]), np.arange(0, ends[0], 2), line)[index[:, 0]]
    first = 2 * lattice(np.array([n, m]))
    return mapping(s, index[:, 1] / (2 * m)), (first[:, None] + QUADRILATERAL_NODES) @ np.array([1, ends[0]])


def _merged(points: Array, cells: IntArray, scale: float) -> tuple[Array, IntArray]:
    """Nodes at the same place made one; coordinates that round-off keeps from zero set to it."""
    points = np.where(np.abs(points) < 1e-12 * scale, 0.0, points)
    _, first, inverse = np.unique(
        np.rint(points / scale * 1e9).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    return points[first], inverse.reshape(-1)[cells]


def _extruded(
    flat: Array, quads: IntArray, height: float, layers: int, radius: float, angle: float | None
) -> BodyMesh:
    """Along y, quadrilaterals of the plane (x, z) becoming hexahedra."""
    n, levels = len(flat), 2 * layers + 1
    y = np.repeat(np.arange(levels) / (levels - 1) * height, n)
    points = np.column_stack([np.tile(flat[:, 0], levels), y, np.tile(flat[:, 1], levels)])
    # The second axis of an element is y, so that (x, y, z) stays right-handed.
    place = {tuple(node): i for i, node in enumerate(QUADRILATERAL_NODES)}
    in_plane = np.array([place[a, c] for a, _, c in VTK_NODES])
    one = quads[:, in_plane] + n * VTK_NODES[:, 1]
    cells = np.concatenate([one + 2 * n * layer for layer in range(layers)])
    facets = boundary_facets(cells)
    middles, corners = facet_middles(points, facets), points[facets[:, :4]]
    tight = 1e-9 * radius
    mantle = (np.abs(np.hypot(corners[..., 0], corners[..., 2]) - radius) < tight).all(axis=1)
    surfaces = {
        "y-": facets[middles[:, 1] < tight],
        "y+": facets[middles[:, 1] > height - tight],
        "side": facets[mantle],
    }
    if angle is not None:
        quarter = np.isclose(angle, np.pi / 2)
        surfaces["z-"] = facets[(np.abs(corners[..., 2]) < tight).all(axis=1)]
        across = np.abs(corners[..., 0] * np.sin(angle) - corners[..., 2] * np.cos(angle)) < tight
        surfaces["x-" if quarter else "oblique"] = facets[across.all(axis=1)]
    return BodyMesh(points, cells, surfaces)
