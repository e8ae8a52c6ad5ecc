"""Table of measured numbers from a CSV file: headings found by their names, units, rows, what is wrong."""

from __future__ import annotations

import csv
import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from porocore.calibration.config.settings import MOST_POINTS
from porocore.calibration.observations.clock import clock_format, clock_unit
from porocore.calibration.observations.decoding import decoded_text
from porocore.calibration.observations.numbers import Entry, Numbers, TextColumn, read_columns
from porocore.calibration.observations.unit import is_unit
from porocore.core.echo import echo, joined, suggestion
from porocore.errors import ConfigurationError

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
        # A unit of 1 is none of a row of numbers.
        has_numbers = any(Entry.read(cell).is_number for cell in units.cells if _unit(cell))
        return not has_numbers and first.holds_number(self.named[:1])

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
            As for :func:`~porocore.calibration.observations.decoding.decoded_text`.
        heading_line, last_line
            Lines of the headings and of the last row; None: they are found, and the table ends with the file.

        Raises
        ------
        ConfigurationError
            It cannot be read, has no headings or no rows, or a row has another number of entries.
        """
        text, guess = decoded_text(path, encoding)
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
        place = _headings(path, found, names, heading_line)
        return cls._below(path, place, guess)

    @classmethod
    def _below(cls, path: Path, place: _Place, guess: str) -> CurveTable:
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
        full = [_fitted(path, row, headings, place) for row in rows]
        return cls(
            path, headings, place.row.line, full, tuple(row.line for row in rows), place.separator, guess
        )

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return [heading.name for heading in self.headings]

    def find(self, name: str) -> int:
        """Return the number of a column; a unit in ``name`` tells columns of one name apart.

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

    def with_clock(self, column: int, format_or_unit: str | None, *, scales: bool) -> CurveTable | None:
        """Return the table with the unit that clock times in a column have; None: there are none.

        Raises
        ------
        ConfigurationError
            As :func:`~porocore.calibration.observations.clock.clock_unit`.
        """
        heading, texts = self.headings[column], [row[column] for row in self.rows]
        unit = heading.unit if format_or_unit is None else format_or_unit
        where = f"{self.path}:{{}}: {heading.name}"
        found = clock_unit(where, texts, self.lines, unit, scales=scales)
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
        """Return the numbers of some columns, which tell together what points and commas mean.

        Only the column ``clock`` may have clock times.

        Raises
        ------
        ConfigurationError
            As :func:`~porocore.calibration.observations.numbers.read_columns`.
        """
        found = [
            TextColumn(self.names[k], [row[k] for row in self.rows], self.lines, k == clock) for k in columns
        ]
        return read_columns(str(self.path), found, self.separator, decimal)


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
    path: Path, found: Sequence[tuple[list[_Row], str]], names: Sequence[str], line: int | None
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
        raise ConfigurationError(
            f"{path}: expected one table with {joined(map(echo, names))} in its headings, got one in line {first} and "
            f"another in line {second}; keep one in the file, or say which by 'heading_line: {first}' and 'last_line:'"
        )
    return best


def _likely(path: Path, found: Sequence[tuple[list[_Row], str]]) -> _Place:
    """Return the row above the first one of numbers, for messages, where none has a name that the user gave."""

    def numeric(row: _Row) -> bool:
        return not row.commented and sum(Entry.read(cell).is_number for cell in row.cells) > 1

    rows, separator = max(found, key=lambda each: sum(map(numeric, each[0])))
    at = next((k for k, row in enumerate(rows) if numeric(row)), None)
    if at == 0:
        raise ConfigurationError(
            f"{path}:{rows[0].line}: expected a line of headings such as 'time [s], settlement [mm]', got numbers; "
            "add one above them"
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


def _fitted(path: Path, row: _Row, headings: Sequence[Heading], place: _Place) -> Sequence[str]:
    """Return the entries of a row, one for each heading; empty ones more at its end do not count."""
    cells = row.cells[: max(len(headings), len(_without_empty_end(row.cells)))]
    if len(cells) != len(headings):
        points = ", or write decimal points" if place.separator == "," else ""
        raise ConfigurationError(
            f"{path}:{row.line}: expected {len(headings)} entries, one for each heading in line {place.row.line}, got "
            f"{len(cells)}; remove the line, begin it with '#', end the table above it by 'last_line: {row.line - 1}'"
            f"{points}"
        )
    return cells
