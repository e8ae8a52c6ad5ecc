"""Meshes of Exodus II (.e, .exo, .ex2, .g; Cubit): element blocks, side sets and node sets with their names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from porocore.core.files.mesh_parts import SERENDIPITY, Parts, decoded
from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray

SUFFIXES = (".e", ".exo", ".ex2", ".g")
#: Beginnings of the names of the variables that are read.
_VARIABLES = ("coord", "connect", "eb_", "ss_", "ns_", "elem_ss", "side_ss", "node_ns")
#: Kinds by the first letters of their types and their number of nodes.
_KINDS = {
    "TET": {4: "tetra", 10: "tetra10"},
    "HEX": {8: "hexahedron", 20: SERENDIPITY, 27: "hexahedron27"},
    "WED": {6: "wedge", 15: "wedge15"},
    "PYR": {5: "pyramid", 13: "pyramid13"},
    "TRI": {3: "triangle", 6: "triangle6"},
    "QUA": {4: "quad", 8: "quad8", 9: "quad9"},
    "SHE": {3: "triangle", 6: "triangle6", 4: "quad", 8: "quad8", 9: "quad9"},
}
#: Places of the nodes in VTK's order; others have that order.
_SERENDIPITY = [*range(12), 16, 17, 18, 19, 12, 13, 14, 15]
_ORDERS = {SERENDIPITY: _SERENDIPITY, "hexahedron27": [*_SERENDIPITY, 23, 24, 25, 26, 21, 22, 20]}
#: Corners of the sides, from 1.
_SIDES: dict[str, list[tuple[int, ...]]] = {
    "TET": [(0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)],
    "HEX": [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)],
    "WED": [(0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 2, 1), (3, 4, 5)],
}


def exodus_parts(path: Path) -> tuple[Parts, Array]:
    """Return the parts of the mesh of a file and its nodes (n, 3).

    Raises
    ------
    ConfigurationError
        Nodes are not in three dimensions, a side is of no element, or a set has what is not there.
    Exception
        The file is damaged or of another kind.
    """
    with path.open("rb") as file:
        beginning = file.read(4)
    if beginning == b"CDF\x05":
        raise ConfigurationError(
            f"{path}: expected a file of NetCDF-4 or NetCDF-3, got one of CDF-5; convert it (nccopy -k nc4 OLD NEW)"
        )
    if beginning == b"\x89HDF":
        import h5py  # heavy, and needed here only

        with h5py.File(path) as opened:
            chosen = {name: opened[name] for name in opened if name.startswith(_VARIABLES)}
            held = {name: np.asarray(of) for name, of in chosen.items()}
            types = {name: of.attrs.get("elem_type", b"") for name, of in chosen.items()}
    else:
        from scipy.io import netcdf_file

        with netcdf_file(path, mmap=False) as opened:
            chosen = {name: of for name, of in opened.variables.items() if name.startswith(_VARIABLES)}
            held = {name: of[:] for name, of in chosen.items()}
            types = {name: getattr(of, "elem_type", b"") for name, of in chosen.items()}
    return _parts(path, held, types)


def _parts(path: Path, held: Mapping[str, Any], types: Mapping[str, Any]) -> tuple[Parts, Array]:
    axes = [held[name] for name in ("coordx", "coordy", "coordz") if name in held]
    points = np.stack(axes, axis=1) if axes else np.asarray(held["coord"]).T
    parts = Parts(path)
    #: Beginning of its type, kind, first number and nodes of each block of elements.
    blocks: list[tuple[str, int, IntArray]] = []
    first = 1
    for name, tag, i in _named(held, "eb"):
        if f"connect{i}" not in held:
            continue
        nodes = np.asarray(held[f"connect{i}"], dtype=np.int64) - 1
        type_ = _text(types[f"connect{i}"]).upper()
        begins = type_[:3]
        kind = _KINDS.get(begins, {}).get(nodes.shape[1], type_ if begins in _KINDS else "")
        blocks.append((begins, first, nodes))
        first += len(nodes)
        if kind and len(nodes):
            dim = 3 if begins in ("TET", "HEX", "WED", "PYR") else 2
            rows = parts.add(dim, kind, nodes[:, _ORDERS[kind]] if kind in _ORDERS else nodes)
            parts.join(dim, kind, rows, name, tag)
    for name, tag, i in _named(held, "ss"):
        if f"elem_ss{i}" in held:
            elements, sides = (np.asarray(held[f"{what}_ss{i}"], dtype=np.int64) for what in ("elem", "side"))
            _require_there(path, f"the side set '{name or tag}' has the element", elements, first - 1)
            for face in _faces(path, blocks, elements, sides, name or str(tag)):
                kind = "triangle" if face.shape[1] == 3 else "quad"
                parts.join(2, kind, parts.add(2, kind, face), name, tag)
    for name, tag, i in _named(held, "ns"):
        if f"node_ns{i}" in held:
            nodes = np.asarray(held[f"node_ns{i}"], dtype=np.int64)
            _require_there(path, f"the node set '{name or tag}' has the node", nodes, len(points))
            parts.gather(name or str(tag), nodes - 1, tag)
    return parts, np.asarray(points, dtype=float)


def _require_there(path: Path, what: str, numbers: IntArray, most: int) -> None:
    """Refuse numbers outside of 1 to ``most``."""
    if (strange := numbers[(numbers < 1) | (numbers > most)]).size:
        raise ConfigurationError(
            f"{path}: {what} {strange[0]}, but they are numbered from 1 to {most:,}; save the mesh anew"
        )


def _faces(
    path: Path, blocks: list[tuple[str, int, IntArray]], elements: IntArray, sides: IntArray, name: str
) -> list[IntArray]:
    """Return the corners (k, 3 or 4) of sides of elements."""
    found = []
    for begins, first, nodes in blocks:
        own = (elements >= first) & (elements < first + len(nodes))
        rows, numbers = nodes[elements[own] - first], sides[own]
        if begins in ("TRI", "QUA", "SHE"):
            # The two large sides of a shell are it itself; others are its edges.
            found.append(rows[numbers <= 2][:, : 3 if nodes.shape[1] in (3, 6) else 4])
            continue
        for number in np.unique(numbers).tolist():
            of = _SIDES.get(begins, [])
            if not 1 <= number <= len(of):
                raise ConfigurationError(
                    f"{path}: the side set '{name}' has the side {number} of {begins} elements, which is not read; "
                    "save the mesh as .msh or .med"
                )
            found.append(rows[numbers == number][:, of[number - 1]])
    return [face for face in found if len(face)]


def _named(held: Mapping[str, Any], what: str) -> list[tuple[str, int, int]]:
    """Return name, number and position, from 1, of blocks (eb), side sets (ss) or node sets (ns)."""
    numbers = np.asarray(held.get(f"{what}_prop1", [])).reshape(-1).tolist()
    names = [_text(name) for name in held.get(f"{what}_names", [])]
    return [(names[i] if i < len(names) else "", int(number), i + 1) for i, number in enumerate(numbers)]


def _text(given: Any) -> str:
    """Return a text that is one, or characters in a row, up to its end."""
    joint = given if isinstance(given, bytes | str) else b"".join(np.asarray(given).reshape(-1).tolist())
    text = decoded(joint.split(b"\0")[0]) if isinstance(joint, bytes) else joint
    return text.split("\0")[0].strip()
