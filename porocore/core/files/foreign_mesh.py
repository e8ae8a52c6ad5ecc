"""Meshes of other programs (ForeignMesh): elements, each once, and named groups, read by gmsh or by meshio."""

from __future__ import annotations

import io
import json
import mmap
import re
import threading
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.echo import echo, joined
from porocore.core.files.abaqus_mesh import AbaqusFile
from porocore.core.files.exodus_mesh import SUFFIXES as EXODUS
from porocore.core.files.exodus_mesh import exodus_parts
from porocore.core.files.gmsh_model import Arrays, file_arrays, model_arrays
from porocore.core.files.mesh_parts import CORNERS, SERENDIPITY, ForeignMesh, Parts, decoded, whole
from porocore.core.files.slices import foreign, renamed, told_by
from porocore.errors import ConfigurationError
from porocore.states import Array

#: Kinds of elements in gmsh's numbering, and the place in gmsh of each node in VTK's order where the two differ.
_OF_GMSH = {
    1: "line", 8: "line3", 2: "triangle", 3: "quad", 4: "tetra", 5: "hexahedron", 6: "wedge", 7: "pyramid",
    9: "triangle6", 10: "quad9", 11: "tetra10", 12: "hexahedron27", 16: "quad8", 17: SERENDIPITY,
}  # fmt: skip
_SERENDIPITY = [*range(9), 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15]
_ORDERS = {
    "tetra10": [0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
    SERENDIPITY: _SERENDIPITY,
    "hexahedron27": [*_SERENDIPITY, 22, 23, 21, 24, 20, 25, 26],
}
#: Data of elements that number groups, in the order in which they are looked for; those of faces are looked for first
#: where faces are meant, and last where volumes are.
PHYSICAL, GEOMETRICAL = "gmsh:physical", "gmsh:geometrical"
_OF_FACES = "surface"
_NUMBERINGS = (
    PHYSICAL, "medit:ref", "phase", "region", "cell_tags", "material", "su2:tag", "nastran:ref", "CellEntityIds",
    GEOMETRICAL,
)  # fmt: skip
#: How a file of gmsh begins. Others gmsh would take for a script, and execute.
_BEGINNINGS = (b"$MeshFormat", b"$Comments")
#: Share of the mesh's length within which two nodes are at the same place.
SAME_PLACE = 1e-10
#: Names of data that number groups, as messages tell them.
KNOWN_DATA = ", ".join((*_NUMBERINGS[:-1], _OF_FACES))
FORMATS = (
    "names are read from .msh (gmsh), .med (Salome), .inp (Abaqus, CalculiX), .e, .exo, .ex2 and .g (Exodus) and .su2, "
    f"numbers from others such as .vtu, .xdmf and .mesh, where data of elements called {KNOWN_DATA} hold whole numbers"
)

#: What to do with a file of surfaces alone.
IN_THREE_DIMENSIONS = (
    "mesh the volume in three dimensions; in gmsh a surface loop makes a volume ('Surface Loop', 'Volume'), and "
    "'gmsh -3' meshes it"
)
SAVE = "save the mesh anew, best as .msh of gmsh of version 4.1 or 2.2"
#: Content of sound files that are not read, by suffix: a pattern of it, what it is, and what to do.
_UNREAD = {
    ".mesh": (rb"[a-z]P2\b", "has elements of second order, which are not read from .mesh", SAVE),
    ".dat": (rb"(?m)^(BEGIN BULK|GRID\b)", "is one of Nastran", "rename it to .bdf"),
    ".cgns": (rb"CGNSLibraryVersion", "was not written by meshio, which reads its own .cgns alone", SAVE),
}
#: Last tags of files in XML.
_XML = {".vtu": b"</VTKFile>", ".xdmf": b"</Xdmf>", ".xmf": b"</Xdmf>"}
#: Kinds of first bytes that many formats share.
SHARED = ("text", "an HDF5 file")

_ONE_AT_A_TIME = threading.Lock()


def read_mesh(path: Path, numbering: str | None = None, flat: bool = False) -> ForeignMesh:
    """Read a mesh file: .msh with gmsh itself, others with meshio.

    Parameters
    ----------
    path
        The file.
    numbering
        Data of the elements whose whole numbers are the groups with a volume; None: the groups of the file.
    flat
        Take the elements of the plane in place of those with a volume, and edges in place of faces, of a .msh file.

    Raises
    ------
    ConfigurationError
        It cannot be read, its nodes and elements do not fit together, or elements are given twice; the message begins
        with the path.
    """
    try:
        beginning = _beginning(path)
    except OSError as error:
        raise ConfigurationError(f"{path}: {error.strerror or 'cannot be read'}") from None
    if not beginning:
        raise ConfigurationError(f"{path}: the file is empty; expected a mesh, so write it again")
    if path.suffix.lower() == ".msh" and beginning.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"$"):
        if not beginning.startswith(_BEGINNINGS):
            raise ConfigurationError(
                f"{path}: expected a file that begins with $MeshFormat, got {_first_words(beginning)}; save it anew, "
                "as .msh of version 4.1 or 2.2"
            )
        return _read_by_gmsh(path, numbering, flat)
    if flat:
        raise ConfigurationError(
            f"{path}: a body in two dimensions is read from a .msh file of gmsh, or meshed from a geometry; save the "
            "mesh as .msh of version 4.1 or 2.2"
        )
    return _read_other(path, numbering)


