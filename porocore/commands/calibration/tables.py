"""Tables of measured numbers from CSV files: encoding, headings, units, columns of numbers, faults."""

from __future__ import annotations

import codecs
import csv
import math
import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property
from pathlib import Path

import numpy as np

from porocore.commands.calibration.observations import is_unit
from porocore.commands.calibration.settings import MOST_POINTS
from porocore.core.echo import echo, echo_path, joined, suggestion
from porocore.core.files.reading import LARGEST_TEXT, require_ordinary
from porocore.core.units import ADD_SCALES
from porocore.errors import ConfigurationError
from porocore.states import Array

#: First bytes of a text, and its encoding; those of UTF-32 begin like those of UTF-16.
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
#: First bytes of files that are no text, and what they are.
_OTHERS = (
    (b"PK\x03\x04", "an Excel workbook or another ZIP archive"),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook"),
    (b"%PDF", "a PDF"),
    (b"\x89HDF", "an HDF5 file"),
)
#: Latin-1 with the quotation marks of Windows, taken where a text is no UTF-8.
GUESS = "Windows-1252"


def decoded_text(path: Path, encoding: str | None = None, largest: int = LARGEST_TEXT) -> tuple[str, str]:
    """Return the text of a file without a mark of its encoding, and the encoding where it is a guess.

    Without ``encoding`` it is that of the mark at the beginning, or UTF-16 where every other byte is zero, or UTF-8,
    or else Windows-1252, of which Latin-1 is a part. Digits, signs and separators are the same in all encodings of one
    byte a letter, so a wrong guess changes letters of headings and units, and no number.

    Parameters
    ----------
    path
        The file.
    encoding
        Python's name of the encoding; None: it is found.
    largest
        Size of a file that is read [bytes].

    Returns
    -------
    text, guess
        ``guess`` is empty where the encoding is certain.

    Raises
    ------
    ConfigurationError
        The file cannot be read, is no text, or is not in the encoding.
    """
    data = _data(path, largest)
    for begin, kind in _OTHERS:
        if data.startswith(begin):
            raise ConfigurationError(f"{path}: expected a CSV file, got {kind}; save the table as CSV")
    marked = next(((mark, name) for mark, name in _MARKS if data.startswith(mark)), None)
    if marked is not None:
        mark, name = marked
        if encoding is not None and not _is_same(encoding, name):
            raise ConfigurationError(
                f"encoding: expected {_family(name)}, by the first bytes of {path}, got {echo(encoding)}; "
                "remove the key"
            )
        return _decoded(path, data[len(mark) :], name), ""
    if encoding is not None:
        return _decoded(path, data, encoding), ""
    if b"\0" in data:
        return _decoded(path, data, _utf_16(path, data)), ""
    try:
        return data.decode("utf-8"), ""
    except UnicodeDecodeError:
        return _decoded(path, data, "cp1252"), GUESS


def _is_same(encoding: str, marked: str) -> bool:
    """Return whether a text in an encoding may begin with the mark of another, as utf-16 with that of utf-16-le."""
    name = codecs.lookup(encoding).name.removesuffix("-sig")
    return name in (marked, _family(marked))


def _family(name: str) -> str:
    """Return the name of an encoding without the order of its bytes."""
    return name.removesuffix("-le").removesuffix("-be")


def _data(path: Path, largest: int) -> bytes:
    try:
        require_ordinary(path, largest)
        return path.read_bytes()
    except FileNotFoundError as error:
        raise ConfigurationError(
            f"{echo_path(path)}: {error.strerror}; give the CSV file of the curve"
        ) from None
    except IsADirectoryError:
        raise ConfigurationError(f"{echo_path(path)}: expected a CSV file, got a folder") from None
    except OSError as error:
        raise ConfigurationError(f"{echo_path(path)}: cannot be read: {error.strerror or error}") from None


def _utf_16(path: Path, data: bytes) -> str:
    """Return the encoding of a text with zero bytes and no mark."""
    zeros = data[::2].count(0), data[1::2].count(0)
    if len(data) % 2 == 0 and min(zeros) == 0 and max(zeros) > 0.3 * len(data) / 2:
        return "utf-16-le" if zeros[0] == 0 else "utf-16-be"
    line = data[: data.index(b"\0")].count(b"\n") + 1
    raise ConfigurationError(
        f"{path}:{line}: expected text, got a null byte, which is part of no text; save the table as CSV again"
    )


