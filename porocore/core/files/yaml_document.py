"""Reading of a YAML file of bounded size and depth, with the line of each key (YamlDocument)."""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

from porocore.core.echo import MOST, cut, echo, echo_path
from porocore.core.files.reading import read_text
from porocore.core.files.slices import told_by
from porocore.errors import ConfigurationError

#: Bytes of a file; keys, values and sections, with aliases spelt out; sections within sections; characters of a number.
MOST_BYTES, MOST_NODES, DEEPEST, LONGEST_NUMBER = 1_000_000, 50_000, 30, 60
TOO_MANY = f"more than {MOST_NODES} keys and values, aliases spelt out"
#: Written so, a number is hardly meant as YAML reads it: 1:30 is 90, and 010 is 8.
_OTHER_BASE = re.compile(r"[-+]?(\d[\d_]*(:[\d.]+)+|0[0-7_]+)")
#: Tags of whole and other numbers, of text, and of true and false.
NUMBERS, TEXT = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float"), "tag:yaml.org,2002:str"
SWITCH = "tag:yaml.org,2002:bool"
#: A whole number that is written in one way only.
_PLAIN = re.compile(r"0|-?[1-9]\d{0,17}")
#: The halves of a number with a decimal comma, of which the second may have a unit.
_INTEGER, _DECIMALS = re.compile(r"[-+]?\d+"), re.compile(r"\d+([eE][-+]?\d+)?(\s*[^\W\d].*)?", re.S)


def load(text: str) -> tuple[yaml.Node | None, Any]:
    """Return the root node of a document with its line numbers, and the plain data that it stands for.

    A key that is a plain whole number is text.

    Raises
    ------
    Refused
        It is beyond a bound of this module.
    yaml.YAMLError
        It is not YAML.
    """
    loader = _BoundedLoader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None, None
        _count(node, {}, set())
        return node, loader.construct_document(node)
    finally:
        loader.dispose()


class Refused(yaml.MarkedYAMLError):
    """YAML, but beyond a bound of this module or with a value that does not exist; ``problem`` and mark are given."""


class _BoundedLoader(yaml.SafeLoader):
    """Refuses depth, number of nodes and long numbers on the way, so that nothing is built of them."""

    _depth = _nodes = 0

    def _here(self) -> Any:
        return self.peek_event().start_mark  # type: ignore[no-untyped-call]

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        self._depth += 1
        self._nodes += 1
        if self._depth > DEEPEST:
            problem = f"sections are nested more than {DEEPEST} levels deep"
            raise Refused(problem=problem, problem_mark=self._here())
        if self._nodes > MOST_NODES:
            raise Refused(problem=TOO_MANY, problem_mark=self._here())
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        if node.tag in NUMBERS and len(node.value) > LONGEST_NUMBER:
            raise _fault(node, f"a number of {len(node.value)} characters; at most {LONGEST_NUMBER} are read")
        try:
            found = super().construct_object(node, deep)
        except (ValueError, OverflowError, TypeError) as error:
            raise _fault(node, f"{error} ('{cut(str(node.value))}')") from None
        if node.tag in NUMBERS and _OTHER_BASE.fullmatch(node.value):
            base = 60 if ":" in node.value else 8
            raise _fault(
                node,
                f"'{node.value}' is the number {found:g} to base {base} in YAML, which is hardly meant; "
                f"write {found:g}, a value with a unit such as 90 min, or text in quotes",
            )
        return found


def _fault(node: yaml.Node, problem: str) -> Refused:
    return Refused(problem=problem, problem_mark=node.start_mark)


