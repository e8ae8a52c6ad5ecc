"""A column of two cubes in all kinds of elements, for gmsh, meshio and files that are written by hand.

It is 1 × 2 × 1 with the volumes 'lower' and 'upper', and the surfaces 'bottom', 'top' and 'side'. All nodes lie on a
lattice of half edges, so that the nodes of every kind and program follow from where they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations
from typing import Any

import numpy as np

HEXAHEDRON = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
)
TETRAHEDRON = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
WEDGE = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)])
#: In VTK's order: corners between which further nodes lie.
_EDGES = {
    4: [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
    8: [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)],
    6: [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)],
}
_MIDDLES = [
    (0, 4, 7, 3), (1, 2, 6, 5), (0, 1, 5, 4), (3, 7, 6, 2), (0, 3, 2, 1), (4, 5, 6, 7), tuple(range(8)),
]  # fmt: skip
_FACES = {
    4: [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)],
    8: _MIDDLES[:6],
    6: [(0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)],
}
#: Corners, further nodes, kinds of faces, and gmsh's types of the elements and their faces.
KINDS: dict[str, tuple[int, list[tuple[int, ...]], dict[int, str], int]] = {
    "tetra": (4, [], {3: "triangle"}, 4),
    "tetra10": (4, _EDGES[4], {3: "triangle6"}, 11),
    "hexahedron": (8, [], {4: "quad"}, 5),
    "hexahedron20": (8, _EDGES[8], {4: "quad8"}, 17),
    "hexahedron27": (8, [*_EDGES[8], *_MIDDLES], {4: "quad9"}, 12),
    "wedge": (6, [], {3: "triangle", 4: "quad"}, 6),
}
_FACE_TYPES = {"triangle": 2, "triangle6": 9, "quad": 3, "quad8": 16, "quad9": 10}
#: Further nodes of the kinds of faces.
_OF_FACES = {"triangle": [], "triangle6": 3, "quad": [], "quad8": 4, "quad9": 5}
SURFACES: dict[str, Callable[[Any], bool]] = {
    "bottom": lambda x: (x[:, 1] == 0).all(),
    "top": lambda x: (x[:, 1] == 2).all(),
    "side": lambda x: any((x[:, a] == v).all() for a in (0, 2) for v in (0, 1)),
}


def _corners(kind: str, y: int) -> list[Any]:
    """Return the corners (n, 3) of the elements of a cube from y, in whole edges."""
    n = KINDS[kind][0]
    cube = HEXAHEDRON + np.array([0, y, 0])
    if n == 8:
        return [cube]
    if n == 6:
        # Triangles of the plane (z, x), one after the other along y.
        return [
            np.array([(x, y + up, z) for up in (0, 1) for z, x in triangle])
            for triangle in (((0, 0), (1, 0), (1, 1)), ((0, 0), (1, 1), (0, 1)))
        ]
    found = []
    for order in permutations(np.eye(3, dtype=int)):
        corners = np.cumsum([(0, y, 0), *order], axis=0)
        over = np.linalg.det(corners[1:] - corners[0]) < 0
        found.append(corners[[0, 2, 1, 3]] if over else corners)
    return found


@dataclass
class Column:
    """Mesh of one kind of elements.

    Attributes
    ----------
    points
        (n, 3) those of the lattice that are made use of, in its order.
    cells
        (k, m) elements in VTK's order, the lower ones first.
    corners, face_corners
        Corners of the elements, and those of the faces by name.
    faces
        Faces by name and kind, in VTK's order.
    """

    kind: str
    points: Any
    cells: Any
    corners: list[Any]
    faces: dict[str, dict[str, Any]]
    face_corners: dict[str, list[Any]]

    @property
    def half(self) -> int:
        """Elements in one cube."""
        return len(self.cells) // 2

    def number(self, places: Any) -> Any:
        """Return the nodes (n,) at places."""
        distance = np.abs(self.points[None] - np.asarray(places, float)[:, None]).max(axis=2)
        assert (distance.min(axis=1) < 1e-9).all()
        return distance.argmin(axis=1)


def column(kind: str) -> Column:
    """Return the column of a kind of elements."""
    _, further, of_faces, _ = KINDS[kind]
    corners = [each for y in (0, 1) for each in _corners(kind, y)]
    rows = [np.vstack([c, *(c[list(m)].mean(axis=0) for m in further)]) for c in map(np.asarray, corners)]
    points = np.unique(np.vstack(rows).astype(float), axis=0)
    # By z, then y, then x.
    points = points[np.lexsort(points.T)]
    mesh = Column(kind, points, None, corners, {}, {})
    mesh.cells = np.array([mesh.number(row) for row in rows])
    for name, holds in SURFACES.items():
        mesh.face_corners[name] = [
            c[list(face)] for c in corners for face in _FACES[len(c)] if holds(c[list(face)])
        ]
        by_kind: dict[str, list[Any]] = {}
        for face in mesh.face_corners[name]:
            of = of_faces[len(face)]
            n = len(face)
            middles = (
                [(face[i] + face[(i + 1) % n]) / 2 for i in range(n)]
                if of not in ("triangle", "quad")
                else []
            )
            middles += [face.mean(axis=0)] if of == "quad9" else []
            by_kind.setdefault(of, []).append(mesh.number(np.vstack([face, *middles])))
        mesh.faces[name] = {of: np.array(own) for of, own in by_kind.items()}
    return mesh


def _at(corners: Any, local: Any) -> Any:
    """Return the places (n, 3) of nodes with gmsh's reference coordinates (n, d) in an element with straight edges."""
    n = len(corners)
    x = np.atleast_2d(local)
    if n == 4 and x.shape[1] == 3:
        return corners[0] + x @ (corners[1:] - corners[0])
    if n == 3:
        return corners[0] + x @ (corners[1:] - corners[0])
    if n == 6:
        shares = np.column_stack([1 - x[:, 0] - x[:, 1], x[:, 0], x[:, 1]])
        up = (1 + x[:, 2:]) / 2
        return np.hstack([shares * (1 - up), shares * up]) @ corners
    signs = 2 * HEXAHEDRON[:n, : x.shape[1]] - 1
    return np.prod(1 + x[:, None] * signs, axis=2) @ corners / 2 ** x.shape[1]


