"""Bodies from files: meshes of other programs with named surfaces, geometries that gmsh meshes; checks of both."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from porocore.cell.geometry.pore_geometry import PER_CUBE, require_few
from porocore.cell.meshing.tetrahedra import order_by_place
from porocore.core.echo import echo, joined
from porocore.core.files.foreign_mesh import (
    FORMATS,
    IN_THREE_DIMENSIONS,
    SHARED,
    how_to_convert,
    mesh_of_model,
    read_mesh,
    require_apart,
)
from porocore.core.files.gmsh_model import gmsh_session, open_file
from porocore.core.files.mesh_parts import CORNERS, SERENDIPITY, ForeignMesh
from porocore.core.files.reading import read_text, require_ordinary
from porocore.core.files.slices import foreign
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import (
    HEXAHEDRON,
    QUADRILATERAL,
    TETRAHEDRON,
    TRIANGLE,
    BodyMesh,
    ReferenceElement,
    counted_facets,
)
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
#: Depth, as a share of an element's radius, from which a place is inside it, and not on a face that is curved.
INSIDE = 0.05
#: Of the size of a flat mesh, up to which its nodes are in one plane; triangles in a square of the size of an element.
IN_PLANE, PER_SQUARE = 1e-9, 2.4
#: Volume elements that are understood.
VOLUMES = ("tetra", "tetra10", "hexahedron", SERENDIPITY, "hexahedron27")
#: Elements of bodies in two dimensions that are.
FLAT = ("triangle", "triangle6", "quad", "quad8", "quad9")
#: Elements that are completed by nodes in the middle, by their kind.
COMPLETED: dict[str, ReferenceElement] = {
    "tetra": TETRAHEDRON,
    "hexahedron": HEXAHEDRON,
    SERENDIPITY: HEXAHEDRON,
    "triangle": TRIANGLE,
    "quad": QUADRILATERAL,
    "quad8": QUADRILATERAL,
}


def read_body(path: Path, size: float | None, scale: float, flat: bool = False) -> BodyMesh:
    """Read or make the mesh of ``path``; see :class:`porocore.macro.body.kinds.MeshedBody`.

    A ``flat`` one lies in the plane z = 0.

    Raises
    ------
    ConfigurationError
        There is no such file, it cannot be read or meshed, or it holds no elements of one kind that is understood.
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
        foreign = read_mesh(path, flat=flat) if size is None else _meshed(path, size, flat)
        return _body(foreign, path, scale, flat)
    except ConfigurationError as error:
        said = str(error)
        raise ConfigurationError(said if said.startswith("macro.") else f"{KEY}: {said}") from None


def _body(foreign: ForeignMesh, path: Path, scale: float, flat: bool) -> BodyMesh:
    if flat and (len(foreign.elements[3]) != 1 or next(iter(foreign.elements[3])) not in FLAT):
        held = joined(foreign.elements[3]) or "none"
        raise ConfigurationError(
            f"expected elements of the plane of one kind, {', '.join(FLAT)}; {path.name} has {held}: mesh one surface "
            "in two dimensions (gmsh -2), all with triangles or all recombined to quadrilaterals"
        )
    if not flat and (len(foreign.elements[3]) != 1 or next(iter(foreign.elements[3])) not in VOLUMES):
        held = joined(foreign.elements[3]) if foreign.elements[3] else ""
        raise ConfigurationError(
            f"expected volume elements of one kind, {', '.join(VOLUMES)}; {path.name} has "
            + (f"{held}; {how_to_convert(foreign.elements[3])}" if held else f"none: {IN_THREE_DIMENSIONS}")
            + "; a mesh of a meridian or of a section needs 'flat: axisymmetric' or 'flat: plane-strain'"
        )
    ((kind, cells),) = foreign.elements[3].items()
    kept, rows = np.unique(cells, return_inverse=True)
    points, cells = foreign.points[kept], rows.reshape(cells.shape)
    require_apart(points, path)
    if flat and np.ptp(points[:, 2]) > IN_PLANE * np.ptp(points, axis=0).max():
        raise ConfigurationError(
            f"{path}: expected a mesh in the plane z = 0, or in one parallel to it, got z from "
            f"{points[:, 2].min():.4g} to {points[:, 2].max():.4g}; turn it so that x and y are "
            "the coordinates of the section"
        )
    if flat:
        points = points * np.array([1.0, 1.0, 0.0])
    corners = np.sort(cells[:, : CORNERS[kind]], axis=1)
    collapsed = int((corners[:, 1:] == corners[:, :-1]).any(axis=1).sum())
    if collapsed and not kind.startswith(("tetra", "tri")):
        raise ConfigurationError(
            f"{path}: {collapsed:,} of {len(cells):,} {kind} elements have one node at several corners, such as wedges "
            f"that are written as hexahedra; {how_to_convert(['wedge'])}"
        )
    mesh = _upright(_quadratic(points * scale, kind, cells))
    # What is near in the body is near in memory.
    elements, nodes = order_by_place(mesh.points, mesh.cells, mesh.element.corners)
    number, place = np.empty_like(nodes), np.empty_like(elements)
    number[nodes], place[elements] = np.arange(len(nodes)), np.arange(len(elements))
    mesh = BodyMesh(mesh.points[nodes], number[mesh.cells[elements]])
    #: Of the file's nodes; negative for one that no element with a volume has.
    new = -1 - np.arange(len(foreign.points))
    new[kept] = number[: len(kept)]
    surfaces, unusable = _surfaces(mesh, new, foreign, path)
    volumes = {
        name: np.sort(place[members[kind]]) for name, members in foreign.groups[3].items() if kind in members
    }
    clashes = [
        {text: f"in {path.name} {why}" for text, why in foreign.clashes[dim].items()} for dim in (2, 3)
    ]
    numbers = [
        {str(tag): name for tag, name in foreign.tags[dim].items() if name != str(tag)} for dim in (2, 3)
    ]
    return BodyMesh(
        mesh.points, mesh.cells, surfaces, volumes, unusable | clashes[0], clashes[1], numbers[0], numbers[1]
    )