def _count(node: yaml.Node, known: dict[int, int], above: set[int]) -> int:
    """Return the number of nodes with every alias spelt out.

    Raises
    ------
    Refused
        They are too many, or an alias contains itself.
    """
    if id(node) in above:
        raise _fault(node, "an alias that contains itself; spell it out")
    if id(node) in known:
        return known[id(node)]
    children: list[yaml.Node] = []
    if isinstance(node, yaml.MappingNode):
        children = [part for pair in node.value for part in pair]
        for i, (key, value) in enumerate(node.value):
            # A tag of a mesh names a region or a surface, with quotes or without.
            if key.tag == NUMBERS[0] and (
                _PLAIN.fullmatch(key.value)
                or (i and node.flow_style and _decimal(node.value[i - 1], key, value))
            ):
                key.tag = TEXT
    elif isinstance(node, yaml.SequenceNode):
        children = node.value
        for first, second in pairwise(children):
            if (number := _halves(first, second)) and re.match(r"0\d", second.value):
                raise _fault(
                    first,
                    f"commas separate the entries of a list, decimals stand after a point; if '{number}' was meant as "
                    f"one number, write {number.replace(',', '.')}, else leave out the 0 in front of "
                    f"'{cut(second.value)}'",
                )
    above.add(id(node))
    count = 1
    for child in children:
        count += _count(child, known, above)
        if count > MOST_NODES:
            raise _fault(node, TOO_MANY)
    above.discard(id(node))
    known[id(node)] = count
    return count


#: Where something stands in a document: keys and list positions, as text.
Location = tuple[str, ...]
#: Bytes at the beginning of a file in which a null byte means that it is no text.
_HEAD = 4096
_NO_TEXT = "expected a configuration, which is YAML text, got a file that is no text; give another file"
#: Words for what YAML reads that is no text.
_READ_AS = {
    "null": "no value",
    "int": "a number",
    "float": "a number",
    "timestamp": "a date",
    "seq": "a list",
    "map": "a section",
}
_KINDS: dict[type, str] = {str: "text", int: "number", float: "number", list: "list"}


def dotted(location: Location) -> str:
    """Return a location as messages name it, ``cell.geometry.radius``; a long key is cut, and an empty one is ''."""
    return ".".join(cut(part) or "''" for part in location)


@dataclass(frozen=True, eq=False)
class YamlDocument:
    """The mapping that a file holds, or settings from elsewhere.

    Attributes
    ----------
    path
        The file; None: the data does not come from one.
    data
        Its content, of plain types only.
    lines
        Line of every key and list entry, counted from 1; the document itself is the empty location.
    folder
        Where relative paths in it start.
    switches
        As it stands in the file, each value that YAML reads as true or false, such as ``yes``.
    """

    path: Path | None
    data: dict[str, Any]
    lines: dict[Location, int]
    folder: Path
    switches: dict[Location, str] = field(default_factory=dict)

    @classmethod
    def of(cls, settings: Mapping[str, Any], folder: Path) -> YamlDocument:
        """Return the document of nested settings; all of them are on line 0.

        Raises
        ------
        ConfigurationError
            A key is no text.
        """
        data = _with_text_keys(settings, ())
        return cls(None, data, dict.fromkeys(_locations(data, ()), 0), folder)

    @classmethod
    def read(cls, path: Path) -> YamlDocument:
        """Read one YAML file.

        Raises
        ------
        ConfigurationError
            It cannot be read, is not YAML, does not hold a mapping, or gives a key twice.
        """
        text = _text(path)
        try:
            node, data = load(text)
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            raise ConfigurationError(_other_kind(path) or _not_yaml(path, text, error)) from None
        if not isinstance(data, dict):
            found = "an empty file" if data is None else f"a {_KINDS.get(type(data), 'single value')}"
            raise ConfigurationError(
                _other_kind(path) or f"{path}: expected sections such as 'cell:' and 'macro:', got {found}"
            )
        lines: dict[Location, int] = {}
        switches: dict[Location, str] = {}
        refused = list(_record(node, (), lines, switches))
        if refused:
            raise ConfigurationError("\n".join(f"{path}:{line}: {text}" for line, text in refused))
        return cls(path, data, lines, path.parent, switches)

    def __contains__(self, location: Location) -> bool:
        return location in self.lines

    def line(self, location: Location) -> int:
        """Return the line of a location, or of the nearest enclosing one in the file."""
        while location not in self.lines:
            location = location[:-1]
        return self.lines[location]

    def at_line(self, line: int) -> str:
        """Return how a message about a line begins."""
        return f"{self.path}:{line}" if self.path is not None else "settings"

    def value(self, location: Location) -> Any:
        """Return the value at a location."""
        value: Any = self.data
        for part in location:
            value = (
                value[int(part)]
                if isinstance(value, list | tuple)
                else {str(k): v for k, v in value.items()}[part]
            )
        return value