def _decoded(path: Path, data: bytes, encoding: str) -> str:
    try:
        return data.decode(encoding).removeprefix("\ufeff")
    except UnicodeError as error:
        before = data[: getattr(error, "start", 0)].decode(encoding, errors="replace")
        line = len(f"{before}.".splitlines())
        wanted = (
            "UTF-8, UTF-16 or Windows-1252 (Latin-1)" if encoding == "cp1252" else f"the encoding {encoding}"
        )
        raise ConfigurationError(
            f"{path}:{line}: expected text in {wanted}, got bytes that are none; name the encoding with 'encoding:', "
            "such as cp850 or mac-roman, or save the file as UTF-8"
        ) from None


#: Hours may go on beyond a day, and minutes beyond an hour where no hours stand before them.
CLOCK = re.compile(
    r"(?:(?P<h>[0-9]{1,9}):(?=[0-5][0-9]:))?(?P<m>[0-9]{1,9}):(?P<s>[0-5][0-9])(?P<f>[.,][0-9]+)?"
)
#: What spreadsheets and machines write in the place of a unit, such as hh:mm:ss, [h]:mm:ss, mm:ss,000.
_FORMAT = re.compile(r"\[?(?:(h+|std):)?\[?(m+|min)\]?:(s+|sec|sek)(?:[.,]\w+)?|\[?(h+|std)\]?:(m+|min)")


def clock_format(unit: str) -> str:
    """Return ``s`` for a format of seconds such as hh:mm:ss, ``min`` for one such as hh:mm, and else nothing."""
    found = _FORMAT.fullmatch(unit.strip().lower().replace("]:", ":"))
    return "" if found is None else "s" if found[3] else "min"


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
        """The decimal mark, where it is a number with no other; None: it is none with any, or ambiguous."""
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
    path, name
        The file, and the heading of the column.
    texts, lines
        Of its n cells, and their lines in the file.
    clock
        They may be clock times.
    """

    path: Path
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

    def at(self, k: int) -> str:
        """Return where an entry stands, for messages."""
        return f"{self.path}:{self.lines[k]}: {self.name}"


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


def _read(
    column: TextColumn, marks: set[str], groups: set[str], separator: str, decimal: str | None
) -> Numbers:
    """Return the numbers of a column; ``marks`` and ``groups`` are those of all columns that are read."""
    _require_numbers(column)
    own = column.marks
    if decimal is None and len(own) == 2:
        raise _contradiction(column)
    mark = decimal or (next(iter(own)) if own else _mark_of_others(column, marks, separator))
    found = []
    for k, entry in enumerate(column.entries):
        if entry.is_ambiguous:
            grouped = mark is not None and mark not in entry.text
            seen = _OTHER.get(mark or "") in (column.groups if own else groups - marks)
            if mark is None or (grouped and not seen and (decimal is None or own)):
                raise _ambiguity(column.at(k), entry, mark if own else None)
        if (text := entry.readings.get(mark or POINT)) is None:
            raise ConfigurationError(
                f"{column.at(k)}: expected a number with {WORDS[mark or POINT]}, as the key 'decimal' says, got "
                f"{echo(entry.text)}; change the key, or the number"
            )
        found.append(text)
    return Numbers(tuple(found))


def _mark_of_others(column: TextColumn, marks: set[str], separator: str) -> str | None:
    """Return the decimal mark of a column that does not show its own; None: it cannot be known."""
    if marks:
        return next(iter(marks)) if len(marks) == 1 else None
    # A comma separates here. Numbers in groups would have some below a thousand among them, without a point.
    return POINT if separator == COMMA and all(POINT in text for text in column.texts) else None


def _require_numbers(column: TextColumn) -> None:
    sound = [entry.is_number and (column.clock or ":" not in entry.text) for entry in column.entries]
    if all(sound):
        return
    k = sound.index(False)
    text = column.texts[k]
    advice = _advice(text)
    if k > 0 and not any(sound[k:]):
        advice = f"remove the rows below the table, or end it by 'last_line: {column.lines[k] - 1}'"
    raise ConfigurationError(f"{column.at(k)}: expected a finite number, got {echo(text)}; {advice}")


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


def _contradiction(column: TextColumn) -> ConfigurationError:
    """Return the complaint about the first entry with the rarer decimal mark of a column that has both."""
    by_mark: dict[str, list[int]] = {POINT: [], COMMA: []}
    for k, entry in enumerate(column.entries):
        if (mark := entry.only_mark) is not None:
            by_mark[mark].append(k)
    most = max(by_mark, key=lambda mark: (len(by_mark[mark]), -by_mark[mark][0]))
    k, other = by_mark[_OTHER[most]][0], by_mark[most][0]
    return ConfigurationError(
        f"{column.at(k)}: expected {WORDS[most]}, as in {echo(column.texts[other])} in line {column.lines[other]}, got "
        f"{echo(column.texts[k])}; write all numbers of the column alike"
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
        f"{beginning}, and no number in the columns that are read decides it; add \"decimal: '{decimal}'\" for "
        f"{small}, or \"decimal: '{_OTHER[decimal]}'\" for {large}"
    )


#: Units that mean a plain number.
_NONE = ("", "-", "–", "1")
#: The comma is the last, since it may be part of a heading or a number.
_SEPARATORS = ";\t,"
#: The line by which Excel says what separates.
_SEPARATOR_LINE = re.compile(r'"?sep=(?P<sign>[^\w\s"]|\t)(?P=sign)*"?\s*', flags=re.IGNORECASE)
_LETTER = re.compile(r"[^\W\d_]")
_NEWLINE = re.compile(r"\r\n|\r|\n")


@dataclass(frozen=True)
class Heading:
    """Name and unit of a column; the unit is empty where there is none, and has a line where it stands below."""

    name: str
    unit: str
    unit_line: int = 0

    @classmethod
    def read(cls, text: str) -> Heading:
        """Return the heading that a text such as ``settlement [mm]`` or ``t (s)`` is."""
        text = _plain(text)
        start = _opening(text)
        if start is None:
            return cls(text, "")
        return cls(text[:start].strip(), _unit(text[start:]))

    def is_called(self, name: str) -> bool:
        """Return whether a user's name, with or without a unit, is that of the heading."""
        return self.name.casefold() in (_plain(name).casefold(), Heading.read(name).name.casefold())


