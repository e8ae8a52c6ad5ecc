"""Small bodies of the suite of macro solvers, one of them a file of tetrahedra."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from porocore.macro.body.kinds import Box, make_body

#: A cube's corners numbered as bits xyz, cut into six tetrahedra about its diagonal; neighbours match.
KUHN = ((0, 1, 3, 7), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7), (0, 4, 5, 7), (0, 5, 1, 7))


def write_tetrahedra(path: Path, box: Box, bend: float = 0.0, turn: Any = None) -> None:
    """Write a box of linear tetrahedra with its six faces by name, in gmsh's format.

    Inner nodes are moved by ``bend``, and the whole is rotated by ``turn`` (3, 3).
    """
    import meshio

    mesh = make_body(box)
    points = mesh.points[mesh.p_nodes]
    bits = mesh.p_cells[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    tetrahedra = np.concatenate([bits[:, list(kuhn)] for kuhn in KUHN])
    tetrahedra = np.where(
        (np.linalg.det(points[tetrahedra[:, 1:]] - points[tetrahedra[:, :1]]) < 0)[:, None],
        tetrahedra[:, [0, 2, 1, 3]],
        tetrahedra,
    )
    size = np.array(box.size)
    inner = ((points > 1e-9) & (points < size - 1e-9)).all(axis=1)
    triangles = tetrahedra[:, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]].reshape(-1, 3)
    blocks, tags, names = [("tetra", tetrahedra)], [np.full(len(tetrahedra), 7)], {"body": [7, 3]}
    for axis, letter in enumerate("xyz"):
        for side, place in (("-", 0.0), ("+", size[axis])):
            on = (np.abs(points[triangles][..., axis] - place) < 1e-9).all(axis=1)
            tag = 10 + 2 * axis + (side == "+")
            blocks.append(("triangle", triangles[on]))
            tags.append(np.full(int(on.sum()), tag))
            names[letter + side] = [tag, 2]
    points = points + bend * inner[:, None] * np.sin(7 * points[:, [1, 2, 0]] + 1)
    points = points if turn is None else points @ np.transpose(turn)
    meshio.write(
        path,
        meshio.Mesh(
            points,
            blocks,
            cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
            field_data={name: np.array(value) for name, value in names.items()},
        ),
        file_format="gmsh22",
    )


def make(kind: str, folder: Path) -> dict[str, Any]:
    """Return the settings of a small body of a kind."""
    if kind == "tetrahedra":
        write_tetrahedra(folder / "box.msh", Box(size=(1, 1.2, 0.8), elements=(2, 2, 2)), bend=0.05)
        return {"kind": "file", "path": str(folder / "box.msh")}
    angle = {"angle": 60} if kind == "wedge" else {}
    return {"kind": kind, "radius": 1.0, "height": 0.7, "elements": (1, 2, 1), **angle}
