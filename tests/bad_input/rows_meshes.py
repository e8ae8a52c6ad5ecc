"""Meshes and geometries that cannot be used, as a body and as a cell."""

from __future__ import annotations

import itertools
import struct

import numpy as np

from tests.bad_input.bad_files import fifo, folder, holes, link
from tests.bad_input.bad_row import Content, Row, faulty

#: Tetrahedra and triangles of gmsh's format 2.2, with their numbers of nodes.
TETRAHEDRON, TRIANGLE, PYRAMID, HEXAHEDRON, LINE = 4, 2, 7, 5, 1


class Mesh:
    """A cube of 2 × 2 × 2 small ones, each of six tetrahedra; the surfaces y- and y+ have the tags 1 and 2.

    Of the tetrahedra those of the last small cube have the tag 4, all others 3. To be altered, then written as text.
    """

    def __init__(self) -> None:
        n = 2
        grid = np.array(list(itertools.product(range(n + 1), repeat=3)))
        self.points = (grid / n).tolist()
        number = {tuple(at): i for i, at in enumerate(grid.tolist())}
        self.elements: list[tuple[int, int, list[int]]] = []
        for at in itertools.product(range(n), repeat=3):
            for order in itertools.permutations(range(3)):
                path = [np.array(at)]
                for axis in order:
                    path.append(path[-1] + np.eye(3, dtype=int)[axis])
                nodes = [number[tuple(p.tolist())] for p in path]
                edges = np.array([path[i] - path[0] for i in (1, 2, 3)])
                if np.linalg.det(edges) < 0:
                    nodes[2], nodes[3] = nodes[3], nodes[2]
                self.elements.append((TETRAHEDRON, 4 if at == (n - 1,) * 3 else 3, nodes))
        for tag, y in ((1, 0), (2, n)):
            for a, b in itertools.product(range(n), repeat=2):
                corners = [number[a + i, y, b + j] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
                self.elements += [
                    (TRIANGLE, tag, [corners[k] for k in pick]) for pick in ((0, 1, 2), (0, 2, 3))
                ]

    @property
    def tetrahedra(self) -> list[list[int]]:
        return [nodes for kind, _, nodes in self.elements if kind == TETRAHEDRON]

    def text(self) -> str:
        lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(self.points))]
        lines += [f"{i + 1} {' '.join(map(str, p))}" for i, p in enumerate(self.points)]
        lines += ["$EndNodes", "$Elements", str(len(self.elements))]
        lines += [
            f"{i + 1} {kind} 2 {tag} {tag} {' '.join(str(n + 1) for n in nodes)}"
            for i, (kind, tag, nodes) in enumerate(self.elements)
        ]
        return "\n".join([*lines, "$EndElements", ""])


def altered(alter) -> str:
    mesh = Mesh()
    alter(mesh)
    return mesh.text()


def node(value):
    def alter(mesh):
        mesh.points[13] = value

    return alter


def index(value):
    def alter(mesh):
        mesh.tetrahedra[0][0] = value

    return alter


def flat(mesh):
    mesh.tetrahedra[0][1] = mesh.tetrahedra[0][0]


def twice(mesh):
    mesh.elements += [(TETRAHEDRON, 3, nodes[::-1]) for nodes in mesh.tetrahedra[:2]]


def again(mesh):
    mesh.elements.append((TETRAHEDRON, 0, list(mesh.tetrahedra[0])))


def torn(mesh):
    """The second half has nodes of its own, at the same places."""
    count = len(mesh.points)
    mesh.points += [list(p) for p in mesh.points]
    for nodes in mesh.tetrahedra[24:]:
        nodes[:] = [n + count for n in nodes]


def shrunk(mesh):
    mesh.points = [[x, y, 0.0] for x, y, _ in mesh.points]


def pyramids(mesh):
    mesh.elements.append((PYRAMID, 3, [0, 3, 12, 9, 13]))


def hexahedra(mesh):
    mesh.elements.append((HEXAHEDRON, 3, [0, 9, 12, 3, 1, 10, 13, 4]))


def surface_only(mesh):
    mesh.elements = [e for e in mesh.elements if e[0] == TRIANGLE]


def lines_only(mesh):
    mesh.elements = [(LINE, 1, [0, 1])]