def _plain(text: str) -> str:
    """Return a text with composed letters and single blanks."""
    return " ".join(unicodedata.normalize("NFC", text).split())


def _opening(text: str) -> int | None:
    """Return where the last bracket begins, if the text ends with one and something stands before it."""
    ends = {"]": "[", ")": "("}.get(text[-1:])
    depth = 0
    for k in range(len(text) - 1, 0, -1):
        depth += (text[k] == text[-1]) - (text[k] == ends)
        if ends is not None and depth == 0:
            return k
    return None


def _unit(text: str) -> str:
    """Return the unit in a text such as ``mm``, ``[mm]`` or ``(mm)``."""
    text = text.strip()
    if (text[:1], text[-1:]) in (("[", "]"), ("(", ")")):
        text = text[1:-1].strip()
    return "" if text in _NONE else text


def _is_unit(cell: str) -> bool:
    """Return whether a cell is a unit, or a format of clock times."""
    return is_unit(_unit(cell)) or bool(clock_format(_unit(cell)))


@dataclass(frozen=True)
class _Row:
    """Entries of a line of the file; ``commented`` where ``#`` stands before them."""

    line: int
    cells: tuple[str, ...]
    commented: bool = False

    def columns_of(self, names: Sequence[str]) -> list[int]:
        """Return the first column of each name that is a heading here."""
        if not any(map(_LETTER.search, self.cells)):  # Most rows hold numbers, and these are many.
            return []
        headings = [Heading.read(cell) for cell in self.cells]
        found = (next((k for k, each in enumerate(headings) if each.is_called(n)), None) for n in names)
        return [k for k in found if k is not None]

    def holds_number(self, columns: Sequence[int]) -> bool:
        """Return whether one of some columns has a number here."""
        return any(Entry.read(cell).is_number for cell in self.at(columns))

    def at(self, columns: Sequence[int]) -> list[str]:
        """Return the entries in some columns, as far as the row has them."""
        return [self.cells[k] for k in columns if k < len(self.cells)]


