"""Bodies from files: meshes of other programs with named surfaces, geometries that gmsh meshes; checks of both."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.geometry.pore_geometry import PER_CUBE, require_few
from porocore.cell.meshing.tetrahedra import order_by_place
from porocore.core.echo import echo, joined
from porocore.core.files.foreign_mesh import (
    FORMATS,
    IN_THREE_DIMENSIONS,
    SHARED,
    mesh_of_model,
    read_mesh,
    require_apart,
)
from porocore.core.files.gmsh_model import gmsh_session, open_file
from porocore.core.files.mesh_parts import CORNERS, ForeignMesh
from porocore.core.files.reading import read_text, require_ordinary
from porocore.core.files.slices import foreign
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import HEXAHEDRON, TETRAHEDRON, BodyMesh, counted_facets
from porocore.states import Array, IntArray

KEY = "macro.body.path"
#: What gmsh meshes itself.
GEOMETRIES = (".geo", ".geo_unrolled", ".step", ".stp", ".brep", ".iges", ".igs", ".opt")
#: Commands of a .geo file that run other programs, take in what its checksum does not cover, or write files, as Printf
#: does by a later '>'. They are found in comments too, as only gmsh itself could tell for certain what is one.
REACHING_OUT = re.compile(
    r"\b(NonBlockingSystemCall|SystemCall|System|OnelabRun|ExternalProcess|Include|Merge|MergeWithBoundingBox"
    r"|ShapeFromFile|ListFromFile|FileName|Save|CreateDir)\b|\bPrint\b(?!\.)|\bPrintf\b(?=.*?>(?!=))",
    re.DOTALL,
)
#: Volume elements that are understood.
VOLUMES = ("tetra", "tetra10", "hexahedron", "hexahedron27")


def read_body(path: Path, size: float | None, scale: float) -> BodyMesh:
    """Read or make the mesh of ``path``; see :class:`porocore.macro.body.kinds.MeshedBody`.

    Raises
    ------
    ConfigurationError
        There is no such file, it cannot be read or meshed, or it holds no tetrahedra and hexahedra of one kind.
    """
    try:
        require_ordinary(path)
    except OSError as error:
        raise ConfigurationError(f"{KEY}: {path}: {error.strerror or error}") from None
    if path.suffix.lower() in GEOMETRIES and size is None:
        raise ConfigurationError(
            f"macro.body.size: missing; {path.name} is a geometry, which is meshed by it"
        )
    if path.suffix.lower() not in GEOMETRIES and size is not None:
        raise ConfigurationError(
            f"macro.body.size: {path.name} is a mesh, whose elements have their size; remove it"
        )
    try:
        foreign = read_mesh(path) if size is None else _meshed(path, size)
        return _body(foreign, path, scale)
    except ConfigurationError as error:
        said = str(error)
        raise ConfigurationError(said if said.startswith("macro.") else f"{KEY}: {said}") from None


def _body(foreign: ForeignMesh, path: Path, scale: float) -> BodyMesh:
    if len(foreign.elements[3]) != 1 or next(iter(foreign.elements[3])) not in VOLUMES:
        held = " and ".join(foreign.elements[3]) or f"none: {IN_THREE_DIMENSIONS}"
        raise ConfigurationError(
            f"expected volume elements of one kind, {', '.join(VOLUMES)}; {path.name} has {held}"
        )
    ((kind, cells),) = foreign.elements[3].items()
    kept, flat = np.unique(cells, return_inverse=True)
    points, cells = foreign.points[kept], flat.reshape(cells.shape)
    require_apart(points, path)
    mesh = _quadratic(points * scale, kind, _upright(points, cells))
    # What is near in the body is near in memory.
    elements, nodes = order_by_place(mesh.points, mesh.cells, mesh.element.corners)
    number, place = np.empty_like(nodes), np.empty_like(elements)
    number[nodes], place[elements] = np.arange(len(nodes)), np.arange(len(elements))
    mesh = BodyMesh(mesh.points[nodes], number[mesh.cells[elements]])
    #: Of the file's nodes; negative for one that no element with a volume has.
    new = -1 - np.arange(len(foreign.points))
    new[kept] = number[: len(kept)]
    faces = {
        name: [
            new[foreign.elements[2][kind][rows][:, : CORNERS[kind]]]
            for kind, rows in members.items()
            if kind in CORNERS
        ]
        for name, members in foreign.groups[2].items()
    }
    surfaces, unusable = _surfaces(mesh, faces, foreign, path)
    volumes = {
        name: np.sort(place[members[kind]]) for name, members in foreign.groups[3].items() if kind in members
    }
    return BodyMesh(
        mesh.points,
        mesh.cells,
        surfaces,
        volumes,
        unusable | _numbers(foreign, 2, path),
        _numbers(foreign, 3, path),
    )


def _numbers(foreign: ForeignMesh, dimension: int, path: Path) -> dict[str, str]:
    """Return why the number of a group that has a name cannot be used."""
    what = "surface" if dimension == 2 else "volume"
    own = {
        str(tag): f"this is the number of the {what} '{name}' of {path.name}; call it by its name"
        for tag, name in foreign.tags[dimension].items()
        if name != str(tag)
    }
    return own | {text: f"in {path.name} {why}" for text, why in foreign.clashes[dimension].items()}


def _meshed(path: Path, size: float) -> ForeignMesh:
    """Return second-order tetrahedra of a geometry; the names are those of physical surfaces and volumes."""
    suffix = path.suffix.lower()
    told = foreign(
        path,
        f"a geometry as {suffix}",
        GEOMETRIES,
        f"save it as {suffix} anew, or mesh it into a .msh file",
        SHARED,
    )
    if told:
        raise ConfigurationError(f"{path}: {told}")
    if suffix.startswith((".geo", ".opt")):
        found = REACHING_OUT.search(read_text(path).replace("\0", " "))
        if found:
            raise ConfigurationError(
                f"{path.name} holds the command {found[0]}; a geometry that is read may not execute a program, take "
                "in other files, which sha256 does not cover, or write files: leave the word out, of comments too, or "
                "mesh it into a .msh file"
            )
    with gmsh_session() as gmsh:
        try:
            open_file(gmsh, path)
            _require_few(gmsh, size)
            gmsh.option.setNumber("Mesh.MeshSizeMax", size)
            gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
            gmsh.model.mesh.generate(3)
            gmsh.model.mesh.setOrder(2)
            mesh = mesh_of_model(gmsh, path)
        except ConfigurationError:
            raise
        except Exception as error:  # gmsh raises plain Exception
            # Of a script gmsh names the line; of other files no more than that they cannot be read.
            why = (
                f" ({error})"
                if suffix.startswith(".geo")
                else ": it is damaged, cut short or of another kind"
            )
            raise ConfigurationError(
                f"gmsh could not mesh {path}{why}; save it as {suffix} anew, or mesh it into a .msh file, and read that"
            ) from error
    if list(mesh.elements[3]) != ["tetra10"]:
        raise ConfigurationError(f"gmsh made no tetrahedra alone of {path.name}; mesh it into a .msh file")
    return mesh


def _require_few(gmsh: Any, size: float) -> None:
    """Refuse a geometry without a volume, and more elements than memory holds, by the boxes around the volumes."""
    volumes = gmsh.model.getEntities(3)
    if not volumes:
        raise ConfigurationError("expected a geometry with a volume, got none, so there are no tetrahedra")
    boxes = np.array([gmsh.model.getBoundingBox(*volume) for volume in volumes])
    require_few(
        float(np.prod(boxes[:, 3:] - boxes[:, :3], axis=1).sum()) * PER_CUBE / size**3, "macro.body.size"
    )


def _upright(points: Array, cells: IntArray) -> IntArray:
    """Elements of positive volume: those of the file that are turned over are mirrored."""
    corners = 4 if cells.shape[1] in (4, 10) else 8
    spokes = (1, 2, 3) if corners == 4 else (1, 3, 4)
    edges = np.stack([points[cells[:, i]] - points[cells[:, 0]] for i in spokes], axis=1)
    over = np.linalg.det(edges) < 0
    if not over.any() or corners == 8:
        return cells
    swapped = [0, 2, 1, 3, 6, 5, 4, 7, 9, 8][: cells.shape[1]]
    cells = cells.copy()
    cells[over] = cells[over][:, swapped]
    return cells


def _quadratic(points: Array, kind: str, cells: IntArray) -> BodyMesh:
    """Add the nodes of second order, where the file has corners only."""
    if kind == "tetra10" or kind == "hexahedron27":
        return BodyMesh(points, cells)
    element = TETRAHEDRON if kind == "tetra" else HEXAHEDRON
    places = element.corner_values(element.nodes)
    #: A node is known by the corners among which it lies.
    members = [np.flatnonzero(row) for row in places]
    columns, found = [], [points]
    first = len(points)
    for size in sorted({len(m) for m in members} - {1}):
        local = [m for m in members if len(m) == size]
        keys = np.sort(np.stack([cells[:, m] for m in local], axis=1).reshape(-1, size), axis=1)
        unique, inverse = np.unique(keys, axis=0, return_inverse=True)
        found.append(points[unique].mean(axis=1))
        columns.append((local, first + inverse.reshape(len(cells), len(local))))
        first += len(unique)
    whole = np.empty((len(cells), len(element.nodes)), dtype=np.int64)
    whole[:, : element.corners] = cells
    order = {tuple(m): i for i, m in enumerate(members)}
    for local, numbers in columns:
        for j, m in enumerate(local):
            whole[:, order[tuple(m)]] = numbers[:, j]
    return BodyMesh(np.concatenate(found), whole)


def _surfaces(
    mesh: BodyMesh, faces: dict[str, list[IntArray]], foreign: ForeignMesh, path: Path
) -> tuple[dict[str, IntArray], dict[str, str]]:
    """Return the facets whose corners are those of the faces of each name, and why names cannot be used.

    A name can be used if all of its faces lie on the boundary: with a part of them, it would stand for less than the
    file says.
    """
    facets, count = counted_facets(mesh.cells)
    if (count > 2).any():
        mesh.check("macro.body")
        raise ConfigurationError(
            f"{path}: {int((count > 2).sum()):,} faces belong to more than two elements, so that elements lie over "
            "one another; mesh the body anew, so that neighbours share their nodes"
        )
    outer = facets[count == 1]
    number = {key: i for i, key in enumerate(mesh.corners_of(outer))}
    surfaces, unusable = dict[str, IntArray](), dict[str, str]()
    for name, parts in faces.items():
        keys = {tuple(sorted(face)) for part in parts for face in part.tolist()}
        if lost := keys - number.keys():
            unusable[name] = _of_lost(mesh, facets[count == 2], lost, len(keys), path)
        elif keys:
            surfaces[name] = outer[np.sort([number[key] for key in keys])]
    if not surfaces and not unusable:
        held = (
            f"its elements have the data {joined(map(echo, sorted(foreign.data)))}; " if foreign.data else ""
        )
        if not foreign.elements[2]:
            held = "it has elements with a volume alone and no faces, which must be saved too; "
        raise ConfigurationError(
            f"{path.name} names no part of its surface, so nothing can be prescribed; {held}give physical groups of "
            f'surfaces (gmsh: Physical Surface("top") = {{...}};); {FORMATS}'
        )
    return surfaces, unusable


def _of_lost(mesh: BodyMesh, inner: IntArray, lost: set[tuple[int, ...]], faces: int, path: Path) -> str:
    """Return why faces are no part of the boundary."""
    nodes = np.unique([node for key in lost for node in key])
    near = np.isin(inner[:, : mesh.element.facet_corners], nodes).all(axis=1)
    inside = len(lost.intersection(mesh.corners_of(inner[near])))
    if outside := len(lost) - inside:
        return (
            f"{outside} of its {faces} faces in {path.name} belong to no element with a volume, so that a part of the "
            "body is missing there; put all volumes into physical groups (gmsh), or take these faces out"
        )
    return (
        f"{inside} of its {faces} faces in {path.name} lie inside the body, between two elements, where nothing can "
        "be prescribed; take these faces out"
    )
