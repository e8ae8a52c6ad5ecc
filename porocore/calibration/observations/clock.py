"""Clock times such as 01:30:00 in a column of times (clock_unit): what they are in seconds or minutes."""

from __future__ import annotations

import re
from collections.abc import Sequence

from porocore.core.echo import echo
from porocore.core.units.texts import ADD_SCALES
from porocore.errors import ConfigurationError

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


def clock_unit(where: str, texts: Sequence[str], lines: Sequence[int], unit: str, *, scales: bool) -> str:
    """Return the unit of clock times, read as a number of their last place; empty where a column has none.

    Parameters
    ----------
    where
        File and heading, with a place for the line.
    texts, lines
        Of the column.
    unit
        Its unit, or the format that stands there; empty: none is given.
    scales
        The study has some.

    Raises
    ------
    ConfigurationError
        Some entries alone are clock times, they may be hours or minutes, or the unit is that of a plain number.
    """
    read = [CLOCK.fullmatch(text.strip()) for text in texts]
    k = next((k for k, each in enumerate(read) if each is not None), None)
    if k is None:
        return ""
    at, got = where.format(lines[k]), echo(texts[k])
    other = next((i for i, text in enumerate(texts) if re.fullmatch(r"\s*[0-9.,]*[0-9]\s*", text)), None)
    if other is not None:
        raise ConfigurationError(
            f"{at}: expected a number, as in line {lines[other]}, got the clock time {got}; write all times alike"
        )
    told = any(each is not None and (each["h"] or each["f"]) for each in read)
    found = clock_format(unit)
    if unit and not found:
        raise ConfigurationError(
            f"{at}: expected a number in {echo(unit)}, got the clock time {got}; give 'time_unit: \"hh:mm:ss\"', or "
            "'time_unit: \"mm:ss\"'"
        )
    if told and found == "min":
        raise ConfigurationError(
            f"{at}: expected times as hh:mm, got {got} among others with seconds; give 'time_unit: \"hh:mm:ss\"'"
        )
    if not told and not found:
        raise ConfigurationError(
            f"{at}: {got} may be minutes and seconds, or hours and minutes; give 'time_unit: \"mm:ss\"' or "
            "'time_unit: \"hh:mm\"'"
        )
    if not scales:
        raise ConfigurationError(
            f"{at}: {got} is a time in seconds, but {ADD_SCALES}, or write dimensionless times"
        )
    return found or "s"