#: Numbers of the physical groups.
GROUPS = {"lower": 11, "upper": 12, "all": 13, "bottom": 21, "top": 22, "side": 23, "skin": 24}


def to_gmsh(gmsh: Any, mesh: Column, groups: dict[str, int] | None = None, turned: bool = False) -> None:
    """Make a mesh gmsh's current model, with the volumes and surfaces as physical groups."""
    gmsh.clear()
    gmsh.model.add("column")
    groups = GROUPS if groups is None else groups
    numbers = np.arange(1, len(mesh.points) + 1)
    for entity in (1, 2):
        gmsh.model.addDiscreteEntity(3, entity)
    for entity in (1, 2, 3):
        gmsh.model.addDiscreteEntity(2, entity)
    gmsh.model.mesh.addNodes(3, 1, numbers, mesh.points.ravel())
    n, _, _, type_ = KINDS[mesh.kind]

    def add(dim: int, entity: int, of: int, corners: list[Any]) -> None:
        _, d, _, count, local, _ = gmsh.model.mesh.getElementProperties(of)
        local = local.reshape(count, d)
        nodes = [mesh.number(_at(np.asarray(c, float), local)) + 1 for c in corners]
        gmsh.model.mesh.addElementsByType(entity, of, [], np.concatenate(nodes))

    order = (
        {4: [0, 2, 1, 3], 8: [0, 3, 2, 1, 4, 7, 6, 5], 6: [0, 2, 1, 3, 5, 4]}[n] if turned else list(range(n))
    )
    own = [np.asarray(c)[order] for c in mesh.corners]
    for entity, part in ((1, own[: mesh.half]), (2, own[mesh.half :])):
        add(3, entity, type_, part)
    for entity, name in enumerate(SURFACES, start=1):
        faces = mesh.face_corners[name]
        for size in {len(face) for face in faces}:
            add(
                2,
                entity,
                _FACE_TYPES[KINDS[mesh.kind][2][size]],
                [face for face in faces if len(face) == size],
            )
    members = {"lower": (3, [1]), "upper": (3, [2]), "all": (3, [1, 2]), "bottom": (2, [1]), "top": (2, [2])}
    members |= {"side": (2, [3]), "skin": (2, [1, 2, 3])}
    for name, number in groups.items():
        dim, entities = members[name]
        gmsh.model.addPhysicalGroup(dim, entities, number, name)


def to_meshio(mesh: Column, data: str, **also: Any) -> Any:
    """Return a mesh of meshio whose groups are the numbers of a data set: 11 and 12 below and above, 21 to 23."""
    import meshio

    cells, numbers = [(mesh.kind, mesh.cells)], [np.repeat([11, 12], mesh.half)]
    for name, by_kind in mesh.faces.items():
        for kind, own in by_kind.items():
            cells.append((kind, own))
            numbers.append(np.full(len(own), GROUPS[name]))
    return meshio.Mesh(mesh.points, cells, cell_data={data: numbers}, **also)