def folded_hexahedron(mesh):
    mesh.elements = [
        (HEXAHEDRON, 3, [0, 9, 3, 12, 1, 10, 4, 13]),
        (3, 1, [0, 9, 10, 1]),
        (3, 2, [3, 12, 13, 4]),
    ]


WHOLE = Mesh().text()
STL = (
    "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    "endsolid a\n"
)
BINARY_STL = b"\0" * 80 + struct.pack("<I", 2**31 - 1) + b"\0" * 50
VTU = """<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid>
<Piece NumberOfPoints="{points}" NumberOfCells="{cells}"><Points><DataArray type="Float64" NumberOfComponents="3"
 format="ascii">{values}</DataArray></Points><Cells><DataArray type="Int64" Name="connectivity" format="ascii">{nodes}
</DataArray><DataArray type="Int64" Name="offsets" format="ascii">4</DataArray><DataArray type="UInt8" Name="types"
 format="ascii">10</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>"""
LAUGHS = (
    '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY a0 "ha">'
    + "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 12))
    + ']><VTKFile type="UnstructuredGrid">&a11;</VTKFile>'
)
UNREADABLE, BY_GMSH = (
    "got a file that is damaged, cut short or of another kind; save the mesh anew",
    "it is damaged or cut short",
)
NO_SUFFIX = "expected a mesh as .msh, .vtu, .med or another that meshio reads, got"
NO_NODES = "got a file without nodes, which is damaged, cut short or of another kind"
#: What is wrong in a mesh's own terms: suffix, content, words of the message as a body, and as a cell.
FAULTS: dict[str, tuple[str, Content, str, str]] = {
    "empty": (".msh", "", "the file is empty", "the file is empty"),
    "with a byte order mark": (".msh", "\ufeff" + WHOLE, "got a byte order mark", "got a byte order mark"),
    "with a blank line before it": (".msh", "\n" + WHOLE, "begins with $MeshFormat", "begins with $MeshFormat"),
    "of gmsh's first format": (".msh", "$NOD\n0\n$ENDNOD\n", "got '$NOD", "got '$NOD"),
    "a script of gmsh": (".msh", 'SystemCall "touch hacked";\n', UNREADABLE, UNREADABLE),
    "tetrahedra given twice": (
        ".msh", altered(twice), "2 tetra elements are there more than once", "with the same nodes, in '3'",
    ),
    "a tetrahedron given twice, once in no group": (".msh", altered(again), "in no group", "in no group"),
    "binary junk": (".msh", bytes(range(256)) * 40, UNREADABLE, UNREADABLE),
    "words": (".msh", "Dear diary,\n", UNREADABLE, UNREADABLE),
    "no known suffix": (".xyzzy", WHOLE, f"{NO_SUFFIX} '.xyzzy'", "a mesh of gmsh by its first bytes; rename it"),
    "no suffix": ("", WHOLE, f"{NO_SUFFIX} a file without a suffix", "rename it to mesh.msh"),
    "cut short": (".msh", WHOLE[: len(WHOLE) // 2], BY_GMSH, BY_GMSH),
    "of zeros": (".msh", b"\0" * 5000, "got a file of zeros alone", "got a file of zeros alone"),
    "JSON": (".vtu", "{}", "got text by its first bytes; save", "got text by its first bytes; save"),
    "VTK cut short": (".vtu", VTU[:400], "is cut short, before its last tag", "is cut short, before its last tag"),
    "STL of its first line": (".stl", "solid a\n", NO_NODES, NO_NODES),
    "STL of another program": (".stl", "Dear diary,\n", UNREADABLE, UNREADABLE),
    "Abaqus with cohesive elements": (
        ".inp", "*NODE\n1, 0, 0, 0\n*ELEMENT, type=COH3D8\n1, 1, 1, 1, 1, 1, 1, 1, 1\n", "got COH3D8; leave",
        "got COH3D8",
    ),
    "a picture": (".vtu", b"\x89PNG\r\n\x1a\n", "got a PNG picture by its first", "got a PNG picture by its first"),
    "gmsh's own renamed": (".vtu", WHOLE, "rename it to mesh.msh", "rename it to mesh.msh"),
    "an archive": (".msh", b"PK\x03\x04" + b"\0" * 90, "got a ZIP archive", "unpack it first"),
    "a web page": (".vtu", "<!DOCTYPE html><html></html>", "got a web page", "fetch the file itself again"),
    "XML entities that grow": (".vtu", LAUGHS, UNREADABLE, UNREADABLE),
    "VTK of 10^12 points": (
        ".vtu", VTU.format(points=10**12, cells=1, values="0 0 0", nodes="0 1 2 3"), UNREADABLE, UNREADABLE,
    ),
    "VTK with a node beyond the last": (
        ".vtu", VTU.format(points=4, cells=1, values="0 0 0 1 0 0 0 1 0 0 0 1", nodes="0 1 2 99"), "node 99", "node 99",
    ),
    "10^15 nodes": (".msh", WHOLE.replace("$Nodes\n27", f"$Nodes\n{10**15}"), BY_GMSH, BY_GMSH),
    "10^15 elements": (
        ".msh", WHOLE.replace("$Elements\n64", f"$Elements\n{10**15}"), "no nodes are in", "no nodes are in",
    ),
    "STL": (".stl", STL, "mesh.stl has none", "a cell needs the solid and the pores meshed, each a"),
    "binary STL that declares 2^31 facets": (".stl", BINARY_STL, NO_NODES, NO_NODES),
    "an infinite node": (".msh", altered(node([float("inf"), 0, 0])), "not finite", "not finite"),
    "a node that is no number": (".msh", altered(node([float("nan"), 0, 0])), "not finite", "not finite"),
    "a node at 1e300": (".msh", altered(node([1e300, 0, 0])), "1e+300", "1e+300"),
    "an index beyond the last node": (".msh", altered(index(10**6)), BY_GMSH, BY_GMSH),
    "an index of 10^18": (".msh", altered(index(10**18)), BY_GMSH, BY_GMSH),
    "a tetrahedron without volume": (".msh", altered(flat), "turned inside out or flat", "inside of the cell"),
    "nodes that are there twice": (".msh", altered(torn), "same place", "same place"),
    "a flat mesh": (".msh", altered(shrunk), "same place", "which is flat"),
    "pyramids too": (".msh", altered(pyramids), "expected volume elements of one kind", "expected tetrahedra"),
    "hexahedra too": (".msh", altered(hexahedra), "expected volume elements of one kind", "expected tetrahedra"),
    "a surface only": (".msh", altered(surface_only), "has none: mesh the volume in three", "'gmsh -3' meshes it"),
    "lines only": (".msh", altered(lines_only), "expected volume elements", "no elements with a volume"),
    "a hexahedron folded over itself": (
        ".msh", altered(folded_hexahedron), "turned inside out or flat", "expected tetrahedra",
    ),
    "volumes that were not meshed": (
        ".msh",
        '$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n3 1 "solid"\n$EndPhysicalNames\n$Nodes\n0\n'
        "$EndNodes\n$Elements\n0\n$EndElements\n",
        "mesh its volumes 'solid' too, by 'gmsh -3', or, where it is damaged", "by 'gmsh -3', or, where it is damaged",
    ),
    "missing": (".msh", lambda path: None, "no such file", "no such file"),
    "a folder": (".msh", folder, "expected a file, got a folder", "expected a file, got a folder"),
    "a named pipe": (".msh", fifo, "got a named pipe", "got a named pipe"),
    "an endless device": (".msh", link("/dev/zero"), "got a device", "got a device"),
    "a dangling link": (".msh", link("nowhere"), "a symbolic link to nowhere,", "a symbolic link to nowhere,"),
    "a loop of links": (".msh", link("mesh.msh"), "a symbolic link that leads back", "a symbolic link that leads back"),
    "of a terabyte": (".msh", holes(1 << 40), "at most", "at most"),
}  # fmt: skip
#: With names of its groups.
NAMED = WHOLE.replace(
    "$Nodes",
    '$PhysicalNames\n4\n2 1 "bottom"\n2 2 "top"\n3 3 "matrix"\n3 4 "void"\n$EndPhysicalNames\n$Nodes',
    1,
)
#: The names of two surfaces and of two volumes are the numbers of the other.
CROSSED = (
    NAMED.replace('"bottom"', '"2"')
    .replace('"top"', '"1"')
    .replace('"matrix"', '"4"')
    .replace('"void"', '"3"')
)
#: The name of one volume is the number of the other.
HALF_CROSSED = NAMED.replace('"void"', '"3"')
VTU_OF_DATA = VTU.format(points=4, cells=1, values="0 0 0 1 0 0 0 1 0 0 0 1", nodes="0 1 2 3").replace(
    "</Piece>",
    '<CellData><DataArray type="Int64" Name="mat_id" format="ascii">7</DataArray></CellData></Piece>',
)
BODY = {"1": {"displacement": [0, 0, 0]}, "2": {"traction": [0, 1, 0], "pressure": 0}}


def as_body(kind: str) -> Row:
    suffix, content, expected, _ = FAULTS[kind]
    changes = {"macro.body": {"kind": "file", "path": f"mesh{suffix}"}, "macro.boundary": BODY}
    return faulty(f"body: {kind}", changes, expected, files={f"mesh{suffix}": content})


def as_cell(kind: str) -> Row:
    suffix, content, _, expected = FAULTS[kind]
    geometry = {"kind": "mesh-file", "path": f"mesh{suffix}", "solid": [3], "fluid": [4]}
    return faulty(f"cell: {kind}", {"cell.geometry": geometry}, expected, files={f"mesh{suffix}": content})


#: Geometries that gmsh meshes, of a body: suffix, content, size, words of the message.
GEOMETRIES: dict[str, tuple[str, Content, float, str]] = {
    "empty .geo": (".geo", "", 0.5, "expected a geometry as .geo, got an empty file"),
    "a mesh as .step": (".step", WHOLE, 0.5, "got a mesh of gmsh by its first bytes; save it as .step anew"),
    "a cut .step": (
        ".step",
        "ISO-10303-21;\nHEADER;\n",
        0.5,
        "damaged, cut short or of another kind; save it",
    ),
    "junk .step": (".step", bytes(range(256)), 0.5, "could not mesh"),
    "empty .step": (".step", "", 0.5, "expected a geometry as .step, got an empty file"),
    "junk .brep": (
        ".brep",
        "DBRep_DrawableShape\n\nCASCADE Topology V1, (c)",
        0.5,
        "expected a geometry with a volume",
    ),
    "a .geo with a fault": (".geo", "Point(1) = {0, 0,;\n", 0.5, "could not mesh"),
    "too fine": (".geo", 'SetFactory("OpenCASCADE"); Box(1) = {0,0,0, 1,1,1};', 1e-3, "about"),
    "that calls the system": (".geo", 'SystemCall "touch hacked";\n', 0.5, "SystemCall"),
    "that takes in another file": (
        ".geo",
        'Merge "box.step";\n',
        0.5,
        "holds the command Merge; a geometry that is read may not execute a program, take in other files, which sha256 "
        "does not cover, or write files",
    ),
    "that saves": (".geo", 'Mesh 3; Save "study.yaml";\n', 0.5, "holds the command Save"),
    "that prints into a file": (".geo", 'Printf("a; b") /* */ >> f;\n', 0.5, "holds the command Printf"),
    "that makes a folder": (".geo", 'CreateDir "a";\n', 0.5, "holds the command CreateDir"),
    "that prints": (".geo", 'Print "a.png";\n', 0.5, "holds the command Print"),
    "that runs a program for its sizes": (".geo", "Field[1] = ExternalProcess;\n", 0.5, "ExternalProcess"),
}


def as_geometry(kind: str) -> Row:
    suffix, content, size, expected = GEOMETRIES[kind]
    changes = {
        "macro.body": {"kind": "file", "path": f"part{suffix}", "size": size},
        "macro.boundary": BODY,
    }
    return faulty(f"geometry: {kind}", changes, expected, files={f"part{suffix}": content})


#: Cells that would take more elements than memory holds: changes, words of the message.
TOO_FINE: dict[str, tuple[dict[str, object], str]] = {
    "size 0.01": ({"cell.mesh.size": 0.01}, "tetrahedra"),
    "fluid_size 0.01": ({"cell.mesh.fluid_size": 0.01}, "tetrahedra"),
    "a radius of 1e-6": ({"cell.geometry.radius": 1e-6}, "tetrahedra"),
    "a fillet of 1e-7": ({"cell.geometry.fillet": 1e-7}, "a radius from 0.005"),
    "spheres of radius 1e-5": (
        {"cell.geometry": {"kind": "sphere-pores", "centres": [[0, 0, 0]], "radius": 1e-5}}, "tetrahedra",
    ),
    "a throat of radius 1e-7": (
        {"cell.geometry": {"kind": "sphere-pores", "lattice": "bcc", "radius": 0.3, "throat": 1e-7}}, "tetrahedra",
    ),
    "size 0.01 of a gyroid": (
        {"cell.geometry": {"kind": "tpms", "surface": "gyroid", "void_fraction": 0.5}, "cell.mesh.size": 0.01},
        "tetrahedra",
    ),
    "a large block of fine cells": ({"cell.mesh.size": 0.05, "cell.supercell": [8, 8, 8]}, "tetrahedra"),
}  # fmt: skip


def throat(**given: object) -> dict[str, object]:
    pores = {"kind": "sphere-pores", "centres": [[0, 0, 0], [0.5, 0.5, 0.5]], "radius": 0.2}
    return {"cell.geometry": {**pores, "throats": [{"join": [0, 1], "radius": 0.1, **given}]}}


ROWS = [
    *map(as_body, FAULTS),
    *map(as_cell, FAULTS),
    *map(as_geometry, GEOMETRIES),
    faulty(
        "cell: tags of other letters",
        {"cell.geometry": {"kind": "mesh-file", "path": "m.msh", "solid": ["Matrix", 77], "fluid": ["VOID"]}},
        "no tetrahedron of",
        "has the tag 'Matrix' (did you mean 'matrix'?) and 77 under solid and",
        ": write 'solid: [",
        "'VOID' (did you mean 'void'?) under fluid",
        files={"m.msh": NAMED},
    ),
    faulty(
        "cell: groups of other names, by their meaning",
        {"cell.geometry": {"kind": "mesh-file", "path": "m.msh"}},
        "has the tag 'solid' under solid and 'fluid' under fluid; its tags are",
        "3 ('Matrix') with 87.5 % of the volume, at 6 of the 6 faces",
        ": write 'solid: [Matrix]' and 'fluid: [Void]' under cell.geometry",
        files={"m.msh": NAMED.replace('"matrix"', '"Matrix"').replace('"void"', '"Void"')},
    ),
    faulty(
        "cell: a name with a comma",
        {"cell.geometry": {"kind": "mesh-file", "path": "m.msh", "fluid": ["void"]}},
        """: write 'solid: ["matrix, firm"]' under cell.geometry""",
        files={"m.msh": NAMED.replace('"matrix"', '"matrix, firm"')},
    ),
    faulty(
        "cell: groups without names",
        {"cell.geometry": {"kind": "mesh-file", "path": "m.msh"}},
        "3 with 87.5 % of the volume, at 6 of the 6 faces, 4 with 12.5 % of the volume, at 3 of the 6 faces: write "
        "'solid: [3]' and 'fluid: [4]' under cell.geometry, or the other way round: no name tells which is which; "
        "the share of the fluid is the porosity",
        files={"m.msh": WHOLE},
    ),
    faulty(
        "cell: a mesh of the solid alone",
        {"cell.geometry": {"kind": "mesh-file", "path": "m.msh", "solid": [3], "fluid": [4]}},
        "there is one volume only, and a cell needs two: mesh the pores, too",
        files={"m.msh": WHOLE.replace(" 2 4 4 ", " 2 3 3 ")},
    ),
    faulty(
        "cell: names that are numbers of other groups",
        {"cell.geometry": {"kind": "mesh-file", "path": "m.msh", "solid": [3], "fluid": [4]}},
        "cell.geometry.solid: in m.msh '3' is both the name of one group (number 4, 6 elements) and the number of "
        "another (named '4', 42 elements); give both in the mesher names that are no numbers",
        files={"m.msh": CROSSED},
    ),
    faulty(
        "cell: a name that is the number of a group with a name",
        {"cell.geometry": {"kind": "mesh-file", "path": "m.msh", "solid": ["matrix"], "fluid": ["3"]}},
        "cell.geometry.fluid: in m.msh '3' is both the name of one group (number 4, 6 elements) and the number of "
        "another (named 'matrix', 42 elements); give the first in the mesher a name that is no number, and write "
        "'matrix' for the second",
        files={"m.msh": HALF_CROSSED},
    ),
    faulty(
        "cell: a name that is the number of a group without one",
        {"cell.geometry": {"kind": "mesh-file", "path": "m.msh", "solid": [3], "fluid": [4]}},
        "'3' is both the name of one group (number 4, 6 elements) and the number of another (without a name, 42",
        files={"m.msh": HALF_CROSSED.replace('\n4\n2 1 "bot', '\n3\n2 1 "bot').replace('3 3 "matrix"\n', "")},
    ),
    faulty(
        "cell: one group by its number and its name",
        {"cell.geometry": {"kind": "mesh-file", "path": "m.msh", "solid": ["matrix"], "fluid": [3, 4]}},
        "cell.geometry.fluid: 42 of the 42 tetrahedra of",
        "m.msh with the tag 3 ('matrix') have the tag 'matrix' of solid too",
        files={"m.msh": NAMED},
    ),
    faulty(
        "cell: data of an unknown name",
        {"cell.geometry": {"kind": "mesh-file", "path": "m.vtu", "solid": [7], "fluid": [8]}},
        "none of gmsh:physical, medit:ref, phase",
        "it has mat_id",
        files={"m.vtu": VTU_OF_DATA},
    ),
    faulty(
        "body: surfaces whose names are numbers of others",
        {"macro.body": {"kind": "file", "path": "m.msh"}, "macro.boundary": BODY},
        "macro.boundary.1: in m.msh '1' is both the name of one group (number 2, 8 faces) and the number of another "
        "(named '2', 8 faces); give both in the mesher names",
        "also wrong: '2'",
        files={"m.msh": CROSSED},
    ),
    *(
        faulty(
            f"region: a volume {what}",
            {
                "macro.body": {"kind": "file", "path": "m.msh"},
                "macro.boundary": {"bottom": BODY["1"], "top": BODY["2"]},
                "macro.regions": {"lower": {"kind": "volume", "name": "3", "fields": {"radius": 0.2}}},
                "cell.geometry.radius": {"range": [0.2, 0.25]},
                "closure": "potential",
            },
            f"macro.regions.lower.name: {told}",
            files={"m.msh": content},
        )
        for what, content, told in (
            (
                "whose name is the number of another",
                HALF_CROSSED,
                "in m.msh '3' is both the name of one group",
            ),
        )
    ),
    faulty(
        "body: a mesh without faces",
        {"macro.body": {"kind": "file", "path": "m.vtu"}, "macro.boundary": BODY},
        "it has elements with a volume alone and no faces, which must be saved too",
        files={"m.vtu": VTU_OF_DATA},
    ),
    faulty(
        "body: data of an unknown name",
        {"macro.body": {"kind": "file", "path": "m.vtu"}, "macro.boundary": BODY},
        "its elements have the data 'mat_id'; give physical groups",
        "where data of elements called gmsh:physical, medit:ref, phase, region, cell_tags, material",
        files={
            "m.vtu": VTU_OF_DATA.replace('NumberOfCells="1"', 'NumberOfCells="2"')
            .replace("0 1 2 3\n", "0 1 2 3 0 1 2\n")
            .replace(">4<", ">4 7<")
            .replace(">10<", ">10 5<")
            .replace(">7<", ">7 8<")
        },
    ),
    faulty(
        "body: surfaces of other letters",
        {
            "macro.body": {"kind": "file", "path": "m.msh"},
            "macro.boundary": {
                "Bottom": {"displacement": [0, 0, 0]},
                "TOP": {"pressure": 0},
                "east": {"pressure": 0},
            },
        },
        "macro.boundary.Bottom: the body has no surface 'Bottom'; did you mean 'bottom'? its surfaces are",
        "also wrong: 'TOP' (did you mean 'top'?) and 'east'",
        files={"m.msh": NAMED},
    ),
    *(faulty(f"too fine: {name}", changes, words) for name, (changes, words) in TOO_FINE.items()),
    *(
        faulty(f"throat that joins cells {shift} apart", throat(shift=shift), "throats")
        for shift in ([1000, 0, 0], [0, -(10**6), 0], [10**30, 0, 0], [20, 20, 20])
    ),
    faulty(
        "throat between centres a million apart",
        {
            **throat(shift=[1, 0, 0]),
            "cell.geometry.centres": [[0, 0, 0], [1e6, 0, 0]],
        },
        "throats",
    ),
    faulty(
        "3,000 throats",
        {**throat(), "cell.geometry.throats": [{"join": [0, 1], "radius": 0.1}] * 3_000},
        "throats",
    ),
]
