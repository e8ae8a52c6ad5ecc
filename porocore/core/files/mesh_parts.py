"""Meshes as files have them (ForeignMesh): parts, elements, each once, and the groups that these belong to."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray

#: Hexahedron with nodes at its corners and in the middle of its edges.
SERENDIPITY = "hexahedron20"
#: Nodes and corners of the kinds of elements that are made use of.
NODES = {
    "tetra": 4, "tetra10": 10, "hexahedron": 8, SERENDIPITY: 20, "hexahedron27": 27,
    "triangle": 3, "triangle6": 6, "quad": 4, "quad8": 8, "quad9": 9, "line": 2, "line3": 3,
}  # fmt: skip
CORNERS = {
    "tetra": 4, "tetra10": 4, "hexahedron": 8, SERENDIPITY: 8, "hexahedron27": 8,
    "triangle": 3, "triangle6": 3, "quad": 4, "quad8": 4, "quad9": 4, "line": 2, "line3": 2,
}  # fmt: skip
#: Coordinates whose cubes are finite.
FARTHEST = 1e90

#: Rows of elements by their kind.
Rows = Mapping[str, IntArray]
_Pieces = dict[str, list[IntArray]]


@dataclass(frozen=True, eq=False)
class ForeignMesh:
    """Elements of a file with a volume (dimension 3) and faces (dimension 2), each once, and their groups.

    Of a flat mesh the elements are those of the plane, as dimension 3, and the edges, as dimension 2.

    Attributes
    ----------
    points : (nodes, 3)
        All nodes of the file.
    elements
        Nodes (k, n) of the elements in VTK's order, by dimension and kind.
    groups
        Rows of ``elements`` by dimension, name and kind. A group without a name has its number as one. An element may
        be in several groups.
    tags
        Names of the groups that have a number, by dimension and number; with faces those of sets of nodes.
    node_groups
        Nodes (k,) of each named set of nodes.
    clashes
        Why a text that is the name of one group and the number of another stands for neither, by dimension and text.
    data
        Values (k, ...) of the elements with a volume, by name and kind; NaN where the file has none.
    """

    points: Array
    elements: Mapping[int, Mapping[str, IntArray]]
    groups: Mapping[int, Mapping[str, Rows]]
    tags: Mapping[int, Mapping[int, str]]
    node_groups: Mapping[str, IntArray]
    clashes: Mapping[int, Mapping[str, str]]
    data: Mapping[str, Mapping[str, Array]]

    def name(self, dimension: int, wanted: str | int) -> str | None:
        """Return the name of the group with a name or number; None where there is none.

        ``clashes`` has the texts of which this is one of two groups.
        """
        text = str(wanted)
        if text in self.groups[dimension]:
            return text
        return self.tags[dimension].get(int(text)) if re.fullmatch(r"\d{1,18}", text) else None


class Parts:
    """Blocks of elements, their groups and data, as a file has them, to be made one mesh."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.blocks: dict[int, dict[str, list[IntArray]]] = {2: {}, 3: {}}
        self.counts: Counter[tuple[int, str]] = Counter()
        #: By dimension, name and number, None without.
        self.members: dict[int, dict[str, dict[int | None, _Pieces]]] = {2: {}, 3: {}}
        self.tags: dict[int, dict[int, str]] = {2: {}, 3: {}}
        self.data: dict[str, dict[str, list[tuple[IntArray, Array]]]] = {}
        self.node_groups: dict[str, list[IntArray]] = {}
        self.node_tags: dict[int, str] = {}

    def add(self, dim: int, kind: str, nodes: IntArray) -> IntArray:
        """Add elements and return their rows."""
        first = self.counts[dim, kind]
        self.counts[dim, kind] += len(nodes)
        self.blocks[dim].setdefault(kind, []).append(nodes)
        return np.arange(first, first + len(nodes))

    def join(self, dim: int, kind: str, rows: IntArray, name: str, tag: int | None = None) -> None:
        """Make elements members of a group, whose name is its number where it has none."""
        label = name or str(tag)
        if tag is not None:
            self.tags[dim][tag] = label
        pieces = self.members[dim].setdefault(label, {}).setdefault(tag, {})
        pieces.setdefault(kind, []).append(rows)

    def number(self, dim: int, kind: str, rows: IntArray, numbers: Any, names: Mapping[int, str]) -> None:
        """Make elements members of the groups whose numbers (k,) they have."""
        numbers = np.rint(np.asarray(numbers).reshape(-1)).astype(np.int64)
        order = np.argsort(numbers, kind="stable")
        values, starts = np.unique(numbers[order], return_index=True)
        for value, own in zip(values.tolist(), np.split(rows[order], starts[1:]), strict=True):
            self.join(dim, kind, own, names.get(value, ""), value)

    def gather(self, name: str, nodes: IntArray, tag: int | None = None) -> None:
        """Make nodes members of a named set of nodes, which may have a number."""
        self.node_groups.setdefault(name, []).append(nodes)
        if tag is not None:
            self.node_tags[tag] = name

    def set_data(self, name: str, kind: str, rows: IntArray, values: Array) -> None:
        """Give elements with a volume their data (k, ...)."""
        self.data.setdefault(name, {}).setdefault(kind, []).append((rows, values))

    def mesh(self, points: Array, numbering: str | None = None) -> ForeignMesh:
        """Return the mesh; data whose name is ``numbering`` make groups of the elements with a volume.

        Raises
        ------
        ConfigurationError
            Nodes and elements do not fit together, or elements are given twice.
        """
        nodes = {
            dim: {kind: np.concatenate(of) for kind, of in blocks.items()}
            for dim, blocks in self.blocks.items()
        }
        if fault := _fault(points, [*nodes[2].items(), *nodes[3].items()]):
            raise ConfigurationError(f"{self.path}: {fault}")
        data = {
            name: {kind: self._joined(kind, of) for kind, of in given.items()}
            for name, given in self.data.items()
        }
        for kind, numbers in data.get(numbering or "", {}).items():
            if not whole(numbers):
                raise ConfigurationError(
                    f"{self.path}: expected whole numbers as tags, but {numbering} holds others"
                )
            self.number(3, kind, np.arange(len(numbers)), numbers, {})
        groups: dict[int, dict[str, Rows]] = {2: {}, 3: {}}
        clashes: dict[int, dict[str, str]] = {}
        for dim, of in nodes.items():
            places = {}
            joint = {label: _joint(by_tag.values()) for label, by_tag in self.members[dim].items()}
            for kind in of:
                own = {label: members[kind] for label, members in joint.items() if kind in members}
                kept, places[kind] = _once(of[kind], kind, own, self.path, strict=dim == 3)
                of[kind] = of[kind][kept]
                if dim == 3:
                    data |= {
                        name: each | {kind: each[kind][kept]} for name, each in data.items() if kind in each
                    }
            # In the order of their numbers, as far as they have one, and not of a format.
            first = {label: tag for tag, label in sorted(self.tags[dim].items(), reverse=True)}
            for label, members in sorted(joint.items(), key=lambda each: first.get(each[0], -1)):
                groups[dim][label] = {kind: np.unique(places[kind][rows]) for kind, rows in members.items()}
            clashes[dim] = self._clashes(dim, places)
        node_groups = {name: np.unique(np.concatenate(of)) for name, of in self.node_groups.items()}
        # Faces come first.
        of_nodes = {
            tag: name for tag, name in self.node_tags.items() if str(tag) not in {*groups[2], *node_groups}
        }
        self.tags[2] = of_nodes | self.tags[2]
        return ForeignMesh(points, nodes, groups, self.tags, node_groups, clashes, data)

    def _clashes(self, dim: int, places: Rows) -> dict[str, str]:
        """Return why a text that is the name of one group and the number of another cannot be used.

        ``places`` are the new rows of the elements by kind.
        """
        what = "faces" if dim == 2 else "elements"
        by_name, tags = self.members[dim], self.tags[dim]

        def count(pieces: Iterable[_Pieces]) -> str:
            rows = _joint(pieces)
            return f"{sum(len(np.unique(places[kind][of])) for kind, of in rows.items()):,} {what}"

        numbered = {str(tag): tag for tag, name in tags.items() if by_name.get(str(tag), {}).keys() - {tag}}
        found = {}
        for text, tag in numbered.items():
            others = {other: pieces for other, pieces in by_name[text].items() if other != tag}
            numbers = "".join(
                f"number {other}, " for other in sorted(other for other in others if other is not None)
            )
            name = tags[tag]
            called = "without a name" if name == text else f"named '{name}'"
            remedy = (
                "give both in the mesher names that are no numbers"
                if name == text or name in numbered
                else f"give the first in the mesher a name that is no number, and write '{name}' for the second"
            )
            found[text] = (
                f"'{text}' is both the name of one group ({numbers}{count(others.values())}) and the number of another "
                f"({called}, {count([by_name[name][tag]])}); {remedy}"
            )
        return found

    def _joined(self, kind: str, pieces: list[tuple[IntArray, Array]]) -> Array:
        """Return the data of all elements of a kind; NaN where no piece has any."""
        shape = pieces[0][1].shape[1:]
        found = np.full((self.counts[3, kind], *shape), np.nan)
        for rows, values in pieces:
            if values.shape[1:] == shape:
                found[rows] = values
        return found