def _meshed(path: Path, size: float, flat: bool) -> ForeignMesh:
    """Return second-order tetrahedra of a geometry; the names are those of physical surfaces and volumes.

    Of a ``flat`` one they are triangles, and the names those of physical curves and surfaces.
    """
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
            _require_few(gmsh, size, flat)
            gmsh.option.setNumber("Mesh.MeshSizeMax", size)
            gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
            gmsh.model.mesh.generate(2 if flat else 3)
            gmsh.model.mesh.setOrder(2)
            mesh = mesh_of_model(gmsh, path, flat)
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
    if not flat and list(mesh.elements[3]) != ["tetra10"]:
        raise ConfigurationError(f"gmsh made no tetrahedra alone of {path.name}; mesh it into a .msh file")
    return mesh


def _require_few(gmsh: Any, size: float, flat: bool) -> None:
    """Refuse a geometry without a volume, and more elements than memory holds, by the boxes around the volumes.

    Of a ``flat`` one they are surfaces.
    """
    volumes = gmsh.model.getEntities(2 if flat else 3)
    if flat and not volumes:
        raise ConfigurationError("expected a geometry with a surface, got none, so there are no triangles")
    if not volumes:
        raise ConfigurationError("expected a geometry with a volume, got none, so there are no tetrahedra")
    boxes = np.array([gmsh.model.getBoundingBox(*volume) for volume in volumes])
    if flat:
        areas = np.prod(boxes[:, 3:5] - boxes[:, :2], axis=1).sum()
        require_few(float(areas) * PER_SQUARE / size**2, "macro.body.size")
        return
    require_few(
        float(np.prod(boxes[:, 3:] - boxes[:, :3], axis=1).sum()) * PER_CUBE / size**3, "macro.body.size"
    )


def _upright(mesh: BodyMesh) -> BodyMesh:
    """Return the mesh with the elements mirrored that are turned over at all of their quadrature points."""
    over = (mesh.weights < 0).all(axis=1)
    if not over.any():
        return mesh
    place = {tuple(node): i for i, node in enumerate(mesh.element.nodes.tolist())}
    mirrored = [place[y, x, z] for x, y, z in mesh.element.nodes.tolist()]
    return BodyMesh(mesh.points, np.where(over[:, None], mesh.cells[:, mirrored], mesh.cells))


def _quadratic(points: Array, kind: str, cells: IntArray) -> BodyMesh:
    """Add the nodes that the file lacks, in the middle of straight edges and faces.

    The 20-node hexahedron gets the middles of its faces and its own where its shape functions place them: a quarter of
    the corners is subtracted from half of the middles of a face's edges, and from a quarter of all of them.
    """
    if kind not in COMPLETED:
        return BodyMesh(points, cells)
    element = COMPLETED[kind]
    places = element.corner_values(element.nodes)
    #: A node is known by the corners among which it lies.
    members = [np.flatnonzero(row) for row in places]
    known = cells.shape[1]
    columns, found = [], [points]
    first = len(points)
    for size in sorted({len(m) for m in members[known:]}):
        local = [m for m in members[known:] if len(m) == size]
        keys = np.sort(np.stack([cells[:, m] for m in local], axis=1).reshape(-1, size), axis=1)
        _, where, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        middles = []
        for corners in local:
            middle = points[cells[:, corners]].mean(axis=1)
            if own := [i for i in range(element.corners, known) if set(members[i]) <= set(corners)]:
                middle = points[cells[:, own]].sum(axis=1) * 2 / size - middle * size / 4
            middles.append(middle)
        found.append(np.stack(middles, axis=1).reshape(-1, 3)[where])
        columns.append(first + inverse.reshape(len(cells), len(local)))
        first += len(where)
    return BodyMesh(np.concatenate(found), np.concatenate([cells, *columns], axis=1))