@dataclass(frozen=True)
class _Place:
    """Place of headings in the rows of a file.

    Attributes
    ----------
    rows
        All rows of the file.
    separator
        By which they were made.
    start
        Position of the headings.
    named
        Columns that the user names.
    """

    rows: Sequence[_Row]
    separator: str
    start: int
    named: tuple[int, ...]

    @property
    def row(self) -> _Row:
        """The row of the headings."""
        return self.rows[self.start]

    @property
    def below(self) -> list[_Row]:
        """The two rows below them, or fewer; commented ones only where the headings are."""
        rest = (row for row in self.rows[self.start + 1 :] if self.row.commented or not row.commented)
        return [row for row, _ in zip(rest, range(2), strict=False)]

    @property
    def has_units(self) -> bool:
        """True where the next row is one of units: without numbers, above one with a number in the first column."""
        if len(self.below) < 2:
            return False
        units, first = self.below
        if units.commented != self.row.commented or (
            units.commented and not all(_is_unit(cell) for cell in units.at(self.named))
        ):
            return False
        # A 1 beside units is a unit; a row of ones is one of numbers.
        has_numbers = any(Entry.read(cell).is_number for cell in units.cells if _unit(cell))
        only_numbers = all(Entry.read(cell).is_number for cell in units.cells if cell.strip())
        return not has_numbers and not only_numbers and first.holds_number(self.named[:1])

    @property
    def has_numbers(self) -> bool:
        """True where numbers stand below, or units and numbers."""
        return any(row.holds_number(self.named[:1]) for row in self.below[:1]) or self.has_units

    @property
    def rank(self) -> tuple[int, bool, bool, int]:
        """Likelihood that these are the headings: compared with that of other rows."""
        return len(self.named), self.has_numbers, not self.row.commented, len(self.row.cells)


