"""Words with which no message may end or speak: an empty list, a count of 0, an exception's own text."""

from __future__ import annotations

import re

#: Ends of a line behind which something is missing.
_OPEN_END = re.compile(r"(?:[:;,(]| (?:are|is|of|and|or|has|have|holds|nothing)|\b(?:are|is) (?:none|0))\s*$")
#: A count of 0, of which nothing can be said.
_OF_NONE = re.compile(r"(?:^|[:;,] )0 [a-z ]*\b(?:nodes|elements|facets|voxels|states|points)\b")
#: What Python says of its own objects, and names of its exceptions.
_OF_PYTHON = re.compile(
    r"\b(?:[A-Z]\w*(?:Error|Exception|Exit|Interrupt)\b(?!:)(?:\(|\))|\(SystemExit\)"
    r"|values to unpack|object (?:is not|has no|cannot be)|need at least one array|list index out of range"
    r"|\[Errno|unsupported operand|NoneType|could not be broadcast|argument must be)"
)


def assert_says_all(message: str) -> None:
    """Hold each line of a message to words: it ends in something, and repeats no exception.

    Parameters
    ----------
    message
        As it was printed on standard error.
    """
    for line in message.splitlines():
        text = line.strip(" │╭╮╰╯─")
        assert not _OF_PYTHON.search(text), text
        assert not _OF_NONE.search(text), text
    last = " ".join(message.split()).strip(" │╭╮╰╯─")
    assert not _OPEN_END.search(last), last