def _covered(mesh: BodyMesh, outer: IntArray) -> int:
    """Return how many facets (k, m) of the boundary have a point inside an element.

    Elements that lie over one another have such facets, since a place is in as many elements as its neighbour is, but
    beyond a facet of the boundary.
    """
    corners = mesh.element.facet_corners
    middles = mesh.points[outer[:, :corners]].mean(axis=1)
    places = (middles[:, None] + mesh.points[outer[:, :corners]]) / 2
    of_facet = np.repeat(np.arange(len(outer)), corners)
    centres = mesh.points[mesh.cells].mean(axis=1)
    radii = np.linalg.norm(mesh.points[mesh.cells] - centres[:, None], axis=2).max(axis=1)
    near = cKDTree(places.reshape(-1, 3)).query_ball_point(centres, radii, workers=1)
    element = np.repeat(np.arange(len(near)), [len(each) for each in near])
    place = np.concatenate([np.asarray(each, dtype=np.int64) for each in near])
    faces = mesh.cells[:, mesh.element.facets[:, :corners]]
    inside = np.ones(len(place), dtype=bool)
    for k in range(faces.shape[1]):
        of = mesh.points[faces[:, k]]
        middle = of.mean(axis=1)
        # Of a quadrilateral by its diagonals.
        first, second = (
            (of[:, 1] - of[:, 0], [0, 0, 1]) if mesh.flat else (of[:, 1] - of[:, -1], of[:, 2] - of[:, 0])
        )
        normal = np.cross(first, second)
        depth = np.einsum("ki,ki->k", middle[element] - places.reshape(-1, 3)[place], normal[element])
        inside &= depth > (INSIDE * radii * np.linalg.norm(normal, axis=1))[element]
    return len(np.unique(of_facet[place[inside]]))


def _surfaces(
    mesh: BodyMesh, new: IntArray, foreign: ForeignMesh, path: Path
) -> tuple[dict[str, IntArray], dict[str, str]]:
    """Return the facets whose corners are those of the faces of each name, and why names cannot be used.

    A name can be used if all of its faces lie on the boundary: with a part of them, it would stand for less than the
    file says. A set of nodes has the facets of which it has all corners; where faces have its name, it stands back.
    ``new`` are the numbers of the file's nodes in the mesh.
    """
    facets, count = counted_facets(mesh.cells)
    if (count > 2).any():
        mesh.check("macro.body")
        raise ConfigurationError(
            f"{path}: {int((count > 2).sum()):,} faces belong to more than two elements, so that elements lie over "
            "one another; mesh the body anew, so that neighbours share their nodes"
        )
    outer = facets[count == 1]
    if over := _covered(mesh, outer):
        raise ConfigurationError(
            f"{path}: {over:,} of {len(outer):,} faces of the boundary lie inside other elements, so that elements lie "
            "over one another; mesh the body anew, each place once"
        )
    number = {key: i for i, key in enumerate(mesh.corners_of(outer))}
    surfaces, unusable = dict[str, IntArray](), dict[str, str]()
    for name, members in foreign.groups[2].items():
        keys = {
            tuple(sorted(face))
            for kind, rows in members.items()
            if kind in CORNERS
            for face in new[foreign.elements[2][kind][rows][:, : CORNERS[kind]]].tolist()
        }
        if lost := keys - number.keys():
            said = _of_lost(mesh, facets[count == 2], lost, len(keys), path)
            unusable[name] = (
                said.replace("faces", "edges").replace(" with a volume", "") if mesh.flat else said
            )
        elif keys:
            surfaces[name] = outer[np.sort([number[key] for key in keys])]
    corners = outer[:, : mesh.element.facet_corners]
    for name, nodes in foreign.node_groups.items():
        own = np.isin(corners, new[nodes]).all(axis=1)
        if name in surfaces or name in unusable:
            continue
        if own.any():
            surfaces[name] = outer[own]
        else:
            unusable[name] = (
                f"this is a set of {len(nodes):,} nodes in {path.name}, in which no facet of the boundary has all of "
                "its corners"
            )
    if not surfaces:
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