@dataclass(frozen=True, eq=False)
class CurveTable:
    """Table in a CSV file.

    Attributes
    ----------
    path
        The file.
    headings
        One for each of c columns.
    line
        Line of the headings.
    rows : list of n rows of c texts
        What the file holds.
    lines
        Line of each row in the file.
    separator
        Sign between the entries of a line.
    guess
        Encoding of the file, where it is not certain.
    """

    path: Path
    headings: tuple[Heading, ...]
    line: int
    rows: Sequence[Sequence[str]]
    lines: tuple[int, ...]
    separator: str
    guess: str = ""

    @classmethod
    def read(
        cls,
        path: Path,
        names: Sequence[str],
        *,
        encoding: str | None = None,
        heading_line: int | None = None,
        last_line: int | None = None,
    ) -> CurveTable:
        """Read a CSV file with a line of headings, and perhaps one of units below it.

        The line of headings is that in which all of ``names`` stand, above a row of numbers; lines above it do not
        count. The separator is that of semicolon, tab and comma which makes such headings, or the one that Excel's
        line ``sep=;`` says. Lines that are empty or begin with ``#`` do not count, but headings may stand behind ``#``.

        Parameters
        ----------
        path
            The file.
        names
            Headings of the columns that are wanted, first that of the times.
        encoding
            As for :func:`~porocore.commands.calibration.tables.decoded_text`.
        heading_line, last_line
            Lines of the headings and of the last row; None: they are found, and the table ends with the file.

        Raises
        ------
        ConfigurationError
            It cannot be read, has no headings or no rows, or a row has another number of entries.
        """
        text, guess = decoded_text(path, encoding)
        return cls.of_text(path, text, guess, names, heading_line=heading_line, last_line=last_line)

    @classmethod
    def of_text(
        cls,
        path: Path,
        text: str,
        guess: str,
        names: Sequence[str],
        *,
        heading_line: int | None = None,
        last_line: int | None = None,
        has_keys: bool = True,
    ) -> CurveTable:
        """Return the table in the text of a file, the encoding of which may be a guess; see :meth:`read`.

        Messages name the keys of both lines where the settings ``has_keys`` for them.
        """
        lines = _NEWLINE.split(text)
        if (said := _SEPARATOR_LINE.fullmatch(lines[0])) is not None:
            lines[0] = ""
        separators = _SEPARATORS if said is None else said["sign"]
        lines = lines[:last_line]
        read = {separator: _rows(lines, separator) for separator in separators}
        found = [(rows, separator) for separator, rows in read.items() if rows is not None]
        likely = max(separators, key=text.count)
        if not found or (
            read[likely] is None and not any(row.columns_of(names) for r, _ in found for row in r)
        ):
            raise _unreadable(path, lines, likely)
        if not any(not row.commented for rows, _ in found for row in rows):
            raise ConfigurationError(
                f"{path}: expected a line of headings and rows of numbers, got an empty file"
            )
        place = _headings(path, found, names, heading_line, has_keys=has_keys)
        return cls._below(path, place, guess, has_keys=has_keys)

    @classmethod
    def _below(cls, path: Path, place: _Place, guess: str, *, has_keys: bool = True) -> CurveTable:
        """Return the table below its headings."""
        cells = _without_empty_end(place.row.cells)
        headings = tuple(map(Heading.read, cells))
        if len(headings) < 2:
            raise _one_column(path, place.row)
        rows = [row for row in place.rows[place.start + 1 :] if not row.commented]
        if place.has_units:
            units = place.below[0]
            rows = [row for row in rows if row is not units]
            headings = _with_units(path, headings, units)
        if len(rows) > MOST_POINTS:
            raise ConfigurationError(
                f"{path}: expected at most {MOST_POINTS} rows, got {len(rows)}; keep fewer"
            )
        if not rows:
            raise ConfigurationError(
                f"{path}:{place.row.line}: expected rows of numbers below the headings {joined(map(echo, cells))}; "
                "add them"
            )
        full = [_fitted(path, row, headings, place, has_keys) for row in rows]
        return cls(
            path, headings, place.row.line, full, tuple(row.line for row in rows), place.separator, guess
        )

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return [heading.name for heading in self.headings]

    def find(self, name: str) -> int:
        """Return the number of a column; a unit in ``name`` separates columns of one name.

        Raises
        ------
        ConfigurationError
            There is none, or there are several.
        """
        found = [k for k, each in enumerate(self.headings) if each.is_called(name)]
        same = [k for k in found if self.names[k].casefold() == _plain(name).casefold()]
        found = same if len(same) == 1 else found
        if len(found) > 1 and (unit := Heading.read(name).unit):
            found = [k for k in found if self.headings[k].unit == unit] or found
        if len(found) > 1:
            units = {self.headings[k].unit for k in found}
            advice = f", or name its unit, as in {echo(f'{name} [{max(units)}]')}" if len(units) > 1 else ""
            raise ConfigurationError(
                f"{self.path}:{self.line}: the heading {echo(name)} is there {len(found)} times; rename one{advice}"
            )
        if not found:
            advice = suggestion(name, filter(None, self.names), f"the headings in line {self.line} are")
            if self.guess:
                advice += f"; the file was read as {self.guess}, if this is wrong, give 'encoding:'"
            raise ConfigurationError(f"{self.path}: no column is called {echo(name)}; {advice}")
        return found[0]

    def with_clock(self, column: int, given: str | None, *, scales: bool) -> CurveTable | None:
        """Return the table with the unit that clock times in a column have; None: there are none.

        Parameters
        ----------
        column
            Of the times.
        given
            Their unit, or the format that stands in its place; None: that of the heading.
        scales
            The study has some.

        Raises
        ------
        ConfigurationError
            Some entries alone are clock times, they may be hours or minutes, or the unit is that of a plain number.
        """
        heading = self.headings[column]
        found = _clock_unit(self._column(column), heading.unit if given is None else given, scales=scales)
        if not found:
            return None
        headings = [replace(each, unit=found) if each is heading else each for each in self.headings]
        return replace(self, headings=tuple(headings))

    def without(self, missing: Sequence[str], columns: Sequence[int]) -> CurveTable:
        """Return the table without rows that have one of the texts ``missing``, or nothing at all, in some columns."""
        texts = {text.strip().casefold() for text in missing}

        def counts(row: Sequence[str]) -> bool:
            cells = [row[k].casefold() for k in columns]
            return any(cells) and not texts.intersection(cells)

        kept = [k for k, row in enumerate(self.rows) if counts(row)]
        return replace(self, rows=[self.rows[k] for k in kept], lines=tuple(self.lines[k] for k in kept))

    def numbers(
        self, columns: Sequence[int], decimal: str | None = None, *, clock: int | None = None
    ) -> list[Numbers]:
        """Return the numbers of some columns, which together determine the decimal mark.

        The decimal mark of a column is that with which all of its entries are numbers. Where both are possible, as for
        1,234, it is that of the other columns, or the point where commas separate entries and all of the column have a
        point. A point or comma is taken for one between groups of three digits only where it can be nothing else at
        another place of the column, or, in a column without decimals, of another one.

        Parameters
        ----------
        columns
            The columns.
        decimal
            The decimal mark; None: it is found.
        clock
            The only column that may have clock times.

        Raises
        ------
        ConfigurationError
            An entry is no finite number, two of a column have different decimal marks, or it may be two numbers. The
            message names the line.
        """
        found = [self._column(k, clock=k == clock) for k in columns]
        marks = {mark for column in found for mark in column.marks}
        groups = {group for column in found for group in column.groups}
        return [_read(column, marks, groups, self.separator, decimal) for column in found]

    def _column(self, k: int, *, clock: bool = False) -> TextColumn:
        return TextColumn(self.path, self.names[k], [row[k] for row in self.rows], self.lines, clock)


