"""Table of measured numbers from a CSV file: headings with units, columns by name, what is wrong."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from porocore.calibration.config.settings import MOST_POINTS
from porocore.core.echo import echo, echo_path, suggestion
from porocore.core.files.reading import read_text
from porocore.errors import ConfigurationError
from porocore.states import Array

#: A heading with its unit in brackets, such as ``settlement [mm]`` or ``t (s)``.
_HEADING = re.compile(r"\s*(?P<name>.*?)\s*[\[(](?P<unit>[^\[\]]*)[\])]\s*")
#: A decimal number; Python's own ``float`` also takes 1_000, and digits of other scripts.
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
#: Units that mean a plain number.
_NONE = ("", "-", "–", "1")
#: The comma is the last, since it may be part of a heading or a number.
_SEPARATORS = ";\t,"


@dataclass(frozen=True)
class Heading:
    """Name and unit of a column; the unit is empty where there is none."""

    name: str
    unit: str

    @classmethod
    def read(cls, text: str) -> Heading:
        """Return the heading that a text such as ``settlement [mm]`` is."""
        match = _HEADING.fullmatch(text)
        if match is None:
            return cls(text.strip(), "")
        unit = match["unit"].strip()
        return cls(match["name"], "" if unit in _NONE else unit)


@dataclass(frozen=True, eq=False)
class CurveTable:
    """Numbers of a CSV file.

    Attributes
    ----------
    path
        The file.
    headings
        One for each of c columns.
    rows : list of n rows of c texts
        What the file holds.
    lines
        Line of each row in the file.
    separator
        Sign between the entries of a line.
    """

    path: Path
    headings: tuple[Heading, ...]
    rows: Sequence[Sequence[str]]
    lines: tuple[int, ...]
    separator: str

    @classmethod
    def read(cls, path: Path) -> CurveTable:
        """Read a CSV file with a line of headings.

        The separator is that of comma, semicolon and tab which the headings hold most often; where two are equal, the
        rows decide. Empty lines and those that begin with ``#`` do not count.

        Raises
        ------
        ConfigurationError
            It cannot be read, has no headings or no rows, or a row has another number of entries.
        """
        text = _text(path)
        lines = [
            (number, line)
            for number, line in enumerate(text.splitlines(), start=1)
            if line.strip() and not line.lstrip().startswith("#")
        ]
        if not lines:
            raise ConfigurationError(
                f"{path}: expected a line of headings and rows of numbers, got an empty file"
            )
        if len(lines) > MOST_POINTS + 1:
            raise ConfigurationError(
                f"{path}: expected at most {MOST_POINTS} rows, got {len(lines) - 1}; keep fewer"
            )
        rows_text = "".join(line for _, line in lines[1:])
        separator = max(_SEPARATORS, key=lambda sign: (lines[0][1].count(sign), rows_text.count(sign)))
        try:
            first, *rows = csv.reader((line for _, line in lines), delimiter=separator, strict=True)
        except csv.Error as error:
            raise ConfigurationError(f"{path}: not a table of comma-separated values: {error}") from None
        numbers = tuple(number for number, _ in lines[1:])
        table = cls(path, tuple(map(Heading.read, first)), rows, numbers, separator)
        table._check(lines[0][0])
        return table

    def _check(self, line: int) -> None:
        if all(_is_number(self._with_point(heading.name)) for heading in self.headings):
            raise ConfigurationError(
                f"{self.path}:{line}: expected a line of headings such as 'time [s], settlement [mm]', got numbers; "
                "add one above them"
            )
        if len(self.headings) < 2 and all(len(row) < 2 for row in self.rows):
            raise ConfigurationError(
                f"{self.path}:{line}: expected at least two columns, got one heading, {echo(self.names[0])}; separate "
                "columns by a comma, a semicolon or a tab"
            )
        for number, row in zip(self.lines, self.rows, strict=True):
            if len(row) != len(self.headings):
                points = ", and write decimal points" if self.separator == "," else ""
                raise ConfigurationError(
                    f"{self.path}:{number}: expected {len(self.headings)} entries, one for each heading in line "
                    f"{line}, got {len(row)}; begin lines outside the table with '#'{points}"
                )

    @property
    def names(self) -> list[str]:
        """Names of the columns."""
        return [heading.name for heading in self.headings]

    def find(self, name: str) -> int:
        """Return the number of a column.

        Raises
        ------
        ConfigurationError
            There is none, or there are several.
        """
        wanted = Heading.read(name).name.casefold()
        found = [k for k, each in enumerate(self.names) if each.casefold() == wanted]
        if len(found) > 1:
            raise ConfigurationError(
                f"{self.path}: the heading {echo(name)} is there {len(found)} times; rename"
            )
        if not found:
            advice = suggestion(name, self.names, "the headings are")
            raise ConfigurationError(f"{self.path}: no column is called {echo(name)}; {advice}")
        return found[0]

    def numbers(self, column: int) -> Array:
        """Return the numbers (n,) of a column.

        They have decimal points, or all of them decimal commas where the separator is another sign.

        Raises
        ------
        ConfigurationError
            An entry is no finite number, or some have a point and others a comma; the message names the line.
        """
        texts = [row[column].strip() for row in self.rows]
        has_points = any("." in text for text in texts)
        values = []
        for line, text in zip(self.lines, texts, strict=True):
            number = text if has_points else self._with_point(text)
            if not _is_number(number) or not np.isfinite(float(number)):
                advice = "write all numbers of the column with" if "," in text else "write the number with"
                raise ConfigurationError(
                    f"{self.path}:{line}: {self.names[column]}: expected a finite number, got {echo(text)}; remove the "
                    f"row, or {advice} a decimal point"
                )
            values.append(float(number))
        return np.array(values)

    def _with_point(self, text: str) -> str:
        """Return an entry with a decimal point in place of its only comma, unless commas separate entries."""
        return text.replace(",", ".") if self.separator != "," and text.count(",") == 1 else text

    def require_rising(self, column: int) -> None:
        """Refuse times that do not increase from row to row, or begin before zero.

        Raises
        ------
        ConfigurationError
            A time does not come after the one before it; the message names its line.
        """
        times = self.numbers(column)
        name = self.names[column]
        for k, line in enumerate(self.lines):
            if k and times[k] <= times[k - 1]:
                raise ConfigurationError(
                    f"{self.path}:{line}: {name}: expected increasing times, got {times[k]:g} after {times[k - 1]:g}; "
                    "sort the rows, and keep one of two at the same time"
                )
            if times[k] < 0:
                raise ConfigurationError(
                    f"{self.path}:{line}: {name}: expected a time from 0, the beginning of the test, got {times[k]:g}"
                )


def _is_number(text: str) -> bool:
    return _NUMBER.fullmatch(text.strip()) is not None


def _text(path: Path) -> str:
    try:
        return read_text(path).removeprefix("\ufeff")
    except FileNotFoundError as error:
        raise ConfigurationError(
            f"{echo_path(path)}: no such file; give the CSV file of the curve"
        ) from error
    except IsADirectoryError as error:
        raise ConfigurationError(f"{echo_path(path)}: expected a CSV file, got a folder") from error
    except UnicodeDecodeError as error:
        raise ConfigurationError(
            f"{path}: expected a CSV file in UTF-8, got other bytes; save it as UTF-8"
        ) from error
    except OSError as error:
        raise ConfigurationError(f"{echo_path(path)}: cannot be read: {error.strerror or error}") from error
