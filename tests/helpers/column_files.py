"""Writers of the column's files: by gmsh and meshio, and by hand for Abaqus, Exodus, Nastran and gmsh's format 2.2."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.files.gmsh_model import gmsh_session
from tests.helpers.column_meshes import GROUPS, KINDS, Column, column, to_gmsh, to_meshio


def by_gmsh(
    kind: str,
    *,
    turned: bool = False,
    names: Mapping[str, int] | None = None,
    partitions: int = 0,
    **options: float,
) -> Any:
    """Return the writer of a file of gmsh; 'Mesh_Binary=1' is its option Mesh.Binary."""

    def write(path: Path) -> None:
        with gmsh_session() as gmsh:
            to_gmsh(gmsh, column(kind), None if names is None else dict(names), turned)
            if partitions:
                gmsh.model.mesh.partition(partitions)
            for option, value in options.items():
                gmsh.option.setNumber(option.replace("_", "."), value)
            gmsh.write(str(path))

    return write


def by_meshio(kind: str, data: str = "material") -> Callable[[Path], None]:
    return lambda path: to_meshio(column(kind), data).write(path)


def text(content: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        path.write_text(content, encoding="utf-8")

    return write


def edited(write: Callable[[Path], None], *changes: tuple[str, str]) -> Callable[[Path], None]:
    """Return the writer of a file of text in which patterns are replaced."""

    def changed(path: Path) -> None:
        write(path)
        content = path.read_text(encoding="utf-8")
        for pattern, by in changes:
            content, count = re.subn(pattern, by, content)
            assert count == 1, pattern
        path.write_text(content, encoding="utf-8")

    return changed


def latin(content: str) -> Callable[[Path], None]:
    return lambda path: path.write_bytes(content.encode("latin-1")) and None


def with_first(write: Callable[[Path], None], name: str, value: int) -> Callable[[Path], None]:
    """Return the writer of an HDF5 file in which the first entry of an array is another."""

    def changed(path: Path) -> None:
        import h5py

        write(path)
        with h5py.File(path, "r+") as file:
            file[name][0] = value

    return changed


# --- Abaqus and CalculiX, by hand -----------------------------------------------------------------------------------

#: Numbers with gaps.
GAP = 10


def nodes_of(mesh: Column) -> str:
    return "*NODE, NSET=Nall\n" + "".join(
        f"{GAP * (i + 1)}, {x:.3f}, {y:.3f}, {z:.3f}\n" for i, (x, y, z) in enumerate(mesh.points)
    )


def elements_of(mesh: Column, type_: str, order: Any = None, turned: bool = False) -> str:
    lines = [f"*ELEMENT, TYPE={type_}, ELSET=Eall"]
    for e, nodes in enumerate(mesh.cells):
        own = nodes if order is None else nodes[order]
        if turned:
            own = own[[0, 3, 2, 1, 4, 7, 6, 5]] if len(own) == 8 else own[[0, 2, 1, 3]]
        words = [str(e + 101), *(str(GAP * (n + 1)) for n in own)]
        # Lines of Abaqus hold 16 numbers at most.
        lines += [
            ", ".join(words[i : i + 16]) + ("," if i + 16 < len(words) else "")
            for i in range(0, len(words), 16)
        ]
    return "\n".join(lines) + "\n"


def node_set(mesh: Column, name: str, axis: int, value: float, head: str = "*NSET, NSET=") -> str:
    own = np.flatnonzero(mesh.points[:, axis] == value)
    return f"{head}{name}\n" + ",\n".join(str(GAP * (i + 1)) for i in own) + "\n"


def abaqus(kind: str, type_: str, more: str = "", order: Any = None, turned: bool = False) -> str:
    mesh = column(kind)
    first, last = 101, 100 + len(mesh.cells)
    half = 100 + mesh.half
    return (
        "*HEADING\nA column\n** a comment\n"
        + nodes_of(mesh)
        + elements_of(mesh, type_, order, turned)
        + f"*ELSET, ELSET=lower, GENERATE\n{first}, {half}, 1\n*ELSET, ELSET=upper, GENERATE\n{half + 1}, {last}\n"
        + "*ELSET, ELSET=all\nlower, upper\n"
        + node_set(mesh, "bottom", 1, 0)
        + node_set(mesh, "top", 1, 2)
        + more
    )


#: The faces of a hexahedron of Abaqus by their numbers: S1 is z-, S2 z+, S3 y-, S4 x+, S5 y+, S6 x-.
FACES = (
    "*SURFACE, NAME=front, TYPE=ELEMENT\nlower, S2\nupper, S2\n"
    "*SURFACE, NAME=lid, TYPE=ELEMENT\n102, S5\n*SURFACE, NAME=foot\n101, S3\n"
    "*SURFACE, NAME=left\nall, S6\n*SURFACE, TYPE=NODE, NAME=crown\ntop,\n"
    "*SURFACE, NAME=mantle, TYPE=ELEMENT\nall, S1\nall, S2\nall, S4\nall, S6\n"
)
#: The face of a tetrahedron.
ONE = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 0, 1, 0\n4, 0, 0, 1\n*ELEMENT, TYPE=C3D4, ELSET=one\n1, 1, 2, 3, 4\n"


def cae(sets: str = "", instance: str = "", more: str = "") -> str:
    """A file as Abaqus CAE writes it: a part, and an assembly whose sets name the instance."""
    mesh = column("hexahedron")
    top = np.flatnonzero(mesh.points[:, 1] == 2)
    return (
        "*Heading\n*Preprint, echo=NO\n*Part, name=Part-1\n"
        + nodes_of(mesh).replace(", NSET=Nall", "")
        + elements_of(mesh, "C3D8R").replace(", ELSET=Eall", "")
        + '*Elset, elset="Set-1", generate\n101, 102, 1\n*Solid Section, elset=Set-1, material=m\n,\n'
        + "*End Part\n*Assembly, name=Assembly\n*Instance, name=Part-1-1, part=Part-1\n"
        + instance
        + "*End Instance\n*Node\n10, 0.5, 3., 0.5\n*Nset, nset=point\n10,\n*Nset, nset=Set-1, instance=Part-1-1\n"
        + ", ".join(str(GAP * (i + 1)) for i in top)
        + "\n*Elset, elset=_foot_S3, internal, instance=Part-1-1\n101\n"
        + "*Surface, type=ELEMENT, name=foot\n_foot_S3, S3\n"
        + "*Surface, type=NODE, name=crown\nPart-1-1.Set-1, 1.\n"
        + sets
        + "*End Assembly\n"
        + more
    )


# --- Exodus, by hand, after its manual ------------------------------------------------------------------------------

#: Places of the nodes: middles of vertical edges before those of the top; centre, bottom, top, x-, x+, y-, y+.
EXODUS = {
    "hexahedron20": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15],
    "hexahedron27": [*range(12), 16, 17, 18, 19, 12, 13, 14, 15, 26, 24, 25, 20, 21, 22, 23],
}
TYPES = {"tetra": "TETRA", "tetra10": "TETRA10", "hexahedron": "HEX8", "hexahedron20": "HEX20"}
TYPES |= {"hexahedron27": "HEX27", "wedge": "WEDGE6"}
#: Corners of the sides of hexahedra and tetrahedra from 1.
SIDES = {
    8: [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)],
    4: [(0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)],
    6: [(0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 2, 1), (3, 4, 5)],
}


def exodus(kind: str, *, netcdf4: bool = False, names: bool = True) -> Callable[[Path], None]:
    """Return the writer of a file with two blocks, three side sets, and a set of the nodes on top."""
    mesh = column(kind)
    corners = KINDS[kind][0]
    order = EXODUS.get(kind, list(range(mesh.cells.shape[1])))
    arrays: dict[str, Any] = {"coord" + a: mesh.points[:, i] for i, a in enumerate("xyz")}
    for i, rows in enumerate((mesh.cells[: mesh.half], mesh.cells[mesh.half :]), start=1):
        arrays[f"connect{i}"] = rows[:, order].astype(np.int32) + 1
    for i, name in enumerate(mesh.faces, start=1):
        elements, sides = [], []
        keys = {tuple(sorted(mesh.number(f))) for f in mesh.face_corners[name]}
        for e, nodes in enumerate(mesh.cells[:, :corners]):
            for s, side in enumerate(SIDES[corners], start=1):
                if tuple(sorted(nodes[list(side)])) in keys:
                    elements.append(e + 1)
                    sides.append(s)
        arrays[f"elem_ss{i}"] = np.array(elements, dtype=np.int32)
        arrays[f"side_ss{i}"] = np.array(sides, dtype=np.int32)
    arrays["node_ns1"] = np.flatnonzero(mesh.points[:, 1] == 2).astype(np.int32) + 1
    arrays |= {
        "eb_prop1": np.array([11, 12], dtype=np.int32),
        "ss_prop1": np.array([21, 22, 23], dtype=np.int32),
    }
    arrays["ns_prop1"] = np.array([5], dtype=np.int32)
    for what, own in (("eb", ["lower", "upper"]), ("ss", ["bottom", "top", "side"]), ("ns", ["crown"])):
        if names:
            padded = [name.ljust(33, "\0").encode() for name in own]
            arrays[f"{what}_names"] = np.array([[bytes([c]) for c in name] for name in padded], dtype="S1")

    def write(path: Path) -> None:
        if netcdf4:
            import h5py

            with h5py.File(path, "w") as file:
                for name, values in arrays.items():
                    file[name] = values
                    if name.startswith("connect"):
                        file[name].attrs["elem_type"] = np.bytes_(TYPES[kind])
            return
        from scipy.io import netcdf_file

        with netcdf_file(path, "w") as file:
            for name, values in arrays.items():
                dims = tuple(f"{name}_{k}" for k in range(values.ndim))
                for dim, length in zip(dims, values.shape, strict=True):
                    file.createDimension(dim, length)
                variable = file.createVariable(
                    name, values.dtype.char if values.dtype.char != "S" else "c", dims
                )
                variable[:] = values
                if name.startswith("connect"):
                    variable.elem_type = TYPES[kind]

    return write


# --- others by hand --------------------------------------------------------------------------------------------------


def salome(path: Path) -> None:
    """Write tetrahedra with a group in two families, and a group of the nodes on top."""
    import meshio

    mesh = column("tetra")
    triangles = np.concatenate([own["triangle"] for own in mesh.faces.values()])
    families = np.repeat([-3, -4, -5], [len(own["triangle"]) for own in mesh.faces.values()])
    tags = [np.repeat([-1, -2], mesh.half), families]
    nodes = np.where(mesh.points[:, 1] == 2, 1, 0)
    found = meshio.Mesh(
        mesh.points,
        [("tetra", mesh.cells), ("triangle", triangles)],
        cell_data={"cell_tags": tags},
        point_data={"point_tags": nodes},
    )
    found.cell_tags = {-1: ["lower", "all"], -2: ["all", "upper"], -3: ["bottom"], -4: ["top"], -5: ["side"]}
    found.point_tags = {1: ["crown"]}
    found.write(path)


def large_fields(text: str) -> str:
    """Return a file of Nastran whose nodes stand in fields of 16 characters."""
    lines = []
    for line in text.splitlines():
        if line.startswith("GRID,"):
            _, number, _, x, y, z = line.split(",")
            lines += [f"GRID*   {number:>16}{'':16}{x:>16}{y:>16}*", f"*       {z:>16}"]
        else:
            lines.append(line)
    return "\n".join(lines)


def nastran(kind: str) -> str:
    mesh = column(kind)
    lines = ["SOL 101", "CEND", "BEGIN BULK"]
    lines += [f"GRID,{i + 1},,{x:.2f},{y:.2f},{z:.2f}" for i, (x, y, z) in enumerate(mesh.points)]
    card = {"tetra": "CTETRA", "hexahedron": "CHEXA"}[kind]
    number = 0
    for e, nodes in enumerate(mesh.cells):
        number += 1
        words = [card, number, 11 if e < mesh.half else 12, *(nodes + 1)]
        lines.append(",".join(map(str, words[:9])))
        if len(words) > 9:
            lines.append(",".join(["+", *map(str, words[9:])]))
    for name, of in mesh.faces.items():
        for rows in of.values():
            for nodes in rows:
                number += 1
                lines.append(
                    ",".join(
                        map(
                            str,
                            ["CTRIA3" if len(nodes) == 3 else "CQUAD4", number, GROUPS[name], *(nodes + 1)],
                        )
                    )
                )
    return "\n".join([*lines, "ENDDATA", ""])


def gmsh_text(elements: str, names: str = "", more: str = "") -> str:
    """Two tetrahedra on one triangle, in lines of gmsh's format 2.2; their volumes are 1/6 each."""
    lines = elements.strip().splitlines()
    return (
        f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n{names}$Nodes\n{5 + more.count(chr(10))}\n1 0 0 0\n2 1 0 0\n3 0 1 0\n"
        f"4 0 0 -1\n5 0 0 1\n{more}$EndNodes\n$Elements\n{len(lines)}\n"
        + "\n".join(lines)
        + "\n$EndElements\n"
    )
