"""Meshes of Abaqus and CalculiX (.inp): elements, *ELSET, *NSET and *SURFACE, with all that they refer to."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import chain, pairwise
from pathlib import Path

import numpy as np

from porocore.core.echo import echo, joined
from porocore.core.files.mesh_parts import SERENDIPITY, Parts, decoded
from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray

#: Elements with a volume, and faces, by what their types begin with and their number of nodes.
_SOLID = re.compile(r"(?:A|D|DC|Q)?C3D(\d+)")
_FACE = re.compile(r"(?:D?S|R3D|M3D|SFM3D|CPS|CPEG?|CAX|STRI(?=3)|STRI6(?=5)|F3D)(\d)")
_KINDS = {
    3: {
        4: "tetra", 5: "pyramid", 6: "wedge", 8: "hexahedron",
        10: "tetra10", 15: "wedge15", 20: SERENDIPITY, 27: "hexahedron27",
    },
    2: {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"},
}  # fmt: skip
#: Of elements that are left out: trusses, beams, springs, masses and connections.
_LEFT_OUT = re.compile(r"T[23]D|B[23]|PIPE|FRAME|ELBOW|MASS|ROTARYI|SPRING|DASHPOT|CONN|GAP|DCOUP|D")
#: Places of the nodes in VTK's order; others have that order.
_ORDERS = {"hexahedron27": [*range(20), 26, 24, 23, 25, 21, 22, 20]}
#: Corners of the faces S1, S2, ...
_SIDES: dict[int, list[tuple[int, ...]]] = {
    4: [(0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)],
    6: [(0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)],
    8: [(0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)],
}
_CORNERS = {"tetra": 4, "tetra10": 4, "wedge": 6, "wedge15": 6}
#: Keywords that make or place nodes or elements other than by their numbers.
_MAKING = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")


@dataclass
class _Set:
    """Members by numbers, in ranges with gaps, by names of other sets, and of sets of elements whose nodes they are."""

    name: str
    numbers: list[IntArray] = field(default_factory=list)
    ranges: list[IntArray] = field(default_factory=list)
    others: list[str] = field(default_factory=list)
    elements: list[str] = field(default_factory=list)
    hidden: bool = False


class AbaqusFile:
    """Reader of one file.

    Names are known in capitals, and those of an instance's parts without its name.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        #: Numbers and places of blocks of nodes.
        self.nodes: list[tuple[IntArray, Array]] = []
        #: Dimension, kind, numbers and nodes of blocks of elements.
        self.blocks: list[tuple[int, str, IntArray, IntArray]] = []
        #: Numbers, ascending, of all elements, those that are left out too, and of all nodes.
        self.there: dict[str, IntArray] = {}
        self.left_out: list[IntArray] = []
        #: Sets of elements and of nodes; those of an assembly apart from those of its part.
        self.sets: dict[str, dict[tuple[bool, str], _Set]] = {"ELSET": {}, "NSET": {}}
        #: Name, and lines of an element or set with its face, or of a node or set.
        self.surfaces: list[tuple[str, str, list[str]]] = []
        self.parts: list[str] = []
        self.instances: list[str] = []
        #: Whether what comes belongs to an assembly and to none of its instances: reference points, and sets.
        self.in_assembly = False

    def refuse(self, told: str) -> ConfigurationError:
        return ConfigurationError(f"{self.path}: {told}")

    def mesh_parts(self) -> tuple[Parts, Array]:
        """Return the parts of the mesh and its nodes (n, 3).

        Raises
        ------
        ConfigurationError
            Something is no mesh, or is given in a way that is not read.
        """
        for keyword, given, lines in self._keywords():
            self._take(keyword, given, lines)
        numbers, points = self._nodes()
        parts, elements = Parts(self.path), _Elements(self.path)
        for dim, kind, own, nodes in self.blocks:
            places = self._places(numbers, nodes)
            ordered = places[:, _ORDERS[kind]] if kind in _ORDERS else places
            elements.add(dim, kind, own, ordered, parts.add(dim, kind, ordered))
        elements.close()
        self.there = {"ELSET": np.unique(np.concatenate(elements.numbers + self.left_out)), "NSET": numbers}
        for name in self._names("ELSET"):
            for dim, kind, rows, _ in elements.found(self._members("ELSET", name)):
                parts.join(dim, kind, rows, self._shown("ELSET", name))
        for name in self._names("NSET"):
            parts.gather(self._shown("NSET", name), _rows(numbers, self._members("NSET", name)))
        for surface in self.surfaces:
            self._add_surface(parts, numbers, elements, *surface)
        return parts, points

    def _nodes(self) -> tuple[IntArray, Array]:
        """Return the numbers (n,) of the nodes, ascending, and their places (n, 3)."""
        if not self.nodes:
            return _NONE, np.empty((0, 3))
        numbers, points = (np.concatenate(of) for of in zip(*self.nodes, strict=True))
        known, first, which = np.unique(numbers, return_index=True, return_inverse=True)
        if (twice := np.flatnonzero((points != points[first][which.reshape(-1)]).any(axis=1))).size:
            raise self.refuse(
                f"the node {numbers[twice[0]]} is there twice, at different places; give each node its own number"
            )
        return known, points[first]

    def _keywords(self) -> Iterator[tuple[str, dict[str, str], list[str]]]:
        """Yield each keyword in capitals, its parameters and its lines."""
        keyword, given, lines = "", dict[str, str](), list[str]()
        goes_on = False
        for line in decoded(self.path.read_bytes()).splitlines():
            if line.startswith("**") or not line.strip():
                continue
            if line.startswith("*") or goes_on:
                words = _words(line)
                if not goes_on:
                    yield keyword, given, lines
                    keyword, given, lines = " ".join(words.pop(0)[1:].upper().split()), {}, []
                for word in filter(None, words):
                    key, _, value = word.partition("=")
                    given[key.strip().upper()] = value.strip().strip('"')
                goes_on = line.rstrip().endswith(",")
            else:
                lines.append(line)
        yield keyword, given, lines

    def _take(self, keyword: str, given: dict[str, str], lines: list[str]) -> None:
        if keyword == "INCLUDE" or ("INPUT" in given and keyword in ("NODE", "ELEMENT", "NSET", "ELSET")):
            raise self.refuse(
                f"expected one file, got *{keyword} of another, which sha256 does not cover; put it in its place"
            )
        if keyword in _MAKING and (lines or keyword != "SYSTEM"):
            raise self.refuse(
                f"*{keyword} is not read; give all nodes and elements by their numbers, in Cartesian coordinates, or "
                "save the mesh as .msh or .med"
            )
        if keyword == "PART":
            self.parts.append(given.get("NAME", ""))
        elif keyword == "INSTANCE":
            self._instance(given, lines)
        elif keyword in ("ASSEMBLY", "END INSTANCE", "END ASSEMBLY"):
            self.in_assembly = keyword != "END ASSEMBLY"
        elif keyword == "NODE" and not self.in_assembly:
            self._take_nodes(given, lines)
        elif keyword == "ELEMENT":
            self._take_elements(given, lines)
        elif keyword in ("ELSET", "NSET"):
            self._take_set(keyword, given, lines)
        elif keyword == "SURFACE":
            if "COMBINE" in given:
                raise self.refuse(
                    f"the surface '{given.get('NAME', '')}' is made of others by COMBINE; give its elements and faces"
                )
            self.surfaces.append((given.get("NAME", ""), given.get("TYPE", "ELEMENT").upper(), lines))

    def _instance(self, given: dict[str, str], lines: list[str]) -> None:
        self.in_assembly = False
        self.instances.append(given.get("NAME", ""))
        if len(self.instances) > 1 or len(self.parts) > 1:
            raise self.refuse(
                f"expected one part and one instance of it, got {joined(map(echo, self.instances + self.parts))}; "
                "merge them into one, with the same nodes where they meet"
            )
        if any(float(word) != 0 for line in lines for word in _words(line) if word):
            raise self.refuse(
                f"the instance {echo(self.instances[0])} is moved; give the nodes of the part the places that they "
                "have, and no translation"
            )

    def _take_nodes(self, given: dict[str, str], lines: list[str]) -> None:
        if given.get("SYSTEM", "R").upper() != "R":
            raise self.refuse("the nodes have cylindrical or spherical coordinates; give them Cartesian ones")
        rows = [_words(line)[:4] for line in lines]
        own = np.array([row[0] for row in rows], dtype=np.int64)
        places = [[float(word.replace("D", "E").replace("d", "e") or 0) for word in row[1:]] for row in rows]
        self.nodes.append((own, np.array([[*row, 0.0, 0.0, 0.0][:3] for row in places]).reshape(-1, 3)))
        if "NSET" in given:
            self._set("NSET", given["NSET"]).numbers.append(own)

    def _take_elements(self, given: dict[str, str], lines: list[str]) -> None:
        type_ = given.get("TYPE", "").upper()
        dim, found = (3, _SOLID.match(type_)) if _SOLID.match(type_) else (2, _FACE.match(type_))
        kind = _KINDS[dim].get(int(found[1]) if found and type_ != "STRI65" else 6) if found else None
        if kind is None:
            if _LEFT_OUT.match(type_):
                first = [_words(line)[0] for line in lines]
                self.left_out.append(np.array([word for word in first if word.isdecimal()], dtype=np.int64))
                return
            raise self.refuse(
                f"expected elements of types that are read, got {type_ or 'no TYPE'}; leave these elements out, or "
                "save the mesh as .msh (gmsh) or .med"
            )
        n = next(count for count, name in _KINDS[dim].items() if name == kind)
        numbers = np.array(list(filter(None, chain.from_iterable(map(_words, lines)))), dtype=np.int64)
        if not len(numbers) or len(numbers) % (n + 1):
            raise self.refuse(
                f"expected elements of type {type_} as their number and {n} nodes each, got {len(numbers)} numbers "
                "in all"
            )
        rows = numbers.reshape(-1, n + 1)
        self.blocks.append((dim, kind, rows[:, 0], rows[:, 1:]))
        if "ELSET" in given:
            self._set("ELSET", given["ELSET"]).numbers.append(rows[:, 0])

    def _set(self, which: str, name: str) -> _Set:
        found = self.sets[which].setdefault((self.in_assembly, name.upper()), _Set(name))
        if found.name != name:
            raise self.refuse(
                f"the sets '{found.name}' and '{name}' are one set for Abaqus, which ignores capitals; rename one of "
                "them, or write the name of one set in one way"
            )
        return found

    def _take_set(self, which: str, given: dict[str, str], lines: list[str]) -> None:
        own = self._set(which, given.get(which, ""))
        own.hidden |= "INTERNAL" in given
        if which == "NSET" and "ELSET" in given:
            own.elements.append(given["ELSET"])
        words = [list(filter(None, _words(line))) for line in lines]
        of_mesh = not self.in_assembly or "INSTANCE" in given
        if "GENERATE" in given:
            for first, last, *step in ([int(word) for word in line] for line in words if of_mesh):
                span = np.arange(first, last + 1, step[0] if step else 1)
                own.ranges.append(span)
                own.numbers += [span[:1], span[-1:]]
            return
        members = list(chain.from_iterable(words))
        if of_mesh:
            own.numbers.append(np.array([word for word in members if word.isdecimal()], dtype=np.int64))
        own.others += [word.strip('"') for word in members if not word.isdecimal()]

    def _known(self, word: str) -> str:
        """Return a name as it is known: in capitals, without that of its instance."""
        first, dot, rest = word.upper().partition(".")
        return rest if dot and first in (name.upper() for name in self.instances) else word.upper()

    def _members(self, which: str, name: str, above: tuple[str, ...] = (), surface: str = "") -> IntArray:
        """Return the numbers (k,), ascending, of all members of a set and of the sets in it, or the one number.

        It is named by ``surface`` or by the last of the sets ``above`` it.
        """
        by = above[-1] if above else surface
        name = self._known(name)
        if name.isdecimal():
            return self._require_there(which, np.array([name], dtype=np.int64), by)
        own = [self.sets[which][key] for key in ((False, name), (True, name)) if key in self.sets[which]]
        if not own or name in above:
            why = "contains itself" if name in above else "is not there"
            of = f", to which '{by}' refers," if by else ""
            raise self.refuse(f"the set '{name}'{of} {why}; give it by its members' numbers")
        for each in own:
            each.numbers += [self._nodes_of(elements) for elements in each.elements]
        found: list[IntArray] = [
            np.unique(
                np.concatenate(
                    [
                        _NONE,
                        *(self._require_there(which, numbers, each.name) for numbers in each.numbers),
                        *(self.there[which][_rows(self.there[which], span)] for span in each.ranges),
                        *(self._members(which, other, (*above, name)) for other in each.others),
                    ]
                )
            )
            for each in own
        ]
        if len(found) == 2 and not np.array_equal(found[0], found[1]):
            raise self.refuse(
                f"the set '{own[0].name}' is in the part and in the assembly, with other members; rename one of them"
            )
        return found[0]

    def _require_there(self, which: str, numbers: IntArray, name: str) -> IntArray:
        """Return the numbers of members, which are refused where one is not in the file."""
        if len(_rows(self.there[which], numbers)) < len(numbers):
            strange = np.setdiff1d(numbers, self.there[which])
            what = "element" if which == "ELSET" else "node"
            raise self.refuse(
                f"the set or surface '{name}' has the {what} {strange[0]}, which is not there; take it out of the set, "
                f"or save the mesh with all {what}s"
            )
        return numbers

    def _nodes_of(self, name: str) -> IntArray:
        """Return the numbers of the nodes of the elements in a set."""
        members = self._members("ELSET", name)
        return np.concatenate(
            [_NONE, *(nodes[np.isin(own, members)].ravel() for _, _, own, nodes in self.blocks)]
        )

    def _names(self, which: str) -> list[str]:
        """Return the names, in capitals, of the sets that are meant for others than the program itself."""
        return list(dict.fromkeys(name for (_, name), own in self.sets[which].items() if not own.hidden))

    def _shown(self, which: str, name: str) -> str:
        return next(own.name for (_, known), own in self.sets[which].items() if known == name)

    def _places(self, numbers: IntArray, nodes: IntArray) -> IntArray:
        """Return the rows of nodes with numbers."""
        found = np.minimum(np.searchsorted(numbers, nodes), max(len(numbers) - 1, 0))
        if not len(numbers) or (strange := nodes[numbers[found] != nodes]).size:
            raise self.refuse(
                f"an element has the node {strange.flat[0] if len(numbers) else ''}, which is not there"
            )
        return np.asarray(found)

    def _add_surface(
        self, parts: Parts, numbers: IntArray, elements: _Elements, name: str, type_: str, lines: list[str]
    ) -> None:
        """Add the faces of elements, or the nodes, that *SURFACE names."""
        for what, *sides in map(_words, lines):
            if type_ == "NODE":
                parts.gather(name, _rows(numbers, self._members("NSET", what, surface=name)))
                continue
            side = sides[0].upper() if sides else ""
            for dim, kind, rows, nodes in elements.found(self._members("ELSET", what, surface=name)):
                if dim == 2:
                    parts.join(2, kind, rows, name)
                    continue
                of = _SIDES[_CORNERS.get(kind, 8)] if kind != "pyramid" else []
                if not re.fullmatch(r"S[1-6]", side) or int(side[1]) > len(of):
                    raise self.refuse(
                        f"the surface '{name}' has no face {echo(side)} of {kind} elements; give each face as S1, "
                        "S2, ..., with its element or set"
                    )
                face = of[int(side[1]) - 1]
                flat = "triangle" if len(face) == 3 else "quad"
                parts.join(2, flat, parts.add(2, flat, nodes[:, face]), name)


