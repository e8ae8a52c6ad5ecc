"""YAML loader with bounds on size, depth, aliases and numbers, so that no file can take all memory."""

from __future__ import annotations

import re
from typing import Any

import yaml

from porocore.core.echo import cut

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
        for key, _ in node.value:
            if key.tag == NUMBERS[0] and _PLAIN.fullmatch(key.value):
                key.tag = TEXT  # a tag of a mesh names a region or a surface, with quotes or without
    elif isinstance(node, yaml.SequenceNode):
        children = node.value
    above.add(id(node))
    count = 1
    for child in children:
        count += _count(child, known, above)
        if count > MOST_NODES:
            raise _fault(node, TOO_MANY)
    above.discard(id(node))
    known[id(node)] = count
    return count