def leaves(data: Any, at: Location = ()) -> Iterator[tuple[Location, Any]]:
    """Yield all plain values in nested mappings and lists with their locations."""
    if isinstance(data, Mapping):
        for key, value in data.items():
            yield from leaves(value, (*at, str(key)))
    elif isinstance(data, list | tuple):
        for i, value in enumerate(data):
            yield from leaves(value, (*at, str(i)))
    else:
        yield at, data


def _with_text_keys(value: Any, at: Location) -> Any:
    """Return nested settings whose keys that are whole numbers are text, as in a file; others are refused."""
    if isinstance(value, Mapping):
        found = {}
        for key, below in value.items():
            name = str(key)
            if not isinstance(key, str | int) or isinstance(key, bool):
                raise ConfigurationError(
                    f"settings: {dotted((*at, name))}: expected a key that is a text, got {echo(key)}; write "
                    f"{cut(repr(name))}"
                )
            found[name] = _with_text_keys(below, (*at, name))
        return found
    if isinstance(value, list):
        return [_with_text_keys(below, (*at, str(i))) for i, below in enumerate(value)]
    return value


def _locations(value: Any, at: Location) -> Iterator[Location]:
    yield at
    if isinstance(value, Mapping):
        for key, below in value.items():
            yield from _locations(below, (*at, key))
    elif isinstance(value, list | tuple):
        for i, below in enumerate(value):
            yield from _locations(below, (*at, str(i)))


def _text(path: Path) -> str:
    """Return what a configuration file holds; what cannot be read is a :class:`ConfigurationError`."""
    try:
        return read_text(path, MOST_BYTES)
    except FileNotFoundError as error:
        raise ConfigurationError(
            f"{path}: {error.strerror}; give the path of a configuration; 'porocore init' writes one to start from"
        ) from None
    except IsADirectoryError:
        raise ConfigurationError(f"{path}: expected a configuration file, got a folder") from None
    except UnicodeDecodeError as error:
        raise ConfigurationError(_other_kind(path) or f"{path}{_other_encoding(error)}") from None
    except OSError as error:
        other = _other_kind(path) if error.errno == errno.EFBIG else ""
        raise ConfigurationError(
            other or f"{echo_path(path)}: cannot be read: {error.strerror or error}"
        ) from None


def _other_kind(path: Path) -> str:
    """Return the complaint about a file that is no text by its first bytes; empty where they do not tell it."""
    kind = told_by(path)
    if kind is None or kind.name == "text":
        return ""
    wanted = "expected a configuration, which is YAML text"
    return f"{path}: {wanted}, got {kind.name} by its first bytes; give another file"


def _not_yaml(path: Path, text: str, error: Exception) -> str:
    """Return the complaint about a text that is not YAML, or beyond a bound of this module."""
    if isinstance(error, yaml.reader.ReaderError):
        line = text.count("\n", 0, error.position) + 1
        sign = chr(int(error.character))
        if sign == "\0" and text.count(sign) > len(text) / 10:
            return f"{path}: {_NO_TEXT}"
        return f"{path}:{line}: expected YAML text, got the control character {sign!a}; remove it"
    if not isinstance(error, yaml.MarkedYAMLError):
        why = cut(" ".join(str(error).split()), 2 * MOST)
        return f"{path}: not valid YAML: {why}; check indentation, colons and quotes"
    mark = error.problem_mark or error.context_mark
    where = f"{path}:{mark.line + 1}" if mark else f"{path}"
    if mark and "\t" in _indentation(text, mark.line):
        return (
            f"{where}: expected an indentation by spaces, got a tab, which YAML does not take there; replace each tab "
            "at the beginning of a line by two spaces"
        )
    if "'\\t'" in (error.problem or ""):
        return (
            f"{where}: expected a space, got a tab, which YAML does not take there; replace each tab of the line by a "
            "space"
        )
    if isinstance(error, Refused):
        return f"{where}: {error.problem}"
    context = f"{error.context}, " if error.context else ""
    return (
        f"{where}: not valid YAML: {cut(context + (error.problem or ''), 2 * MOST)}; check indentation, colons and "
        "quotes on this line and the one above"
    )


