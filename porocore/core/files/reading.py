"""Bounded reading of text and JSON from files that may come from anybody; only ordinary ones."""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from porocore.core.echo import reason
from porocore.errors import DataError

#: A configuration, a record or a table that porocore wrote is smaller [bytes].
LARGEST_TEXT = 16 << 20
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a named pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}


#: Errors of the system where a path leads to nothing.
_NOTHING = (errno.ENOENT, errno.ENOTDIR, errno.ELOOP)


def obstacle(path: Path) -> str:
    """Return why nothing can be at a path: a link that leads nowhere, or a file in the place of a folder above it.

    Empty: neither is in the way. The part that is in the way is named where it is not the path itself.
    """
    for place in (*reversed(path.parents), path):
        named = "" if place == path else f"{place} is "
        try:
            mode = place.stat().st_mode
        except ValueError:  # a null character
            return ""
        except OSError as error:
            if not os.path.islink(place) or error.errno not in _NOTHING:
                return ""
            if error.errno == errno.ELOOP:
                return f"{named}a symbolic link that leads back to itself"
            return f"{named}a symbolic link to {os.readlink(place)}, which does not exist"
        if named and not stat.S_ISDIR(mode):
            return f"{named}{_KINDS.get(stat.S_IFMT(mode), 'a file')}, not a folder"
    return ""


def require_ordinary(path: Path, largest: int | None = None) -> None:
    """Check that a path leads to a file that can be read to an end, without opening it.

    Parameters
    ----------
    path
        May be a symbolic link.
    largest
        Size that the file may have [bytes]; None: any.

    Raises
    ------
    OSError
        There is none, or it is a folder, pipe, device or too large; ``strerror`` says which.
    """
    try:
        found = path.stat()
    except ValueError as error:  # a null character
        raise FileNotFoundError(errno.ENOENT, "no such file", str(path)) from error
    except OSError as error:
        if error.errno in _NOTHING:
            raise OSError(error.errno, obstacle(path) or "no such file", str(path)) from None
        raise
    kind = stat.S_IFMT(found.st_mode)
    if kind != stat.S_IFREG:
        number = errno.EISDIR if kind == stat.S_IFDIR else errno.EINVAL
        raise OSError(number, f"expected a file, got {_KINDS.get(kind, 'something else')}", str(path))
    if largest is not None and found.st_size > largest:
        raise OSError(
            errno.EFBIG, f"expected at most {_size(largest)}, got a file of {_size(found.st_size)}", str(path)
        )


def read_text(path: Path, largest: int = LARGEST_TEXT) -> str:
    """Return the text of an ordinary file in UTF-8.

    Raises
    ------
    OSError
        As :func:`require_ordinary`, or it cannot be read.
    UnicodeDecodeError
        It is no UTF-8.
    """
    require_ordinary(path, largest)
    return path.read_text(encoding="utf-8")


def read_json(path: Path) -> Any:
    """Return what a JSON file holds.

    Raises
    ------
    OSError
        As :func:`read_text`.
    ValueError
        It is no JSON, or nested so deeply that nothing of ours wrote it.
    """
    text = read_text(path)
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


@contextmanager
def complete(path: Path, what: str, then: str) -> Iterator[None]:
    """Refuse a file that the block finds damaged, or other than ``what``; ``then`` is that of :func:`set_aside`.

    Raises
    ------
    DataError
        The block raised an error of the system, or of a value that is missing or not what it should be.
    """
    try:
        yield
    except (OSError, ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        why = f"not a complete {what} ({reason(error)})"
        raise DataError(f"{path}: {why}; {set_aside(path, then)}") from error


def set_aside(path: Path, then: str) -> str:
    """Return the advice on a damaged file: to move it, which keeps a copy, and what to do ``then``."""
    return f"move it to {path.name}.damaged, then {then}"


def _size(count: int) -> str:
    return f"{count / 1e6:,.3g} MB" if count < 1e9 else f"{count / 1e9:,.3g} GB"
