"""Bodies from files: meshes with named surfaces by meshio, geometries that gmsh meshes; checks of both."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from porocore.cell.geometry.cad import import_gmsh
from porocore.cell.meshing.estimate import PER_CUBE, require_few
from porocore.cell.meshing.tetrahedra import order_by_place
from porocore.core.files.foreign_mesh import read_mesh
from porocore.core.files.reading import read_text, require_ordinary
from porocore.errors import ConfigurationError
from porocore.macro.body.element import HEXAHEDRON, TETRAHEDRON
from porocore.macro.body.mesh import BodyMesh, boundary_facets
from porocore.states import Array, IntArray

KEY = "macro.body.path"
#: What gmsh meshes itself.
GEOMETRIES = (".geo", ".geo_unrolled", ".step", ".stp", ".brep", ".iges", ".igs", ".opt")
#: Share of the body's length within which two nodes are at the same place.
SAME = 1e-10
#: Commands of a .geo file that run other programs, or take in what its checksum does not cover.
EXECUTING = re.compile(r"\b(NonBlockingSystemCall|SystemCall|System|Include)\b")
#: Volume and surface elements that are understood: name in meshio, nodes; name, corners.
VOLUMES = {"tetra": 4, "tetra10": 10, "hexahedron": 8, "hexahedron27": 27}
FACES = {"triangle": 3, "triangle6": 3, "quad": 4, "quad8": 4, "quad9": 4}
#: Nodes, volume elements by their kind, faces by name, and numbers of the elements of each named volume.
Read = tuple[Array, dict[str, IntArray], dict[str, list[IntArray]], dict[str, IntArray]]


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
        raise ConfigurationError(f"{KEY}: {path}: {error.strerror or error}") from error
    if path.suffix.lower() in GEOMETRIES:
        if size is None:
            raise ConfigurationError(
                f"macro.body.size: missing; {path.name} is a geometry, which is meshed by it"
            )
        points, volumes, faces, named = _by_gmsh(path, size)
    elif size is not None:
        raise ConfigurationError(
            f"macro.body.size: {path.name} is a mesh, whose elements have their size; remove it"
        )
    else:
        points, volumes, faces, named = _by_meshio(path)
    if len(volumes) != 1 or next(iter(volumes)) not in VOLUMES:
        held = " and ".join(volumes) or "none"
        raise ConfigurationError(
            f"{KEY}: expected volume elements of one kind, {', '.join(VOLUMES)}; {path.name} has {held}"
        )
    ((kind, cells),) = volumes.items()
    _require_apart(points, path)
    mesh = _quadratic(points * scale, kind, _upright(points, cells))
    mesh, faces, named = _neighbours_together(mesh, faces, named)
    return BodyMesh(mesh.points, mesh.cells, _named(mesh, faces, path), named)


def _by_gmsh(path: Path, size: float) -> Read:
    """Second-order tetrahedra; the names are those of physical surfaces and volumes."""
    if path.suffix.lower().startswith(".geo"):
        found = EXECUTING.search(read_text(path).replace("\0", " "))
        if found:
            raise ConfigurationError(
                f"{KEY}: {path.name} holds the command {found[0]}; nothing that is read may execute a program, and "
                "what it includes is not covered by sha256: leave it out, or mesh it into a .msh file"
            )
    gmsh = import_gmsh()
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.open(str(path))
        _require_few(gmsh, size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        number = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
        number[tags.astype(np.int64)] = np.arange(len(tags))
        kinds, _, nodes = gmsh.model.mesh.getElements(3)
        if list(kinds) != [11]:
            raise ConfigurationError(
                f"{KEY}: gmsh made no tetrahedra alone of {path.name}; mesh it into a .msh file"
            )
        cells = number[nodes[0].astype(np.int64)].reshape(-1, 10)[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]
        faces: dict[str, list[IntArray]] = {}
        for _, group in gmsh.model.getPhysicalGroups(2):
            name = gmsh.model.getPhysicalName(2, group) or str(group)
            for entity in gmsh.model.getEntitiesForPhysicalGroup(2, group):
                triangles = gmsh.model.mesh.getElements(2, entity)[2]
                faces.setdefault(name, []).extend(
                    number[t.astype(np.int64)].reshape(-1, 6)[:, :3] for t in triangles
                )
        return *_used(coordinates.reshape(-1, 3), {"tetra10": cells}, faces), _volumes_of_gmsh(gmsh)
    except ConfigurationError:
        raise
    except Exception as error:  # gmsh raises plain Exception
        raise ConfigurationError(f"{KEY}: gmsh could not mesh {path}: {error}") from error
    finally:
        gmsh.finalize()


def _volumes_of_gmsh(gmsh: Any) -> dict[str, IntArray]:
    """Return the elements of each physical volume, by their places among all of the model."""
    tags = gmsh.model.mesh.getElements(3)[1][0]
    order = np.argsort(tags)
    found: dict[str, IntArray] = {}
    for _, group in gmsh.model.getPhysicalGroups(3):
        name = gmsh.model.getPhysicalName(3, group) or str(group)
        entities = gmsh.model.getEntitiesForPhysicalGroup(3, group)
        own = np.concatenate([gmsh.model.mesh.getElements(3, entity)[1][0] for entity in entities])
        found[name] = np.sort(order[np.searchsorted(tags, own, sorter=order)])
    return found


def _require_few(gmsh: Any, size: float) -> None:
    """Refuse a geometry without a volume, and more elements than memory holds, by the boxes around the volumes."""
    volumes = gmsh.model.getEntities(3)
    if not volumes:
        raise ConfigurationError(
            f"{KEY}: expected a geometry with a volume, got none, so there are no tetrahedra"
        )
    boxes = np.array([gmsh.model.getBoundingBox(*volume) for volume in volumes])
    require_few(
        float(np.prod(boxes[:, 3:] - boxes[:, :3], axis=1).sum()) * PER_CUBE / size**3, "macro.body.size"
    )


def _by_meshio(path: Path) -> Read:
    try:
        mesh = read_mesh(path)
    except ConfigurationError as error:
        raise ConfigurationError(f"{KEY}: {error}") from error
    volumes: dict[str, list[Any]] = {}
    faces: dict[str, list[IntArray]] = {}
    names, names_of_volumes = (
        {int(tag): name for name, (tag, dimension) in mesh.field_data.items() if dimension == d}
        for d in (2, 3)
    )
    named: dict[str, list[IntArray]] = {}
    count = 0
    tags = next(
        (mesh.cell_data[k] for k in ("gmsh:physical", "medit:ref", "surface") if k in mesh.cell_data), None
    )
    for i, block in enumerate(mesh.cells):
        if block.type in VOLUMES or block.dim == 3:
            volumes.setdefault(block.type, []).append(block.data)
            if tags is not None:
                of = np.asarray(tags[i]).ravel().astype(int)
                for tag in np.unique(of):
                    members = count + np.flatnonzero(of == tag)
                    named.setdefault(names_of_volumes.get(int(tag), str(tag)), []).append(members)
            count += len(block.data)
        elif block.type in FACES:
            corners = np.asarray(block.data)[:, : FACES[block.type]]
            of = (
                np.zeros(len(corners), dtype=int) if tags is None else np.asarray(tags[i]).ravel().astype(int)
            )
            for tag in np.unique(of):
                faces.setdefault(names.get(int(tag), str(tag)), []).append(corners[of == tag])
    joined = {k: np.concatenate(v).astype(np.int64) for k, v in volumes.items()}
    elements = {name: np.concatenate(parts) for name, parts in named.items()}
    return *_used(np.asarray(mesh.points, float), joined, faces), elements


def _used(
    points: Array, volumes: dict[str, IntArray], faces: dict[str, list[IntArray]]
) -> tuple[Array, dict[str, IntArray], dict[str, list[IntArray]]]:
    """Leave out the nodes that no volume element has, and the faces on them."""
    kept = np.unique(np.concatenate([np.zeros(0, np.int64), *(cells.ravel() for cells in volumes.values())]))
    number = np.full(len(points), -1, dtype=np.int64)
    number[kept] = np.arange(len(kept))
    found = {name: [number[part] for part in parts] for name, parts in faces.items()}
    on = {name: [part[(part >= 0).all(axis=1)] for part in parts] for name, parts in found.items()}
    return points[kept], {kind: number[cells] for kind, cells in volumes.items()}, on


def _require_apart(points: Array, path: Path) -> None:
    """Refuse nodes that are there twice, between which the body would be torn."""
    grain = np.ptp(points, axis=0).max() * SAME if len(points) else 0.0
    if grain > 0 and (twice := len(points) - len(np.unique(np.rint(points / grain), axis=0))):
        raise ConfigurationError(
            f"{KEY}: {twice:,} nodes of {path.name} lie at the same place as others, so that the body is torn there; "
            "merge them (gmsh: Coherence Mesh;)"
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


def _neighbours_together(
    mesh: BodyMesh, faces: dict[str, list[IntArray]], named: dict[str, IntArray]
) -> tuple[BodyMesh, dict[str, list[IntArray]], dict[str, IntArray]]:
    """Number elements and nodes by place, so that what is near in the body is near in memory."""
    elements, nodes = order_by_place(mesh.points, mesh.cells, mesh.element.corners)
    number, place = np.empty_like(nodes), np.empty_like(elements)
    number[nodes], place[elements] = np.arange(len(nodes)), np.arange(len(elements))
    return (
        BodyMesh(mesh.points[nodes], number[mesh.cells[elements]]),
        {name: [number[part] for part in parts] for name, parts in faces.items()},
        {name: np.sort(place[own]) for name, own in named.items()},
    )


def _named(mesh: BodyMesh, faces: dict[str, list[IntArray]], path: Path) -> dict[str, IntArray]:
    """Facets of the boundary whose corners are those of the faces of each name."""
    facets = boundary_facets(mesh.cells)
    corners = facets[:, : mesh.element.facet_corners]
    number = {tuple(key): i for i, key in enumerate(np.sort(corners, axis=1).tolist())}
    surfaces = {}
    for name, parts in faces.items():
        places = [number.get(tuple(sorted(face))) for part in parts for face in part.tolist()]
        inside = [p for p in places if p is not None]
        if inside:
            surfaces[name] = facets[np.unique(inside)]
    if not surfaces:
        raise ConfigurationError(
            f"{KEY}: {path.name} names no part of its surface, so nothing can be prescribed; give physical groups of "
            'surfaces (gmsh: Physical Surface("top") = {...};)'
        )
    return surfaces