def _joint(pieces: Iterable[_Pieces]) -> dict[str, IntArray]:
    """Return rows of elements by kind, those of all pieces."""
    found: _Pieces = {}
    for each in pieces:
        for kind, rows in each.items():
            found.setdefault(kind, []).extend(rows)
    return {kind: np.concatenate(rows) for kind, rows in found.items()}


def _once(
    nodes: IntArray, kind: str, groups: Mapping[str, IntArray], path: Path, *, strict: bool
) -> tuple[IntArray, IntArray]:
    """Find elements (k, n) with the same corners, which are one element in several groups.

    Returns
    -------
    kept, place
        Rows of the elements without their copies; new row of every old one.

    Raises
    ------
    ConfigurationError
        ``strict``, and copies are in the same group or one of them is in none, so that they are no way to name groups.
    """
    corners = nodes[:, : CORNERS.get(kind, nodes.shape[1])]
    place = np.arange(len(nodes))
    # The same corners have the same sum of random weights; those with the same sum are then compared.
    weights = np.random.default_rng(0).integers(0, 1 << 63, int(corners.max()) + 1, dtype=np.uint64)
    sums = weights[corners].sum(axis=1, dtype=np.uint64)
    order = np.argsort(sums, kind="stable")
    same = np.flatnonzero(sums[order][1:] == sums[order][:-1])
    if not len(same):
        return place, place
    suspects = np.unique(order[np.concatenate([same, same + 1])])
    _, first, which = np.unique(
        np.sort(corners[suspects], axis=1), axis=0, return_index=True, return_inverse=True
    )
    place[suspects] = suspects[first[which.reshape(-1)]]
    copies = place != np.arange(len(nodes))
    if strict:
        _require_groups_of_copies(place, copies, kind, groups, path)
    kept = np.flatnonzero(~copies)
    return kept, np.searchsorted(kept, place)