def _clock_unit(column: TextColumn, unit: str, *, scales: bool) -> str:
    """Return the unit of clock times, read as a number of their last place; empty where a column has none."""
    read = [CLOCK.fullmatch(text.strip()) for text in column.texts]
    k = next((k for k, each in enumerate(read) if each is not None), None)
    if k is None:
        return ""
    at, got = column.at(k), echo(column.texts[k])
    other = next(
        (i for i, text in enumerate(column.texts) if re.fullmatch(r"\s*[0-9.,]*[0-9]\s*", text)), None
    )
    if other is not None:
        raise ConfigurationError(
            f"{at}: expected a number, as in line {column.lines[other]}, got the clock time {got}; write all times "
            "alike"
        )
    has_seconds = any(each is not None and (each["h"] or each["f"]) for each in read)
    found = clock_format(unit)
    if unit and not found:
        raise ConfigurationError(
            f"{at}: expected a number in {echo(unit)}, got the clock time {got}; give 'time_unit: \"hh:mm:ss\"', or "
            "'time_unit: \"mm:ss\"'"
        )
    if has_seconds and found == "min":
        raise ConfigurationError(
            f"{at}: expected times as hh:mm, got {got} among others with seconds; give 'time_unit: \"hh:mm:ss\"'"
        )
    if not has_seconds and not found:
        raise ConfigurationError(
            f"{at}: {got} may be minutes and seconds, or hours and minutes; give 'time_unit: \"mm:ss\"' or "
            "'time_unit: \"hh:mm\"'"
        )
    if not scales:
        raise ConfigurationError(
            f"{at}: {got} is a time in seconds, but {ADD_SCALES}, or write dimensionless times"
        )
    return found or "s"


def _rows(lines: Sequence[str], separator: str) -> list[_Row] | None:
    """Return the rows of a file that are not empty; None: quotation marks do not go with the separator."""
    found: list[_Row] = []
    comments = [
        _Row(k, cells, True)
        for k, line in enumerate(lines, start=1)
        if line.lstrip().startswith("#") and (cells := _cells(line.lstrip().lstrip("#"), separator))
    ]
    try:
        found.extend(_Row(line, cells) for line, cells in _plain_rows(lines, separator))
    except csv.Error:
        return None
    return sorted(found + comments, key=lambda row: row.line)


def _cells(line: str, separator: str) -> tuple[str, ...]:
    """Return the entries of one line; none where all of them are empty."""
    cells = tuple(cell.strip() for cell in next(csv.reader([line], delimiter=separator), ()))
    return cells if any(cells) else ()