def read_point_data(path: Path) -> tuple[Array, dict[str, Any]]:
    """Return the points (n, 3) of a file that meshio reads, such as .vtu, and their data by name.

    Raises
    ------
    ConfigurationError
        It cannot be read; the message begins with the path.
    """
    import meshio  # heavy, and needed here only

    said = io.StringIO()
    try:
        # What it prints is redirected for all threads.
        with _ONE_AT_A_TIME, redirect_stdout(said), redirect_stderr(said):
            mesh = meshio.read(path)
        points = np.asarray(mesh.points, dtype=float)
        if points.ndim != 2 or points.shape[1] not in (2, 3):
            raise ValueError(f"points of the shape {points.shape}")
    # Readers raise whatever the file makes them stumble over; some of meshio's print and end the process.
    except (Exception, SystemExit) as error:
        how = "is cut short, before its last tag" if _is_cut(path) else "is damaged or of another kind"
        raise ConfigurationError(
            f"{path}: expected points with data that meshio reads, such as .vtu, got a file that {how}; write it again"
        ) from error
    flat = np.zeros((len(points), 3 - points.shape[1]))
    return np.hstack([points, flat]), {name: np.asarray(data) for name, data in mesh.point_data.items()}


def require_apart(points: Array, path: Path) -> None:
    """Refuse nodes (n, 3) that are there twice, between which a mesh would be torn.

    Raises
    ------
    ConfigurationError
        Some are; the message begins with the path.
    """
    grain = np.ptp(points, axis=0).max() * SAME_PLACE if len(points) else 0.0
    if grain > 0 and (twice := len(points) - len(np.unique(np.rint(points / grain), axis=0))):
        raise ConfigurationError(
            f"{path}: {twice:,} nodes lie at the same place as others, so that the mesh is torn there; merge them "
            "(gmsh: Coherence Mesh;)"
        )


def how_to_convert(kinds: Iterable[str]) -> str:
    """Return how a mesh of kinds of elements that are not read, or not together, becomes one that is."""
    kinds = set(kinds)
    of_one_shape = kinds <= {"tetra", "tetra10"} or kinds <= {"hexahedron", SERENDIPITY, "hexahedron27"}
    if len(kinds) > 1 and of_one_shape:
        return "save all elements with the same order (gmsh: -order 1 or -order 2)"
    if kinds <= CORNERS.keys() or any(kind.startswith(("wedge", "pyramid")) for kind in kinds):
        return (
            "mesh it with tetrahedra alone, or split all elements into tetrahedra (gmsh: without Recombine; Salome: "
            "Split Volumes; Cubit: htet)"
        )
    return "save the mesh with elements of first or second order (gmsh: -order 2)"


