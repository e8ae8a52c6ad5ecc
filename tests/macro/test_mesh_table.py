"""Files of meshes of many programs: each is read right, or refused in one message."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore.cell.meshing.mesh_file import MeshFile
from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh, Facets
from porocore.macro.body.mesh_file import read_body
from porocore.macro.problem import MacroProblem
from porocore.plugins.registry import registry
from porocore.testing.synthetic.response import linear_law
from tests.helpers.column_files import (
    FACES,
    ONE,
    TYPES,
    abaqus,
    by_gmsh,
    by_meshio,
    cae,
    edited,
    exodus,
    gmsh_text,
    large_fields,
    latin,
    nastran,
    salome,
    text,
    with_first,
)
from tests.helpers.column_meshes import column, to_meshio

VOLUMES = {"lower": 1.0, "upper": 1.0, "all": 2.0}
AREAS = {"bottom": 1.0, "top": 1.0, "side": 8.0, "skin": 10.0}
BY_NUMBER = {"11": 1.0, "12": 1.0}, {"21": 1.0, "22": 1.0, "23": 8.0}


@dataclass(frozen=True)
class Row:
    """A file, and the volumes and areas that it gives, or the words of its refusal."""

    name: str
    write: Callable[[Path], None]
    suffix: str = ".inp"
    volumes: Mapping[str, float] = field(default_factory=lambda: VOLUMES)
    areas: Mapping[str, float] = field(default_factory=lambda: AREAS)
    refused: str = ""
    slow: bool = False


OF_SETS = {**VOLUMES, "Eall": 2.0}
ENDS = {"bottom": 1.0, "top": 1.0, "Nall": 10.0}
OF_FACES = {**ENDS, "front": 2.0, "lid": 1.0, "foot": 1.0, "left": 2.0, "crown": 1.0, "mantle": 8.0}
OF_EXODUS = {"lower": 1.0, "upper": 1.0}, {"bottom": 1.0, "top": 1.0, "side": 8.0, "crown": 1.0}
PAIR = "1 4 2 11 1 1 2 3 5\n2 4 2 12 1 1 3 2 4\n"
SIXTHS = {"11": 1 / 6, "12": 1 / 6}
#: A node with the number 0, which gmsh gives another, before or after that with the number 1.
ZERO = "1 4 2 11 1 0 1 3 5\n2 4 2 12 1 0 3 1 4\n3 2 2 5 1 0 1 4", "\n1 0 0 0\n2 1 0 0\n"
ZERO_4 = (
    "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4 0 3\n3 1 0 4\n0\n1\n2\n3\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n"
    "$EndNodes\n$Elements\n1 1 1 1\n3 1 4 1\n1 0 1 2 3\n$EndElements\n"
)
LID = ONE + "*SURFACE, NAME=lid\none, S1\n"
OF_ONE = {"one": 1 / 6}, {"lid": 0.5}
CONVERT = "mesh it with tetrahedra alone, or split all elements into tetrahedra"
WEDGES = "has wedge; " + CONVERT

ROWS = [
    # gmsh
    Row("gmsh 4.1", by_gmsh("tetra"), ".msh"),
    Row("gmsh 4.1 binary", by_gmsh("hexahedron", Mesh_Binary=1), ".msh"),
    Row("gmsh 4.1 with all elements", by_gmsh("tetra", Mesh_SaveAll=1), ".msh", slow=True),
    Row("gmsh 4.0", by_gmsh("tetra", Mesh_MshFileVersion=4.0), ".msh", slow=True),
    Row("gmsh 2.2", by_gmsh("tetra", Mesh_MshFileVersion=2.2), ".msh"),
    Row("gmsh 2.2 binary", by_gmsh("tetra", Mesh_MshFileVersion=2.2, Mesh_Binary=1), ".msh", slow=True),
    Row("gmsh, 10 nodes", by_gmsh("tetra10"), ".msh"),
    Row("gmsh, 20 nodes", by_gmsh("hexahedron20"), ".msh"),
    Row("gmsh, 27 nodes", by_gmsh("hexahedron27"), ".msh"),
    Row("gmsh, tetrahedra turned", by_gmsh("tetra10", turned=True), ".msh"),
    Row("gmsh, hexahedra turned", by_gmsh("hexahedron", turned=True), ".msh"),
    Row("gmsh, 20 nodes turned", by_gmsh("hexahedron20", turned=True), ".msh"),
    Row("gmsh, 27 nodes turned", by_gmsh("hexahedron27", turned=True), ".msh"),
    Row("gmsh, wedges", by_gmsh("wedge"), ".msh", refused=WEDGES),
    Row(
        "gmsh without groups",
        by_gmsh("tetra", names={}),
        ".msh",
        {"1": 1.0, "2": 1.0},
        {"1": 1.0, "2": 1.0, "3": 8.0},
    ),
    Row(
        "gmsh, groups without names",
        text(gmsh_text(PAIR + "3 2 2 5 1 1 2 4")),
        ".msh",
        SIXTHS,
        {"5": 0.5},
    ),
    Row(
        "gmsh, an element twice in its group",
        text(gmsh_text(PAIR + "3 4 2 11 1 1 2 3 5\n4 2 2 5 1 1 2 4")),
        ".msh",
        refused="1 tetra elements are there more than once, with the same nodes, in '11'",
    ),
    Row(
        "gmsh, an element in two groups",
        text(gmsh_text(PAIR + "3 4 2 13 1 1 2 3 5\n4 2 2 5 1 1 2 4")),
        ".msh",
        {**SIXTHS, "13": 1 / 6},
        {"5": 0.5},
    ),
    Row(
        "gmsh, nodes not merged",
        text(gmsh_text(PAIR + "3 4 2 13 1 6 2 3 5\n4 2 2 5 1 1 2 4", more="6 0 0 0\n")),
        ".msh",
        refused="1 nodes lie at the same place as others",
    ),
    Row(
        "gmsh, tetrahedra and pyramid",
        text(gmsh_text(PAIR + "3 7 2 13 1 1 2 3 4 6", more="6 3 3 3\n")),
        ".msh",
        refused="has tetra and pyramid; " + CONVERT,
    ),
    Row(
        "gmsh, of both orders",
        text(gmsh_text(PAIR + "3 11 2 13 1 1 2 3 4 1 2 3 4 1 2")),
        ".msh",
        refused="has tetra and tetra10; save all elements with the same order",
    ),
    *(
        Row(
            f"gmsh {version}, in two partitions",
            by_gmsh("tetra", partitions=2, Mesh_MshFileVersion=version),
            ".msh",
        )
        for version in (2.2, 4.1)
    ),
    Row(
        "gmsh, nodes from 0",
        text(gmsh_text(ZERO[0]).replace(ZERO[1], "\n0 0 0 0\n1 1 0 0\n")),
        ".msh",
        refused="gives the number 1 to two nodes",
    ),
    Row(
        "gmsh, data of elements from 0",
        text(
            gmsh_text("0 4 2 11 1 1 2 3 5\n1 4 2 12 1 1 3 2 4")
            + '$ElementData\n1\n"part"\n1\n0\n3\n0\n1\n2\n0 7\n1 8\n$EndElementData\n'
        ),
        ".msh",
        refused="two elements have one number",
    ),
    Row("gmsh 4.1, nodes from 0", text(ZERO_4), ".msh", refused="number nodes and elements from 1"),
    Row(
        "gmsh, a node 0 that is not the first",
        text(gmsh_text(ZERO[0]).replace(ZERO[1], "\n1 1 0 0\n0 0 0 0\n")),
        ".msh",
        SIXTHS,
        {"5": 0.5},
    ),
    Row(
        "gmsh, names in Latin-1",
        latin(gmsh_text(PAIR + "3 2 2 5 1 1 2 4", '$PhysicalNames\n1\n2 5 "Überlauf"\n$EndPhysicalNames\n')),
        ".msh",
        SIXTHS,
        {"Überlauf": 0.5},
    ),
    # Salome
    Row(
        "Salome, families without groups",
        by_gmsh("tetra", names={}),
        ".med",
        {"-4": 1.0, "-5": 1.0},
        {"-1": 1.0, "-2": 1.0, "-3": 8.0},
    ),
    *(
        Row(f"Salome, {kind}", by_gmsh(kind), ".med")
        for kind in ("tetra", "tetra10", "hexahedron", "hexahedron20")
    ),
    Row(
        "Salome, groups of nodes",
        salome,
        ".med",
        areas={"bottom": 1.0, "top": 1.0, "side": 8.0, "crown": 1.0},
    ),
    Row("Salome, 27 nodes", by_gmsh("hexahedron27"), ".med", refused="that meshio does not know (H27)"),
    Row("Salome, wedges", by_gmsh("wedge"), ".med", refused=WEDGES),
    Row("Salome, hexahedra turned", by_gmsh("hexahedron20", turned=True), ".med"),
    # Abaqus and CalculiX
    *(
        Row(
            f"Abaqus of gmsh, {kind}",
            by_gmsh(kind, Mesh_SaveGroupsOfElements=1),
            ".inp",
            {**VOLUMES, "Volume1": 1.0, "Volume2": 1.0},
            {**AREAS, "Surface1": 1.0, "Surface2": 1.0, "Surface3": 8.0},
        )
        for kind in ("tetra", "hexahedron20")
    ),
    *(
        Row(f"Abaqus, {type_}", text(abaqus(kind, type_)), volumes=OF_SETS, areas=ENDS)
        for kind, type_ in (
            ("tetra", "C3D4"),
            ("tetra10", "C3D10"),
            ("hexahedron", "C3D8R"),
            ("hexahedron20", "C3D20R"),
        )
    ),
    Row(
        "Abaqus, C3D27",
        text(abaqus("hexahedron27", "C3D27", order=[*range(20), 26, 24, 25, 22, 21, 23, 20])),
        volumes=OF_SETS,
        areas=ENDS,
    ),
    Row("Abaqus, turned", text(abaqus("hexahedron", "C3D8", turned=True)), volumes=OF_SETS, areas=ENDS),
    Row("Abaqus, C3D6", text(abaqus("wedge", "C3D6")), refused=WEDGES),
    Row(
        "Abaqus, surfaces of elements",
        text(abaqus("hexahedron", "C3D8", FACES)),
        volumes=OF_SETS,
        areas=OF_FACES,
    ),
    Row("CalculiX, surfaces", text(abaqus("hexahedron20", "C3D20", FACES)), volumes=OF_SETS, areas=OF_FACES),
    Row(
        "Abaqus, a set in two pieces",
        text(abaqus("hexahedron", "C3D8", "*ELSET, ELSET=lower\n102\n")),
        volumes={**OF_SETS, "lower": 2.0},
        areas=ENDS,
    ),
    Row(
        "Abaqus CAE",
        text(cae()),
        volumes={"Set-1": 2.0},
        areas={"Set-1": 1.0, "foot": 1.0, "crown": 1.0},
    ),
    Row(
        "Abaqus CAE, an instance moved",
        text(cae(instance="1., 0., 0.\n")),
        refused="the instance 'Part-1-1' is moved",
    ),
    Row(
        "Abaqus CAE, two instances",
        text(cae().replace("*End Assembly", "*Instance, name=b, part=Part-1\n*End Instance\n*End Assembly")),
        refused="expected one part and one instance of it",
    ),
    Row(
        "Abaqus CAE, one set twice",
        text(cae(sets="*Elset, elset=Set-1, instance=Part-1-1\n101\n")),
        refused="the set 'Set-1' is in the part and in the assembly, with other members",
    ),
    Row(
        "Abaqus, nodes of elements",
        text(abaqus("hexahedron", "C3D8", "*NSET, NSET=low, ELSET=lower\n")),
        volumes=OF_SETS,
        areas={**ENDS, "low": 5.0},
    ),
    Row(
        "Abaqus, a wedge as a hexahedron",
        text(
            "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n4, 0, 1, 0\n5, 0, 0, 1\n6, 1, 0, 1\n"
            "*ELEMENT, TYPE=C3D8\n1, 1, 2, 3, 4, 5, 6, 6, 5\n"
        ),
        refused="1 of 1 hexahedron elements have one node at several corners, such as wedges",
    ),
    Row("Abaqus, INCLUDE", text(ONE + "*INCLUDE, INPUT=b.inp\n"), refused="got *INCLUDE of another"),
    Row(
        "Abaqus, a set that is not there",
        text(ONE + "*ELSET, ELSET=b\nc\n"),
        refused="the set 'C', to which 'B' refers, is not there",
    ),
    *(
        Row(f"Abaqus, {what} that is not there", text(ONE + more), refused=told)
        for what, more, told in (
            (
                "an element of a surface",
                "*SURFACE, NAME=s\none, S1\n9, S1\n",
                "'s' has the element 9, which is",
            ),
            ("an element of a set", "*ELSET, ELSET=b\n1, 9\n", "'b' has the element 9, which is not there"),
            (
                "the last of a range",
                "*ELSET, ELSET=b, GENERATE\n1, 9\n",
                "'b' has the element 9, which is not",
            ),
            ("a node of a set", "*NSET, NSET=b\n1, 9\n", "'b' has the node 9, which is not there"),
            ("a set of a surface", "*SURFACE, NAME=s\nb, S1\n", "the set 'B', to which 's' refers, is not"),
        )
    ),
    Row(
        "Abaqus, a range with gaps",
        text(abaqus("hexahedron", "C3D8", "*NSET, NSET=every, GENERATE\n10, 120, 1\n")),
        volumes=OF_SETS,
        areas={**ENDS, "every": 10.0},
    ),
    Row(
        "Abaqus, a set with a truss",
        text(LID + "*ELEMENT, TYPE=T3D2\n7, 1, 2\n*ELSET, ELSET=b\n1, 7\n"),
        volumes={**OF_ONE[0], "b": 1 / 6},
        areas=OF_ONE[1],
    ),
    Row(
        "Abaqus, names that differ in capitals",
        text(ONE + "*ELSET, ELSET=Top\n1\n*ELSET, ELSET=top\n1\n"),
        refused="the sets 'Top' and 'top' are one set for Abaqus",
    ),
    Row(
        "Abaqus, names in Latin-1",
        latin(LID + "*ELSET, ELSET=süß\n1\n"),
        volumes={**OF_ONE[0], "süß": 1 / 6},
        areas=OF_ONE[1],
    ),
    Row(
        "Abaqus CAE, an element by the name of its instance",
        text(cae(sets="*Elset, elset=low\nPart-1-1.101\n")),
        volumes={"Set-1": 2.0, "low": 1.0},
        areas={"Set-1": 1.0, "foot": 1.0, "crown": 1.0},
    ),
    Row("Abaqus, a set within itself", text(ONE + "*ELSET, ELSET=b\nb\n"), refused="contains itself"),
    Row(
        "Abaqus, a node that is not there",
        text(ONE.replace("1, 1, 2, 3, 4", "1, 1, 2, 3, 9")),
        refused="has the node 9, which is not there",
    ),
    Row(
        "Abaqus, a number twice",
        text(ONE + "*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 4\n"),
        refused="the element 1 is there twice",
    ),
    Row(
        "Abaqus, an element twice",
        text(ONE + "*ELEMENT, TYPE=C3D4, ELSET=one\n2, 1, 2, 3, 4\n"),
        refused="1 tetra elements are there more than once, with the same nodes, in 'one'",
    ),
    Row(
        "Abaqus, no face S5",
        text(ONE + "*SURFACE, NAME=s\none, S5\n"),
        refused="the surface 's' has no face 'S5' of tetra elements",
    ),
    Row("Abaqus, generated nodes", text(ONE + "*NGEN\n1, 4\n"), refused="*NGEN is not read"),
    # Exodus
    *(
        Row(f"Exodus, {TYPES[kind]}", exodus(kind), ".exo", *OF_EXODUS)
        for kind in ("tetra", "tetra10", "hexahedron", "hexahedron20", "hexahedron27")
    ),
    Row("Exodus as NetCDF-4", exodus("hexahedron20", netcdf4=True), ".e", *OF_EXODUS),
    Row(
        "Exodus without names",
        exodus("hexahedron", names=False),
        ".g",
        BY_NUMBER[0],
        {**BY_NUMBER[1], "5": 1.0},
    ),
    Row("Exodus, wedges", exodus("wedge"), ".exo", refused=WEDGES),
    *(
        Row(
            f"Exodus, {array} of nothing",
            with_first(exodus("tetra", netcdf4=True), array, 99),
            ".e",
            refused=told,
        )
        for array, told in (
            ("elem_ss1", "the side set 'bottom' has the element 99, but"),
            ("node_ns1", "the node set 'crown' has the node 99, but"),
        )
    ),
    Row(
        "Exodus as CDF-5",
        lambda path: path.write_bytes(b"CDF\x05") and None,
        ".exo",
        refused="got one of CDF-5",
    ),
    Row(
        "Exodus cut short",
        lambda path: path.write_bytes(b"CDF\x01\0\0") and None,
        ".exo",
        refused="is damaged, cut",
    ),
    # SU2
    *(Row(f"SU2, {kind}", by_gmsh(kind), ".su2", {"0": 2.0}, AREAS) for kind in ("tetra", "hexahedron")),
    Row("SU2, second order", by_gmsh("tetra10"), ".su2", refused="that meshio does not know (24)"),
    *(
        Row(f"SU2, {pattern} changed", edited(by_gmsh("tetra"), (pattern, by)), ".su2", refused=told)
        for pattern, by, told in (
            ("NMARK= 4", "NMARK= 5", "expected 5 entries by NMARK, got 4"),
            (r"(?<=NPOIN= )(?=\d)", "1", "entries by NPOIN, got"),
            (r"(?<=NELEM= )(?=\d)", "1", "entries by NELEM, got"),
            (r"\n[^\n]+\s*\Z", "\n", "expected 20 entries by MARKER_ELEMS of 'skin', got 19"),
        )
    ),
    # Nastran
    *(
        Row(
            f"Nastran of gmsh, {kind}",
            by_gmsh(kind),
            ".bdf",
            {"1": 1.0, "2": 1.0},
            {"1": 1.0, "2": 1.0, "3": 8.0},
        )
        for kind in ("tetra", "tetra10", "hexahedron", "hexahedron20")
    ),
    *(Row(f"Nastran, {kind}", text(nastran(kind)), ".nas", *BY_NUMBER) for kind in ("tetra", "hexahedron")),
    Row("Nastran, large fields", text(large_fields(nastran("hexahedron"))), ".bdf", *BY_NUMBER),
    Row(
        "Nastran in small letters",
        text(nastran("tetra").replace("BEGIN BULK", "begin bulk")),
        ".fem",
        *BY_NUMBER,
    ),
    *(
        Row(f"Nastran, {what} in another system", text(content), ".bdf", refused="in the system 7; save")
        for what, content in (
            ("a node", nastran("tetra").replace("GRID,3,,", "GRID,3,7,")),
            (
                "a small field",
                re.sub(
                    "GRID,3,.*", f"GRID           3       7{'0.0':>8}{'0.0':>8}{'0.0':>8}", nastran("tetra")
                ),
            ),
            (
                "a large field",
                large_fields(nastran("tetra")).replace(f"{3:>16}{'':16}", f"{3:>16}{7:>16}"),
            ),
            ("all", nastran("tetra").replace("BEGIN BULK\n", "BEGIN BULK\nGRDSET,,7\n")),
        )
    ),
    Row("Nastran as .dat", text(nastran("tetra")), ".dat", refused="is one of Nastran; rename it to .bdf"),
    # Medit
    *(
        Row(f"Medit, {kind}", by_gmsh(kind), ".mesh", {"1": 1.0, "2": 1.0}, {"1": 1.0, "2": 1.0, "3": 8.0})
        for kind in ("tetra", "hexahedron")
    ),
    Row("Medit, second order", by_gmsh("tetra10"), ".mesh", refused="has elements of second order"),
    # VTK
    *(
        Row(f"VTK of gmsh, {kind}", by_gmsh(kind), ".vtk", *BY_NUMBER)
        for kind in ("tetra10", "hexahedron20", "hexahedron27")
    ),
    *(
        Row(f"VTU, {kind}", by_meshio(kind), ".vtu", *BY_NUMBER)
        for kind in ("tetra", "tetra10", "hexahedron", "hexahedron20", "hexahedron27")
    ),
    Row(
        "VTU, data with another name",
        by_meshio("tetra", "part"),
        ".vtu",
        refused="its elements have the data 'part'",
    ),
    Row("VTU, data in capitals", by_meshio("tetra", "CELLENTITYIDS"), ".vtu", *BY_NUMBER),
    Row(
        "a collection of ParaView",
        text('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1"></VTKFile>\n'),
        ".pvd",
        refused="a collection of ParaView by its first bytes; give a file that it names",
    ),
    # XDMF
    *(Row(f"XDMF, {kind}", by_meshio(kind), ".xdmf", *BY_NUMBER) for kind in ("tetra", "hexahedron")),
    Row("XDMF, second order", by_meshio("tetra10"), ".xdmf", refused="that meshio does not know (38)"),
]


def sizes(body: BodyMesh) -> tuple[dict[str, float], dict[str, float]]:
    return (
        {name: float(body.weights[own].sum()) for name, own in body.volumes.items()},
        {name: float(Facets(body, own).areas.sum()) for name, own in body.surfaces.items()},
    )


@pytest.mark.parametrize(
    "row", [pytest.param(row, id=row.name, marks=[pytest.mark.slow] if row.slow else []) for row in ROWS]
)
def test_a_file_is_read_right_or_refused_in_one_message(tmp_path, row):
    path = tmp_path / f"column{row.suffix}"
    row.write(path)
    if row.refused:
        with pytest.raises(ConfigurationError) as refused:
            read_body(path, None, 1.0).check("macro.body")
        told = str(refused.value)
        assert row.refused in told
        assert told.startswith("macro.body")
        assert "\n" not in told
        return
    body = read_body(path, None, 1.0).check("macro.body")
    volumes, areas = sizes(body)
    assert volumes == pytest.approx(dict(row.volumes), rel=1e-12)
    assert areas == pytest.approx(dict(row.areas), rel=1e-12)


def test_the_table_has_sixty_rows_of_as_many_names():
    assert len({row.name for row in ROWS}) == len(ROWS) >= 60


@pytest.mark.parametrize("kind", ["hexahedron20", "hexahedron27"])
def test_curved_hexahedra_have_their_nodes_where_the_shape_functions_place_them(tmp_path, kind):
    """x (1 + y²/4) is one of the shape functions of 20 nodes, and the Jacobian that of the volume, exactly."""
    mesh = column(kind)
    mesh.points = bent(mesh.points)
    to_meshio(mesh, "material").write(tmp_path / "bent.vtu")
    body = read_body(tmp_path / "bent.vtu", None, 1.0)
    volumes, areas = sizes(body)
    # ∫ 1 + y²/4 dy from 0 to 1, and to 2.
    assert volumes == pytest.approx({"11": 13 / 12, "12": 8 / 3 - 13 / 12}, rel=1e-12)
    assert areas["21"] == pytest.approx(1, rel=1e-12)
    assert areas["22"] == pytest.approx(2, rel=1e-12)
    straight = bent(column("hexahedron27").points)
    np.testing.assert_allclose(by_rows(body.points), by_rows(straight), atol=1e-13)


def bent(points: Any) -> Any:
    return points * np.column_stack([1 + points[:, 1] ** 2 / 4, *np.ones((2, len(points)))])


def by_rows(points: Any) -> Any:
    return points[np.lexsort(np.round(points, 9).T)]


@pytest.mark.parametrize(
    ("name", "solid", "fluid"),
    [
        ("gmsh 4.1", "lower", "upper"),
        ("gmsh 4.1", 11, "12"),
        ("gmsh, tetrahedra turned", "lower", 12),
        ("Salome, tetra10", "lower", "upper"),
        ("Abaqus, C3D10", "lower", "upper"),
        ("Exodus, TETRA10", "lower", 12),
        ("Nastran, tetra", 11, 12),
        ("VTU, tetra10", 11, 12),
        ("XDMF, tetra", 11, 12),
    ],
)
def test_a_cell_is_read_from_the_same_files(tmp_path, name, solid, fluid):
    """The lower half is solid, the upper one the pores; opposite faces have the same tetrahedra."""
    path = written(tmp_path, name)
    cell = MeshFile(kind="mesh-file", path=str(path), solid=(solid,), fluid=(fluid,))
    assert cell.porosity == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("name", ["Abaqus, C3D8R", "Exodus, HEX20", "Salome, wedges", "VTU, hexahedron27"])
def test_other_elements_of_a_cell_are_refused_with_how_to_convert_them(tmp_path, name):
    cell = MeshFile(kind="mesh-file", path=str(written(tmp_path, name)), solid=(11,), fluid=(12,))
    with pytest.raises(
        ConfigurationError, match=r"expected tetrahedra .* got (hex|wedge).*; mesh it with tetrahedra alone"
    ):
        _ = cell.porosity


def written(folder: Path, name: str) -> Path:
    """Return the path of a file of the table, which is written into a folder."""
    row = next(row for row in ROWS if row.name == name)
    path = folder / f"{len(list(folder.iterdir()))}{row.suffix}"
    row.write(path)
    return path


BY_NAME, BY_GROUP, BY_ENTITY = ("bottom", "top", "side"), ("21", "22", "23"), ("1", "2", "3")
#: Files of each format, the first as a reference, and how their surfaces are called.
FORMATS: dict[str, list[tuple[str, tuple[str, ...]]]] = {
    "tetra": [
        ("gmsh 4.1", BY_NAME),
        ("gmsh 4.1", BY_GROUP),
        ("gmsh 2.2", BY_NAME),
        ("Salome, tetra", BY_NAME),
        ("Abaqus of gmsh, tetra", BY_NAME),
        ("Exodus, TETRA", BY_NAME),
        ("SU2, tetra", BY_NAME),
        ("Nastran, tetra", BY_GROUP),
        ("Nastran of gmsh, tetra", BY_ENTITY),
        ("Medit, tetra", BY_ENTITY),
        ("VTU, tetra", BY_GROUP),
        ("XDMF, tetra", BY_GROUP),
    ],
    "hexahedron20": [
        ("gmsh, 20 nodes", BY_NAME),
        ("gmsh, 20 nodes turned", BY_GROUP),
        ("Salome, hexahedron20", BY_NAME),
        ("Abaqus of gmsh, hexahedron20", BY_NAME),
        ("Exodus as NetCDF-4", BY_NAME),
        ("Nastran of gmsh, hexahedron20", BY_ENTITY),
        ("VTK of gmsh, hexahedron20", BY_GROUP),
        ("VTU, hexahedron27", BY_GROUP),
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", FORMATS)
def test_a_column_settles_alike_through_every_format(tmp_path, kind):
    """It is held below, at the side by its displacement, and drained and loaded on top."""
    pytest.importorskip("porocore_fem_skfem")

    def settlement(name: str, surfaces: tuple[str, ...]) -> Any:
        bottom, top, side = surfaces
        path = written(tmp_path, name)
        problem = MacroProblem.model_validate(
            {
                "body": {"kind": "file", "path": str(path), "symmetry": []},
                "boundary": {
                    bottom: {"displacement": [0, 0, 0]},
                    side: {"displacement": [0, None, 0]},
                    top: {"traction": [0, -0.01, 0], "pressure": 0},
                },
                "time": {"end": 1000, "step": 100, "ramp_increments": 2, "ramp_step": 0.1, "profiles": [1]},
            }
        )
        solver = registry().get("macro solver", "skfem")()
        return np.asarray(solver.solve(solver.prepare(problem), linear_law()).history.settlement)

    expected, *others = (settlement(*each) for each in FORMATS[kind])
    # In the end the height times the traction over the modulus of a confined column.
    modulus = linear_law().coefficients.stiffness[1, 1, 1, 1]
    assert expected[-1] == pytest.approx(2 * 0.01 / modulus, rel=1e-9)
    for found in others:
        np.testing.assert_allclose(found, expected, rtol=1e-10)
