"""Words of messages: the given value, quoted or cut; similar names; names joined as in "a, b and c"."""

from __future__ import annotations

import difflib
import json
import re
import reprlib
from collections.abc import Iterable, Mapping
from typing import Any

#: Characters of what came that a message repeats.
MOST = 80
#: Characters of a path that is shown whole, since it is no use in pieces.
LONGEST_PATH = 240
#: A number with a decimal comma or with groups of digits, and its unit.
_COMMAS = re.compile(
    r"\s*(?P<number>[+-]?(?:(?P<decimal>\d+,\d+|\d{1,3}(?:\.\d{3})+,\d+)|\d{1,3}(?:,\d{3})+\.\d*|\d{1,3}(?:,\d{3}){2,})"
    r"(?:[eE][+-]?\d+)?)(?P<unit>(?:\s*[^\s\d.,:].*)?)\s*",
    re.S,
)
#: Names of so few characters, such as H24, are similar to many others.
SHORT = 3
#: Entries of a list or mapping that are looked at, and levels of them.
ENTRIES, LEVELS = 20, 5


def cut(text: str, most: int = MOST) -> str:
    """Return ``text`` on one line, without control characters, as at most ``most`` characters."""
    line = _one_line(text[: most + 1])
    return line if len(text) <= most and len(line) <= most else f"{line[: most - 1]}…"


def shortened(text: str, most: int) -> str:
    """Return a text as at most ``most`` characters."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def joined(names: Iterable[str]) -> str:
    """Return names as in "a, b and c"; "none" where there is none."""
    *head, last = list(names) or ["none"]
    return f"{', '.join(head)} and {last}" if head else last


def echo(value: Any, most: int = MOST) -> str:
    """Return ``value`` as a message repeats it: a text in quotes, anything else as YAML writes it, both cut.

    Parameters
    ----------
    value
        Anything that a user may have given, of any size and depth.
    most
        Characters of it that are repeated.
    """
    if value is None:
        return "no value"
    if isinstance(value, str):
        return f"'{cut(value, most)}'"
    if isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > 4 * most:
        return f"a whole number of some {round(value.bit_length() * 0.30103)} digits"
    import yaml

    try:
        text = yaml.safe_dump(_pruned(value), default_flow_style=True, width=10**6, sort_keys=False).strip()
    except (yaml.YAMLError, ValueError, RecursionError):
        text = reprlib.repr(value)
    return cut(text.removesuffix("...").strip(), most)


def comma_advice(value: Any, whole: bool = False) -> str:
    """Return the advice on a number with a comma in it, after a semicolon; empty where ``value`` is no such text.

    A ``whole`` number may have commas between groups of digits alone.
    """
    found = _COMMAS.fullmatch(value) if isinstance(value, str) else None
    if found is None:
        return ""
    number, unit = found["number"], cut(found["unit"])
    together = number.replace(",", "") + unit
    may_be_groups = re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", number) is not None
    if whole and not may_be_groups and found["decimal"] is not None:
        return ""
    if found["decimal"] is None or whole:
        return f"; digits are not grouped: write {together}"
    meant = f", or {together}" if may_be_groups else ""
    return f"; decimals stand after a point: write {number.replace('.', '').replace(',', '.')}{unit}{meant}"


def comma_within(text: str) -> str:
    """Return the advice, after a semicolon, on commas between digits of a text that is no number alone; empty: none."""
    return "; decimals stand after a point" if re.search(r"\d,\d", text) else ""


def echo_path(path: object) -> str:
    """Return a path as a message shows it: whole, unless no file can have so long a name."""
    text = str(path)
    return cut(text, LONGEST_PATH if len(text) <= LONGEST_PATH else MOST)


def without_long_words(message: str, words: Iterable[str]) -> str:
    """Return a message of other software with the long ones of ``words``, and their part behind ``=``, cut."""
    for word in words:
        for part in (word, word.partition("=")[2]):
            if len(part) > MOST:
                message = message.replace(part, cut(part))
    return message


def without_line_breaks(message: str, words: Iterable[str]) -> str:
    """Return a message with those of ``words`` that hold control characters, such as line breaks, on one line."""
    for word in words:
        for part in (word, word.partition("=")[2]):
            if not part.isprintable():
                message = message.replace(part, _one_line(part))
    return message


def _one_line(text: str) -> str:
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def reason(error: BaseException, most: int = 160) -> str:
    """Return why something could not be read, in words of one line: no class and no repr of an exception."""
    if isinstance(error, OSError):
        text = error.strerror or ""
    elif isinstance(error, json.JSONDecodeError):
        text = f"it is no JSON from line {error.lineno} on"
    elif isinstance(error, UnicodeDecodeError):
        text = "its bytes are no UTF-8"
    elif isinstance(error, KeyError):
        key = str(error.args[0]) if error.args else ""
        text = key if key.endswith(" is missing") or not key else f"{echo(key)} is missing"
    elif isinstance(error, TypeError | AttributeError | IndexError | AssertionError | SystemError):
        text = ""  # Python's own words on values that are not what they should be
    else:
        text = str(error)
    if "values to unpack" in text:
        text = ""
    return cut(" ".join(text.split()), most) or "it does not hold what it should"


def _is_slip(name: str, known: str) -> bool:
    """Return whether a short name is another one with characters exchanged, or with one missing or more."""
    return sorted(name) == sorted(known) or (
        abs(len(name) - len(known)) == 1 and (name in known or known in name)
    )


def did_you_mean(name: str, names: Iterable[str], *, most: int = 1, cutoff: float = 0.6) -> str:
    """Return the question whether a similar name is meant; empty where none of ``names`` is similar."""
    known: dict[str, list[str]] = {}
    for each in names:
        known.setdefault(each.casefold(), []).append(each)
    folded = name.casefold()
    # Another digit makes another component, not a slip of one.
    if len(name) <= SHORT and any(map(str.isdigit, name)):
        near = [each for each in known if _is_slip(folded, each)]
    else:
        near = difflib.get_close_matches(folded, known, n=most, cutoff=cutoff)
    close = [each for found in near for each in known[found]][:most]
    quoted = " or ".join(f"'{found}'" for found in close)
    return f"did you mean {quoted}?" if close else ""


def choices(names: Iterable[str], listed: str, none: str = "there are none") -> str:
    """Return ``listed``, such as "the closures are", with all names; where there is no name the sentence ``none``."""
    known = ", ".join(names)
    return f"{listed} {known}" if known else none


def suggestion(name: str, names: Iterable[str], listed: str, none: str = "there are none") -> str:
    """Return the advice on an unknown name: a similar one, and all :func:`choices`."""
    names = list(names)
    return f"{did_you_mean(name, names)} {choices(names, listed, none)}".lstrip()


def _pruned(value: Any, level: int = 0) -> Any:
    """Return a copy with few entries and levels, so that it is written at once."""
    if isinstance(value, str):
        return value[: MOST + 1]
    if isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > 4 * MOST:
        return "…"
    if isinstance(value, Mapping | list | tuple) and level == LEVELS:
        return "…"
    if isinstance(value, Mapping):
        kept = list(value.items())[:ENTRIES]
        return {_pruned(key, LEVELS): _pruned(below, level + 1) for key, below in kept}
    if isinstance(value, list | tuple):
        return [_pruned(below, level + 1) for below in value[:ENTRIES]]
    return value