def _plain_rows(lines: Sequence[str], separator: str) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Yield line and entries of each row that is not empty and no comment; an entry in quotes may have lines."""
    plain = ("\n" if line.lstrip().startswith("#") else f"{line}\n" for line in lines)
    reader = csv.reader(plain, delimiter=separator, strict=True, skipinitialspace=True)
    first = 1
    for row in reader:
        cells = tuple(cell.strip() for cell in row)
        if any(cells):
            yield first, cells
        first = reader.line_num + 1


def _unreadable(path: Path, lines: Sequence[str], separator: str) -> ConfigurationError:
    """Return the complaint about the first row whose quotation marks make no entry."""
    last = 0
    try:
        for line, cells in _plain_rows(lines, separator):
            last = line + sum(cell.count("\n") for cell in cells)
    except csv.Error:
        pass
    begin = next((k for k, line in enumerate(lines, start=1) if k > last and '"' in line), last + 1)
    return ConfigurationError(
        f"{path}:{begin}: expected entries with separators between them, got a quotation mark that begins an entry and "
        "does not end it; remove it"
    )


def _headings(
    path: Path,
    found: Sequence[tuple[list[_Row], str]],
    names: Sequence[str],
    line: int | None,
    *,
    has_keys: bool = True,
) -> _Place:
    """Return the place of the headings, by the names of columns or by their line."""
    if line is not None:
        places = [
            _Place(rows, sign, k, tuple(row.columns_of(names)) or (0,))
            for rows, sign in found
            for k, row in enumerate(rows)
            if row.line == line
        ]
        if not places:
            raise ConfigurationError(
                f"heading_line: expected the line of the headings in {path}, got {line}, which holds no text"
            )
        return max(places, key=lambda place: place.rank)
    places = [
        _Place(rows, sign, k, named)
        for rows, sign in found
        for k, row in enumerate(rows)
        if (named := tuple(row.columns_of(names)))
    ]
    if not places:
        return _likely(path, found)
    best = max(places, key=lambda place: place.rank)
    same = [p for p in places if p.separator == best.separator and p.rank[:3] == best.rank[:3]]
    if len(same) > 1 and best.has_numbers and len(best.named) == len(names):
        first, second = same[0].row.line, same[1].row.line
        advice = f"; keep one in the file, or say which by 'heading_line: {first}' and 'last_line:'"
        raise ConfigurationError(
            f"{path}: expected one table with {joined(map(echo, names))} in its headings, got one in line {first} and "
            f"another in line {second}{advice if has_keys else '; keep one in the file'}"
        )
    return best


def _likely(path: Path, found: Sequence[tuple[list[_Row], str]]) -> _Place:
    """Return the row above the first one of numbers, for messages, where none has a name that the user gave."""

    def numeric(row: _Row) -> bool:
        return not row.commented and sum(Entry.read(cell).is_number for cell in row.cells) > 1

    rows, separator = max(found, key=lambda each: sum(map(numeric, each[0])))
    at = next((k for k, row in enumerate(rows) if numeric(row)), None)
    # A line with one entry, such as the name of a machine, is no line of headings.
    if at == 0 or (at is not None and sum(map(bool, rows[at - 1].cells)) < 2 <= len(rows[at].cells)):
        sign = "\\t" if separator == "\t" else f"{separator} "
        raise ConfigurationError(
            f"{path}:{rows[at].line}: expected a line of headings above the numbers, by which columns are named, got "
            f"none; add one, such as 'time [s]{sign}settlement [mm]'"
        )
    if at is None:
        if all(len(row.cells) < 2 for each, _ in found for row in each):
            raise _one_column(path, rows[0])
        rows, separator = max(found, key=lambda each: max(len(row.cells) for row in each[0]))
        return _Place(rows, separator, 0, (0,))
    is_units = at > 1 and all(_is_unit(cell) for cell in rows[at - 1].cells if _unit(cell))
    return _Place(rows, separator, at - 2 if is_units else at - 1, (0,))


def _one_column(path: Path, row: _Row) -> ConfigurationError:
    return ConfigurationError(
        f"{path}:{row.line}: expected at least two columns, got one heading, {echo(row.cells[0])}; separate columns by "
        "a comma, a semicolon or a tab"
    )


def _without_empty_end(cells: Sequence[str]) -> Sequence[str]:
    """Return entries without the empty ones at the end."""
    return cells[: max((k for k, cell in enumerate(cells, start=1) if cell), default=0)]


def _with_units(path: Path, headings: Sequence[Heading], units: _Row) -> tuple[Heading, ...]:
    """Return headings with the units of the row below them."""
    found = []
    for heading, cell in zip(headings, [*units.cells, *[""] * len(headings)], strict=False):
        unit = _unit(cell)
        if unit and heading.unit and unit != heading.unit:
            raise ConfigurationError(
                f"{path}:{units.line}: {heading.name}: expected {echo(heading.unit)}, the unit in the heading, got "
                f"{echo(unit)}; remove one of the two"
            )
        found.append(heading if heading.unit else Heading(heading.name, unit, units.line))
    return tuple(found)


def _fitted(
    path: Path, row: _Row, headings: Sequence[Heading], place: _Place, has_keys: bool
) -> Sequence[str]:
    """Return the entries of a row, one for each heading; empty ones more at its end do not count."""
    cells = row.cells[: max(len(headings), len(_without_empty_end(row.cells)))]
    if len(cells) != len(headings):
        points = ", or write decimal points" if place.separator == "," else ""
        end = f", end the table above it by 'last_line: {row.line - 1}'" if has_keys else ""
        raise ConfigurationError(
            f"{path}:{row.line}: expected {len(headings)} entries, one for each heading in line {place.row.line}, got "
            f"{len(cells)}; remove the line, begin it with '#'{end}{points}"
        )
    return cells