def mesh_of_model(gmsh: Any, path: Path, flat: bool = False) -> ForeignMesh:
    """Return the mesh of gmsh's current model with its physical groups; messages begin with ``path``."""
    arrays = model_arrays(gmsh, flat)
    names = {each: gmsh.model.getPhysicalName(*each) for each in gmsh.model.getPhysicalGroups()}
    return _of_model(arrays, path, names, None, by_group=False, flat=flat)


def _beginning(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(200)


def _sort_of(path: Path) -> str:
    """Return what the suffix of a mesh promises, in words."""
    return f"a mesh as {path.suffix.lower()}"


def _require_suffix(path: Path) -> None:
    """Refuse a file whose suffix is that of no mesh, or whose first bytes are those of another kind."""
    from meshio import extension_to_filetypes  # heavy, and needed here only

    suffixes = [*extension_to_filetypes, *EXODUS]
    suffix = path.suffix.lower()
    kind = told_by(path)
    if suffix not in suffixes:
        got = f"'{suffix}'" if suffix else "a file without a suffix"
        then = renamed(path, kind, suffixes) or (kind.advice if kind else "") or SAVE
        raise ConfigurationError(
            f"{path}: expected a mesh as .msh, .vtu, .med or another that meshio reads, got {got}"
            + (f", {kind.name} by its first bytes" if kind else "")
            + f"; {then}"
        )
    ignored = () if suffix in _XML else SHARED
    if told := foreign(path, _sort_of(path), suffixes, SAVE, ignored):
        raise ConfigurationError(f"{path}: {told}")


def _is_cut(path: Path) -> bool:
    """Return whether a file in XML ends before its last tag; False for other formats, which have no end to look for."""
    last = _XML.get(path.suffix.lower())
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 1000))
        return last is not None and not file.read().rstrip().endswith(last)


def _first_words(beginning: bytes) -> str:
    if beginning.startswith(b"\xef\xbb\xbf"):
        return "a byte order mark before it"
    return repr(beginning.decode("utf-8", "replace")[:20])


def _read_by_gmsh(path: Path, numbering: str | None, flat: bool) -> ForeignMesh:
    """Read a .msh file; without physical groups the entities of the model are the groups."""
    with path.open("rb") as file:
        version_2 = re.search(rb"\$MeshFormat\s+[12](\.\d+)?\s", file.read(10_000)) is not None
    by_group = version_2 and numbering != GEOMETRICAL
    arrays, names = file_arrays(path, by_group, flat), _physical_names(path)
    mesh = _of_model(arrays, path, names, numbering, by_group=by_group, flat=flat)
    if numbering is None and not any(mesh.groups.values()):
        return _read_by_gmsh(path, GEOMETRICAL, flat)
    return mesh


