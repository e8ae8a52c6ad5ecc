"""Meshes of other programs, read by meshio and checked."""

from __future__ import annotations

import io
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from porocore.errors import ConfigurationError

#: Of the kinds of elements that are made use of.
NODES = {
    "tetra": 4, "tetra10": 10, "hexahedron": 8, "hexahedron27": 27,
    "triangle": 3, "triangle6": 6, "quad": 4, "quad8": 8, "quad9": 9,
}  # fmt: skip
#: Coordinates whose cubes are finite.
FARTHEST = 1e90


def read_mesh(path: Path) -> Any:
    """Read a mesh file with meshio.

    Raises
    ------
    ConfigurationError
        It cannot be read, or its nodes and elements do not fit together; the message begins with the path.
    """
    import meshio  # heavy, and needed here only

    try:
        with redirect_stdout(io.StringIO()) as said:
            mesh = meshio.read(path)
    # meshio's readers raise whatever the file makes them stumble over; some of them print and end the process.
    except (Exception, SystemExit) as error:
        reason = str(error) if not isinstance(error, SystemExit) else " ".join(said.getvalue().split())
        raise ConfigurationError(
            f"{path}: not a mesh that meshio can read ({reason or type(error).__name__}); expected .msh, .vtu, .mesh "
            "or another of its formats"
        ) from error
    fault = _fault(mesh)
    if fault:
        raise ConfigurationError(f"{path}: {fault}")
    return mesh


def _fault(mesh: Any) -> str:
    """Say why nodes and elements do not fit together; empty if they do."""
    points = np.asarray(mesh.points)
    if points.ndim != 2 or points.shape[1] != 3 or not np.issubdtype(points.dtype, np.number):
        return f"expected nodes in three dimensions, got an array of shape {points.shape} and type {points.dtype}"
    known = np.zeros(len(points), dtype=bool)
    for block in mesh.cells:
        cells = np.asarray(block.data)
        if not cells.size:
            continue
        if cells.ndim != 2 or not np.issubdtype(cells.dtype, np.integer):
            return f"expected {block.type} elements as rows of nodes, got an array of shape {cells.shape}"
        if block.type in NODES and cells.shape[1] != NODES[block.type]:
            return f"expected {block.type} elements of {NODES[block.type]} nodes, got {cells.shape[1]}"
        low, high = int(cells.min()), int(cells.max())
        if low < 0 or high >= len(points):
            return f"an element has the node {low if low < 0 else high}, but there are {len(points):,} nodes, from 0"
        known[cells] = True
    strange = known & ~(np.abs(points) < FARTHEST).all(axis=1)
    if strange.any():
        number = int(np.flatnonzero(strange)[0])
        place = ", ".join(f"{x:g}" for x in points[number])
        return (
            f"coordinates that are not finite or larger than {FARTHEST:g}, such as node {number} at ({place})"
        )
    return ""