def _require_groups_of_copies(
    place: IntArray, copies: Any, kind: str, groups: Mapping[str, IntArray], path: Path
) -> None:
    """Refuse copies of elements that differ in nothing but their number."""
    repeated, where = np.zeros(len(place), dtype=bool), []
    memberships = np.zeros(len(place), dtype=np.int64)
    for label, rows in groups.items():
        memberships[rows] += 1
        times = np.bincount(place[rows], minlength=len(place))
        if (times > 1).any():
            where.append(f"'{label}'")
            repeated |= times > 1
    alone = np.flatnonzero((memberships == 0) & np.isin(place, place[copies]))
    if len(alone):
        where.append("no group")
        repeated[place[alone]] = True
    if count := int(repeated.sum()):
        raise ConfigurationError(
            f"{path}: {count:,} {kind} elements are there more than once, with the same nodes, in "
            f"{' and '.join(where[:8])}; remove their copies (gmsh: Tools > Remove duplicate elements)"
        )


def decoded(text: bytes) -> str:
    """Return a text as UTF-8, or as Latin-1, which older programs write."""
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1")


def whole(values: Any) -> bool:
    """Return whether data are whole numbers, one for each element."""
    values = np.asarray(values, dtype=float)
    return values.shape in ((len(values),), (len(values), 1)) and bool(
        (np.isfinite(values) & (values == np.rint(values)) & (np.abs(values) < 1e18)).all()
    )


def _fault(points: Array, blocks: Iterable[tuple[str, IntArray]]) -> str:
    """Say why nodes and elements do not fit together; empty if they do."""
    known = np.zeros(len(points), dtype=bool)
    for kind, nodes in blocks:
        if kind in NODES and nodes.shape[1] != NODES[kind]:
            return f"expected {kind} elements of {NODES[kind]} nodes, got {nodes.shape[1]}"
        low, high = int(nodes.min()), int(nodes.max())
        if low < 0 or high >= len(points):
            return f"an element has the node {low if low < 0 else high}, but there are {len(points):,} nodes, from 0"
        known[nodes] = True
    strange = known & ~(np.abs(points) < FARTHEST).all(axis=1)
    if strange.any():
        number = int(np.flatnonzero(strange)[0])
        place = ", ".join(f"{x:g}" for x in points[number])
        return (
            f"coordinates that are not finite or larger than {FARTHEST:g}, such as node {number} at ({place})"
        )
    return ""
