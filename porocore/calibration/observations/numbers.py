"""Numbers of the columns of a table (read_columns): decimal points or commas, groups of three digits, no guess."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property

import numpy as np

from porocore.calibration.observations.clock import CLOCK
from porocore.core.echo import echo
from porocore.errors import ConfigurationError
from porocore.states import Array

POINT, COMMA = ".", ","
WORDS = {POINT: "decimal points", COMMA: "decimal commas"}
_OTHER = {POINT: COMMA, COMMA: POINT}
#: One sign for each kind: minus signs, blanks that keep digits together, apostrophes.
_SAME = str.maketrans("−\u00a0\u2009\u202f’", "-   '")


def _pattern(mark: str) -> re.Pattern[str]:
    """Return the pattern of numbers with a decimal mark; Python's ``float`` also takes 1_000 and digits of others."""
    of, other = re.escape(mark), re.escape(_OTHER[mark])
    plain = rf"(?:[0-9]+(?:{of}[0-9]*)?|{of}[0-9]+)(?:[eE][+-]?[0-9]+)?"
    grouped = rf"[1-9][0-9]{{0,2}}(?P<group>[{other}' ])[0-9]{{3}}(?:(?P=group)[0-9]{{3}})*(?:{of}[0-9]*)?"
    return re.compile(rf"[+-]?(?:{plain}|{grouped})")


_PATTERNS = {mark: _pattern(mark) for mark in (POINT, COMMA)}


@dataclass(frozen=True)
class Entry:
    """Text of a cell of a table, and the numbers that it may be.

    Attributes
    ----------
    text
        As it stands in the file.
    readings
        By decimal mark, the number as Python writes it; marks with which the text is no number are left out.
    """

    text: str
    readings: dict[str, str]

    @classmethod
    def read(cls, text: str) -> Entry:
        """Return the entry with all of its readings; a clock time is the number of its last place."""
        plain = text.strip().translate(_SAME)
        if (clock := CLOCK.fullmatch(plain)) is not None:
            seconds = str(60 * (60 * int(clock["h"] or 0) + int(clock["m"])) + int(clock["s"]))
            of, places = (clock["f"] or "")[:1], (clock["f"] or "")[1:]
            marks = (of,) if of else WORDS
            return cls(text, {mark: f"{seconds}.{places}" if of else seconds for mark in marks})
        if plain.isascii() and plain.isdigit():
            return cls(text, {POINT: plain, COMMA: plain})
        found = {}
        for mark, pattern in _PATTERNS.items():
            if pattern.fullmatch(plain):
                digits = "".join(c for c in plain if c not in f" '{_OTHER[mark]}")
                if math.isfinite(float(digits.replace(mark, POINT))):
                    found[mark] = digits.replace(mark, POINT)
        return cls(text, found)

    @property
    def is_number(self) -> bool:
        """True where it is a number with one decimal mark at least."""
        return bool(self.readings)

    @property
    def is_ambiguous(self) -> bool:
        """True where it is two different numbers, such as 1,234."""
        return len(set(self.readings.values())) > 1

    @property
    def only_mark(self) -> str | None:
        """The decimal mark, where it is a number with no other; None: it is none with any, or tells nothing."""
        return next(iter(self.readings)) if len(self.readings) == 1 else None

    @property
    def group(self) -> str | None:
        """The point or comma that can only stand between groups of three digits; None: there is none."""
        mark = self.only_mark
        return None if mark is None or _OTHER[mark] not in self.text else _OTHER[mark]


@dataclass(frozen=True, eq=False)
class TextColumn:
    """Texts of one column of a table.

    Attributes
    ----------
    name
        Its heading.
    texts, lines
        Of its n cells, and their lines in the file.
    clock
        They may be clock times.
    """

    name: str
    texts: Sequence[str]
    lines: Sequence[int]
    clock: bool = False

    @cached_property
    def entries(self) -> list[Entry]:
        """The n entries."""
        return [Entry.read(text) for text in self.texts]

    @cached_property
    def marks(self) -> set[str]:
        """Decimal marks of entries that are numbers with no other."""
        return {mark for entry in self.entries if (mark := entry.only_mark)}

    @cached_property
    def groups(self) -> set[str]:
        """Points or commas that can only stand between groups of three digits."""
        return {group for entry in self.entries if (group := entry.group)}


@dataclass(frozen=True, eq=False)
class Numbers:
    """Numbers of one column, each as Python writes it."""

    texts: tuple[str, ...]

    @property
    def values(self) -> Array:
        """The n numbers."""
        return np.array([float(text) for text in self.texts])

    @property
    def last_place(self) -> float:
        """Unit of the last digit of that number which has most decimals."""
        exponents = [Decimal(text).as_tuple().exponent for text in self.texts]
        return float(Decimal(1).scaleb(min(e for e in exponents if isinstance(e, int))))