class _Elements:
    """Elements by their numbers."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.blocks: list[tuple[int, str, IntArray, IntArray]] = []
        self.numbers = [_NONE]

    def add(self, dim: int, kind: str, numbers: IntArray, nodes: IntArray, rows: IntArray) -> None:
        """Add a block of elements, with their rows among all of their kind."""
        self.blocks.append((dim, kind, rows, nodes))
        self.numbers.append(numbers)

    def close(self) -> None:
        """Sort the numbers.

        Raises
        ------
        ConfigurationError
            Two elements have the same.
        """
        joint = np.concatenate(self.numbers)
        self.order = np.argsort(joint, kind="stable")
        self.sorted = joint[self.order]
        if (twice := np.flatnonzero(self.sorted[1:] == self.sorted[:-1])).size:
            raise ConfigurationError(
                f"{self.path}: the element {self.sorted[twice[0]]} is there twice; give each element its own number"
            )
        self.ends = np.cumsum([len(of) for of in self.numbers])

    def found(self, members: IntArray) -> Iterator[tuple[int, str, IntArray, IntArray]]:
        """Yield dimension, kind, rows and nodes of the elements with numbers, block by block."""
        at = np.sort(self.order[_rows(self.sorted, members)])
        for (dim, kind, rows, nodes), (first, last) in zip(self.blocks, pairwise(self.ends), strict=True):
            own = at[(at >= first) & (at < last)] - first
            if len(own):
                yield dim, kind, rows[own], nodes[own]


_NONE: IntArray = np.empty(0, dtype=np.int64)


def _words(line: str) -> list[str]:
    return [word.strip() for word in line.strip().split(",")]


def _rows(numbers: IntArray, wanted: IntArray) -> IntArray:
    """Return the places in ascending numbers of those that are there."""
    if not len(numbers):
        return _NONE
    at = np.minimum(np.searchsorted(numbers, wanted), len(numbers) - 1)
    return np.asarray(at[numbers[at] == wanted])
