"""Middle sections of a body: the element at each place of a grid, the section in which a field varies most."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from porocore.macro.body.element import VTK_NODES
from porocore.macro.body.tetrahedra import tetrahedra, tetrahedron_at
from porocore.states import Array, IntArray

#: Places along the longer side of a section.
RESOLUTION = 180
#: Edges are straight whose middles are off by no more than this share of the body.
STRAIGHT = 1e-9
#: Axes on the page, to the right and upwards, of the sections across x, y and z.
SIDES = {0: (2, 1), 1: (0, 2), 2: (0, 1)}


@dataclass(frozen=True, eq=False)
class Section:
    """A section through the middle of a body, across one of the axes.

    Attributes
    ----------
    across
        Axis: 0, 1 or 2.
    at
        Coordinate along it.
    ends : (2, 2)
        Least and largest coordinate to the right and upwards.
    element : (rows, columns)
        Element at each place of the grid; -1 outside the body.
    """

    across: int
    at: float
    ends: Array
    element: IntArray

    @property
    def sides(self) -> tuple[int, int]:
        """Axes to the right and upwards."""
        return SIDES[self.across]

    def image(self, values: Array | IntArray) -> Array:
        """Return the values (elements, ...) at the places of the grid, NaN outside the body."""
        found = np.asarray(values, float)[self.element]
        found[self.element < 0] = np.nan
        return found

    def places(self) -> tuple[Array, Array]:
        """Return the coordinates of columns and rows, to the right and upwards."""
        counts = self.element.shape[::-1]
        right, up = (
            low + (np.arange(n) + 0.5) / n * (high - low)
            for n, (low, high) in zip(counts, self.ends, strict=True)
        )
        return right, up


def sections(points: Array, cells: IntArray) -> tuple[Section, ...]:
    """Return the sections through the middle of a body with these nodes and elements, across z, x and y."""
    straight, element_of = straight_parts(points, cells)
    parts, part_of = tetrahedra(points, straight)
    owner = element_of[part_of]
    low, high = points.min(axis=0), points.max(axis=0)
    # Not on a face between elements, of which either might be found.
    middle = (low + high) / 2 + 1e-4 * (high - low)
    found = []
    for across in (2, 0, 1):
        sides = list(SIDES[across])
        lengths = (high - low)[sides]
        counts = np.maximum(np.ceil(RESOLUTION * lengths / lengths.max()).astype(int), 12)
        grid = [
            low[i] + (np.arange(n) + 0.5) / n * (high - low)[i] for i, n in zip(sides, counts, strict=True)
        ]
        places = np.empty((counts[1], counts[0], 3))
        places[...] = middle
        places[..., sides[0]], places[..., sides[1]] = np.meshgrid(*grid)
        at = tetrahedron_at(parts, places.reshape(-1, 3))
        element = np.where(at < 0, -1, owner[at]).reshape(counts[1], counts[0])
        ends = np.stack([low[sides], high[sides]], axis=1)
        found.append(Section(across, float(middle[across]), ends, element))
    return tuple(found)


def straight_parts(points: Array, cells: IntArray) -> tuple[IntArray, IntArray]:
    """Return elements with straight edges in place of a body's elements, and the element that each is a part of.

    Curved hexahedra are eight each, whose corners are all of their nodes; others are one, their corners.
    """
    own = np.arange(len(cells))
    if cells.shape[1] != 27:
        return cells[:, :4], own
    corners, middles = points[cells[:, :8]], points[cells[:, 8:]]
    share = np.prod(np.where(VTK_NODES[:8] == 0, 2 - VTK_NODES[8:, None], VTK_NODES[8:, None]) / 2, axis=2)
    off = np.abs(np.einsum("mc,ecx->emx", share, corners) - middles).max(initial=0.0)
    if off <= STRAIGHT * np.ptp(points, axis=0).max():
        return cells[:, :8], own
    number = {tuple(node): i for i, node in enumerate(VTK_NODES.tolist())}
    eighths = [
        [number[tuple(corner)] for corner in (first + VTK_NODES[:8] // 2).tolist()]
        for first in VTK_NODES[:8] // 2
    ]
    return cells[:, np.array(eighths)].reshape(-1, 8), np.repeat(own, 8)


def most_telling(among: Sequence[Section], values: Array | Callable[[Section], Array]) -> Section:
    """Return the section in which the values (elements, ...) vary most, the first of those that are alike.

    They may be those that a section shows, such as components of a vector along its sides.
    """
    spreads = []
    for section in among:
        shown = np.asarray(values(section) if callable(values) else values, float)
        inside = shown.reshape(len(shown), -1)[section.element[section.element >= 0]]
        spreads.append(float(np.nan_to_num(inside).std(axis=0).sum()) if len(inside) else -1.0)
    most = max(spreads)
    return next(s for s, spread in zip(among, spreads, strict=True) if spread >= most * (1 - 1e-2) - 1e-300)