def read_columns(
    where: str, columns: Sequence[TextColumn], separator: str, decimal: str | None = None
) -> list[Numbers]:
    """Return the numbers of some columns of one table.

    The decimal mark of a column is that with which all of its entries are numbers. Where both are possible, as for
    1,234, it is that of the other columns, or the point where commas separate entries and all of the column have a
    point. A point or comma is taken for one between groups of three digits only where it can be nothing else at
    another place of the column, or, in a column without decimals, of another one.

    Parameters
    ----------
    where
        The file, for messages.
    columns
        With one number of entries.
    separator
        Sign between the entries of a line.
    decimal
        The decimal mark; None: it is found.

    Raises
    ------
    ConfigurationError
        An entry is no finite number, two of a column have different decimal marks, or it may be two numbers. The
        message names the line.
    """
    marks = {mark for column in columns for mark in column.marks}
    groups = {group for column in columns for group in column.groups}
    return [_read(where, column, marks, groups, separator, decimal) for column in columns]


def _read(
    where: str, column: TextColumn, marks: set[str], groups: set[str], separator: str, decimal: str | None
) -> Numbers:
    _require_numbers(where, column)
    own = column.marks
    if decimal is None and len(own) == 2:
        raise _contradiction(where, column)
    mark = decimal or (next(iter(own)) if own else _mark_of_others(column, marks, separator))
    found = []
    for line, entry in zip(column.lines, column.entries, strict=True):
        if entry.is_ambiguous:
            grouped = mark is not None and mark not in entry.text
            seen = _OTHER.get(mark or "") in (column.groups if own else groups - marks)
            if mark is None or (grouped and not seen and (decimal is None or own)):
                raise _ambiguity(f"{where}:{line}: {column.name}", entry, mark if own else None)
        if (text := entry.readings.get(mark or POINT)) is None:
            raise ConfigurationError(
                f"{where}:{line}: {column.name}: expected a number with {WORDS[mark or POINT]}, as the key 'decimal' "
                f"says, got {echo(entry.text)}; change the key, or the number"
            )
        found.append(text)
    return Numbers(tuple(found))


def _mark_of_others(column: TextColumn, marks: set[str], separator: str) -> str | None:
    """Return the decimal mark of a column that does not show its own; None: it cannot be known."""
    if marks:
        return next(iter(marks)) if len(marks) == 1 else None
    # A comma separates here. Numbers in groups would have some below a thousand among them, without a point.
    return POINT if separator == COMMA and all(POINT in text for text in column.texts) else None


def _require_numbers(where: str, column: TextColumn) -> None:
    for line, entry in zip(column.lines, column.entries, strict=True):
        if not entry.is_number or (":" in entry.text and not column.clock):
            at = f"{where}:{line}: {column.name}"
            raise ConfigurationError(
                f"{at}: expected a finite number, got {echo(entry.text)}; {_advice(entry.text)}"
            )


def _advice(text: str) -> str:
    if re.fullmatch(r".*\d+:\d\d.*", text):
        return "times count from the beginning of the test; write them in one unit, such as seconds, or as hh:mm:ss"
    if re.search(r"\d", text):
        return "remove the row, or write the number alone, with a decimal point or comma"
    if text.strip() == "":
        return "remove the row, or leave out rows with empty cells by 'missing: [\"\"]'"
    if len(text) <= 12:
        return f"remove the row, or leave out rows with this text by 'missing: [{text!r}]'"
    return "remove the row"


def _contradiction(where: str, column: TextColumn) -> ConfigurationError:
    """Return the complaint about the first entry with the rarer decimal mark of a column that has both."""
    by_mark: dict[str, list[tuple[int, str]]] = {POINT: [], COMMA: []}
    for line, entry in zip(column.lines, column.entries, strict=True):
        if (mark := entry.only_mark) is not None:
            by_mark[mark].append((line, entry.text))
    most = max(by_mark, key=lambda mark: (len(by_mark[mark]), -by_mark[mark][0][0]))
    (line, text), (other_line, other) = by_mark[_OTHER[most]][0], by_mark[most][0]
    return ConfigurationError(
        f"{where}:{line}: {column.name}: expected {WORDS[most]}, as in {echo(other)} in line {other_line}, got "
        f"{echo(text)}; write all numbers of the column alike"
    )


def _ambiguity(at: str, entry: Entry, mark: str | None) -> ConfigurationError:
    small, large = sorted(entry.readings.values(), key=lambda text: abs(float(text)))
    beginning = f"{at}: {echo(entry.text)} may be {small} or {large}"
    if mark is not None:
        return ConfigurationError(
            f"{beginning}, since the column has {WORDS[mark]} elsewhere; write all numbers of the column alike"
        )
    decimal = next(mark for mark, text in entry.readings.items() if text == small)
    return ConfigurationError(
        f"{beginning}, and nothing in the columns that are read tells which; add \"decimal: '{decimal}'\" for {small}, "
        f"or \"decimal: '{_OTHER[decimal]}'\" for {large}"
    )