def _physical_names(path: Path) -> dict[tuple[int, int], str]:
    """Return the names of physical groups by dimension and number; gmsh forgets one that two groups have."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        first, last = content.find(b"$PhysicalNames"), content.find(b"$EndPhysicalNames")
        section = decoded(content[max(first, 0) : max(last, 0)])
    found = {}
    for line in section.splitlines():
        if known := re.fullmatch(r'\s*(\d+)\s+(\d+)\s+"(.*)"\s*', line):
            found[int(known[1]), int(known[2])] = known[3]
    return found


def _of_model(
    arrays: Arrays,
    path: Path,
    names: Mapping[tuple[int, int], str],
    numbering: str | None,
    *,
    by_group: bool,
    flat: bool,
) -> ForeignMesh:
    """Return the mesh of a model of gmsh.

    Parameters
    ----------
    arrays
        From :func:`porocore.core.files.gmsh_model.model_arrays`.
    path
        With which messages begin.
    names
        Of physical groups by dimension and number.
    numbering
        As in :func:`read_mesh`.
    by_group
        The number of an entity is that of the physical group of its elements, 0 without.
    flat
        Faces take the place of volumes, and edges that of faces.
    """
    tags, parts = arrays["tags"], Parts(path)
    if not len(tags):
        volumes = joined(echo(name) for (dim, _), name in names.items() if dim == 3)
        raise ConfigurationError(
            f"{path}: no nodes are in this file; "
            + (f"mesh its volumes {volumes} too, by 'gmsh -3', or, where " if volumes else "")
            + f"it is damaged or cut short{',' if volumes else ':'} save it anew"
        )
    kinds, views = json.loads(str(arrays["kinds"])), json.loads(str(arrays["views"]))
    blocks: dict[tuple[int, str], list[tuple[int, int]]] = {}
    if flat:
        names = {(dim + 1, group): name for (dim, group), name in names.items()}
    for i, (own, type_, entity) in enumerate(arrays["blocks"].tolist()):
        dim = own + flat
        blocks.setdefault((dim, _OF_GMSH.get(type_, kinds[str(type_)])), []).append((i, entity))
    for (dim, kind), of in blocks.items():
        # By their numbers, which are their order in most files, so that one mesh is one in every format.
        order = np.argsort(np.concatenate([arrays[f"elements{i}"] for i, _ in of]), kind="stable")
        nodes = np.searchsorted(tags, np.concatenate([arrays[f"nodes{i}"] for i, _ in of])[order])
        parts.add(dim, kind, nodes[:, _ORDERS[kind]] if kind in _ORDERS else nodes)
        place = np.empty_like(order)
        place[order] = np.arange(len(order))
        first = 0
        for i, entity in of:
            elements = arrays[f"elements{i}"]
            rows = place[first : first + len(elements)]
            first += len(elements)
            groups = [group for group in ([entity] if by_group else arrays[f"groups{i}"].tolist()) if group]
            if dim == 3:
                number = groups[0] if len(groups) == 1 else np.nan if groups else 0
                parts.set_data(PHYSICAL, kind, rows, np.full(len(rows), float(number)))
                if not by_group:
                    parts.set_data(GEOMETRICAL, kind, rows, np.full(len(rows), float(entity)))
                for j, name in enumerate(views):
                    known, values = arrays[f"view{j}"], _without_columns(arrays[f"values{j}"])
                    at = np.minimum(np.searchsorted(known, elements), len(known) - 1)
                    there = known[at] == elements
                    parts.set_data(name, kind, rows[there], values[at[there]])
            if numbering == GEOMETRICAL:
                parts.join(dim, kind, rows, "", entity)
            elif numbering in (None, PHYSICAL) or dim == 2:
                for group in groups:
                    parts.join(dim, kind, rows, names.get((dim, group), ""), group)
    return parts.mesh(arrays["points"], None if numbering in (PHYSICAL, GEOMETRICAL) else numbering)


def _read_other(path: Path, numbering: str | None) -> ForeignMesh:
    _require_suffix(path)
    said = io.StringIO()
    try:
        parts, points = _parts(path, numbering, said)
    except ConfigurationError:
        raise
    # Readers raise whatever the file makes them stumble over; some of meshio's print and end the process.
    except (Exception, SystemExit) as error:
        how, then = "is damaged, cut short or of another kind", SAVE
        pattern, what, advice = _UNREAD.get(path.suffix.lower(), (b"", "", ""))
        if pattern and re.search(pattern, path.read_bytes()):
            how, then = what, advice
        elif isinstance(error, KeyError):
            how = f"has parts, or elements of a type, that meshio does not know ({error.args[0]})"
            then = "save the mesh as .msh of gmsh of version 4.1 or 2.2, or with other elements"
        elif _is_cut(path):
            how = "is cut short, before its last tag"
        raise ConfigurationError(
            f"{path}: not a mesh that can be read: expected {_sort_of(path)}, got a file that {how}; {then}"
        ) from error
    if not points.size:
        raise ConfigurationError(
            f"{path}: expected {_sort_of(path)}, got a file without nodes, which is damaged, cut short or of another "
            f"kind; {SAVE}"
        )
    if points.ndim != 2 or points.shape[1] != 3 or not np.issubdtype(points.dtype, np.number):
        raise ConfigurationError(
            f"{path}: expected nodes in three dimensions, got {points.shape[-1]} coordinates of each; {SAVE}"
        )
    return parts.mesh(points.astype(float), numbering)


def _parts(path: Path, numbering: str | None, said: io.StringIO) -> tuple[Parts, Any]:
    """Return the parts of a mesh and its nodes; what readers print goes to ``said``."""
    suffix = path.suffix.lower()
    if suffix == ".inp":
        return AbaqusFile(path).mesh_parts()
    if suffix in EXODUS:
        return exodus_parts(path)
    import meshio  # heavy, and needed here only

    # What it prints is redirected for all threads.
    with _ONE_AT_A_TIME, redirect_stdout(said), redirect_stderr(said):
        mesh = _READERS.get(suffix, meshio.read)(path)
    return _of_meshio(mesh, path, numbering), np.asarray(mesh.points)


def _read_med(path: Path) -> Any:
    """Read a file of Salome, of which meshio takes names of groups in ASCII alone, and no families without groups.

    The bytes of the names are signed there. meshio makes a letter of each, which fails with negative ones.
    """
    import h5py  # heavy, and needed here only
    import meshio

    names: dict[str, Any] = {}
    bare: list[str] = []

    def collect(name: str, entry: Any) -> None:
        if name.endswith("/GRO/NOM"):
            names[name] = entry[()]
        elif re.search(r"/(ELEME|NOEUD)/[^/]+$", name) and "GRO" not in entry:
            bare.append(name)

    with h5py.File(path) as file:
        file.visititems(collect)
    if not bare and all((of >= 0).all() for of in names.values()):
        return meshio.read(path)
    content = io.BytesIO(path.read_bytes())
    with h5py.File(content, "r+") as file:
        for name, of in names.items():
            del file[name]
            file[name] = of.view(np.uint8)
        for name in bare:
            del file[name]
    mesh = meshio.med.read(content)
    for tags in (mesh.cell_tags, mesh.point_tags):
        # Each of their letters stands for a byte.
        tags |= {family: [decoded(name.encode("latin-1")) for name in of] for family, of in tags.items()}
    return mesh


def _read_nastran(path: Path) -> Any:
    """Read a file of Nastran, which meshio takes with the line BEGIN BULK only, which gmsh does not write."""
    import meshio  # heavy, and needed here only

    lines = list(_lines(path))
    for line in lines:
        if line.upper().startswith(("GRID", "GRDSET")):
            at = slice(24, 40) if line[:8].rstrip().endswith("*") else slice(16, 24)
            system = (line.split(",")[2:3] or [""])[0] if "," in line else line[at]
            if system.strip(" 0"):
                raise ConfigurationError(
                    f"{path}: expected nodes in the basic coordinate system, got {echo(line[:40].rstrip())} in the "
                    f"system {system.strip()}; save the mesh with all nodes in the basic one, or as .msh of gmsh"
                )
    text = "\n".join(lines)
    if not re.search(r"^BEGIN BULK", text, re.MULTILINE):
        text = f"BEGIN BULK\n{re.sub('^BEGIN +BULK.*', '', text, flags=re.MULTILINE | re.IGNORECASE)}"
    return meshio.read(io.StringIO(f"{text}\nENDDATA\n"), file_format="nastran")


def _read_su2(path: Path) -> Any:
    """Read a file of SU2, in which meshio does not compare the counts with what is there."""
    import meshio  # heavy, and needed here only

    stated, found = Counter[str](), Counter[str]()
    of = marker = ""
    for line in _lines(path):
        key, equals, value = map(str.strip, line.partition("="))
        if equals:
            if key == "MARKER_TAG":
                found["NMARK"] += 1
                marker = value
            of = f"{key} of '{marker}'" if key == "MARKER_ELEMS" else key
            if of.startswith(("NELEM", "NPOIN", "NMARK", "MARKER_ELEMS")):
                stated[of] += int(value.split()[0])
        elif key and not key.startswith("%"):
            found[of] += 1
    for of, count in stated.items():
        if found[of] != count:
            raise ConfigurationError(
                f"{path}: expected {count:,} entries by {of}, got {found[of]:,}, so the file is cut short or damaged; "
                f"{SAVE}"
            )
    return meshio.read(path)


#: Readers of formats of which meshio takes a part only.
_READERS = {".med": _read_med, ".su2": _read_su2, **dict.fromkeys((".bdf", ".fem", ".nas"), _read_nastran)}


def _of_meshio(mesh: Any, path: Path, numbering: str | None) -> Parts:
    """Return the parts of a mesh of meshio: its sets, families and numbers are groups."""
    parts, markers = Parts(path), _su2_names(path) if path.suffix.lower() == ".su2" else {}
    families = getattr(mesh, "cell_tags", None) or {}
    for name, nodes in mesh.point_sets.items():
        parts.gather(name, np.asarray(nodes, dtype=np.int64))
    for family, names in (getattr(mesh, "point_tags", None) or {}).items():
        for name in names:
            parts.gather(name.strip(), np.flatnonzero(mesh.point_data["point_tags"] == family))
    chosen = {dim: _numbering(mesh, dim) for dim in (2, 3)}
    for i, block in enumerate(mesh.cells):
        nodes = np.asarray(block.data)
        if block.dim not in (2, 3) or not nodes.size:
            continue
        if nodes.ndim != 2 or not np.issubdtype(nodes.dtype, np.integer):
            raise ConfigurationError(
                f"{path}: expected {block.type} elements as rows of nodes, got an array of shape {nodes.shape}"
            )
        dim = block.dim
        rows = parts.add(dim, block.type, nodes.astype(np.int64))
        if dim == 3:
            for name, values in mesh.cell_data.items():
                parts.set_data(name, block.type, rows, _without_columns(values[i]))
        if numbering is not None and dim == 3:
            continue
        for name, sets in mesh.cell_sets.items():
            if i < len(sets) and sets[i] is not None and len(sets[i]):
                parts.join(dim, block.type, rows[np.asarray(sets[i], dtype=np.int64)], name)
        if chosen[dim] is None:
            continue
        numbers = np.rint(np.asarray(mesh.cell_data[chosen[dim]][i], float)).reshape(-1).astype(np.int64)
        if families and chosen[dim] == "cell_tags":
            for family in np.unique(numbers).tolist():
                for name in families.get(family, ()):
                    parts.join(dim, block.type, rows[numbers == family], name.strip())
            continue
        # A file of Salome has data of another kind there.
        pairs = {name: of for name, of in mesh.field_data.items() if np.shape(of) == (2,)}
        names = {int(tag): name for name, (tag, of) in pairs.items() if int(of) == dim}
        if dim == 2 and markers:
            # Their numbers are meshio's.
            for value in np.unique(numbers).tolist():
                parts.join(dim, block.type, rows[numbers == value], markers.get(value, str(value)))
            continue
        parts.number(dim, block.type, rows, numbers, names)
    return parts


def _without_columns(values: Any) -> Array:
    """Return data as numbers, a single column as (k,)."""
    values = np.asarray(values, dtype=float)
    return np.asarray(values.reshape(-1) if values.shape[1:] == (1,) else values)


def _numbering(mesh: Any, dim: int) -> str | None:
    """Return the name of the data that number the groups of a dimension; None without any."""
    candidates = (_OF_FACES, *_NUMBERINGS) if dim == 2 else (*_NUMBERINGS, _OF_FACES)
    letters = Counter(name.casefold() for name in mesh.cell_data)
    alike: dict[str, str] = {
        name.casefold(): name for name in mesh.cell_data if letters[name.casefold()] == 1
    }
    for name in (*candidates, *(alike.get(name.casefold(), name) for name in candidates)):
        if name in mesh.cell_data and all(
            whole(values)
            for block, values in zip(mesh.cells, mesh.cell_data[name], strict=True)
            if block.dim == dim
        ):
            return name
    return None


def _lines(path: Path) -> Iterable[str]:
    return decoded(path.read_bytes()).splitlines()


def _su2_names(path: Path) -> dict[int, str]:
    """Return the names of markers by the numbers that meshio gives them.

    Raises
    ------
    ConfigurationError
        Two markers get one number.
    """
    found: dict[int, str] = {}
    last = 0
    for line in _lines(path):
        key, _, name = line.partition("=")
        if key.strip() == "MARKER_TAG":
            name = name.strip()
            last = int(name) if re.fullmatch(r"\d{1,9}", name) else last + 1
            if found.setdefault(last, name) != name:
                raise ConfigurationError(
                    f"{path}: the markers '{found[last]}' and '{name}' cannot be told apart; give all of them names "
                    "that are no numbers"
                )
    return found