def _indentation(text: str, line: int) -> str:
    """Return the white space at the beginning of a line, counted from 0."""
    lines = text.splitlines()
    return "" if line >= len(lines) else lines[line][: -len(lines[line].lstrip()) or None]


def _other_encoding(error: UnicodeDecodeError) -> str:
    """Return the line, where there are any, and what is wrong in a text that is no UTF-8."""
    data, at = error.object, error.start
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return ": expected YAML text in UTF-8, got UTF-16; save the file as UTF-8"
    if b"\0" in data[:_HEAD]:
        return f": {_NO_TEXT}"
    line, byte = data.count(b"\n", 0, at) + 1, data[at : at + 1]
    as_text = byte.decode("cp1252", "replace")
    meant = f", which is '{as_text}' in Latin-1 (Windows-1252)" if as_text.isprintable() else ""
    return f":{line}: expected YAML text in UTF-8, got the byte 0x{byte.hex()}{meant}; save the file as UTF-8"


def _record(
    node: Any, location: Location, lines: dict[Location, int], switches: dict[Location, str]
) -> Iterator[tuple[int, str]]:
    """Note the line of every key below ``node``, which contains no alias of itself, and the text of every switch.

    Yields
    ------
    line, text
        Of each key that is no text or is given twice.
    """
    lines.setdefault(location, node.start_mark.line + 1)
    if node.tag == SWITCH:
        switches[location] = node.value
    if isinstance(node, yaml.MappingNode):
        own: dict[str, int] = {}
        before: tuple[Any, Any] | None = None
        for key, value in node.value:
            name, line = str(key.value), key.start_mark.line + 1
            at = (*location, name)
            if key.tag != TEXT:
                yield line, f"{dotted(at)}: {_no_text(key)}"
            elif node.flow_style and before is not None and (meant := _decimal(before, key, value)):
                yield line, f"{dotted((*location, str(before[0].value)))}: {meant}"
            # Keys merged in by '<<' stand before the node's own and may be overridden.
            elif name in own and own[name] >= node.start_mark.line + 1:
                yield line, f"{dotted(at)}: given twice, first on line {own[name]}; keep one"
            own[name] = line
            lines[at], before = line, (key, value)
            yield from _record(value, at, lines, switches)
    elif isinstance(node, yaml.SequenceNode):
        for i, value in enumerate(node.value):
            yield from _record(value, (*location, str(i)), lines, switches)


def _no_text(key: Any) -> str:
    """Return what is wrong with a key that YAML does not read as text, and the advice."""
    _, _, kind = key.tag.rpartition(":")
    written = cut(str(key.value)) or "?"
    return (
        f"expected a key that is a text, but YAML reads {written} as {_read_as(kind, written)}; "
        f"write the key in quotes, as '{written}'"
    )


def _read_as(kind: str, written: str) -> str:
    """Return the value that YAML makes of a key of another kind."""
    if kind == "bool":
        return "true" if written.lower() in {"y", "yes", "on", "true"} else "false"
    return _READ_AS.get(kind, "another kind of value")


def _halves(first: Any, second: Any) -> str:
    """Return the number with a decimal comma of which two neighbours may be the halves; empty where they are none."""
    if not all(isinstance(half, yaml.ScalarNode) and half.style is None for half in (first, second)):
        return ""
    if not (_INTEGER.fullmatch(first.value) and _DECIMALS.fullmatch(second.value)):
        return ""
    return f"{cut(first.value)},{cut(second.value)}"


def _decimal(before: tuple[Any, Any], key: Any, value: Any) -> str:
    """Return the advice on a number with a decimal comma within braces, of which YAML makes two entries; empty: none.

    ``before`` are the key and the value in front of ``key``.
    """
    if value.value or not (number := _halves(before[1], key)):
        return ""
    name = cut(before[0].value)
    return (
        f"got the key '{cut(key.value)}' without a value, since a comma within braces ends an entry; if "
        f"'{name}: {number}' was meant as a number, write '{name}: {number.replace(',', '.')}'"
    )
