"""End of a command: an error becomes one message on standard error and an exit status.

Exit status: 0 done, 1 a check that failed, 2 an error that the message explains, 70 an unexpected exception
(sysexits.h: internal software error), 130 interrupted by Ctrl-C, 143 by SIGTERM.
"""

from __future__ import annotations

import errno
import os
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

import typer

from porocore.cli.common import INTERRUPTED, Interrupted
from porocore.core import unexpected
from porocore.core.echo import without_line_breaks
from porocore.core.parallel import launched, let_the_first_speak
from porocore.errors import PorocoreError, UnexpectedError

REFUSED, UNEXPECTED = 2, 70
#: Libraries that print results on standard output.
_PRINTERS = ("click", "typer", "rich")
#: Lines of a message, and characters of a line, that are shown.
MOST_LINES, LONGEST_LINE = 30, 600
_ROOM = "make room, and give the command again, with --resume where it has that option"
_FOLDER = "choose a folder that you may write, with --out"
_PATH = "give the path of another file or folder"
#: Advice by error of the system about files and folders.
_OF_THE_SYSTEM = {
    errno.ENOSPC: _ROOM,
    errno.EDQUOT: _ROOM,
    errno.EFBIG: _ROOM,
    errno.EROFS: "choose a folder that can be written, with --out",
    errno.EACCES: _FOLDER,
    errno.EPERM: _FOLDER,
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.ELOOP: "a symbolic link leads back to itself; " + _PATH,
    errno.ENOTDIR: _PATH,
    errno.EISDIR: _PATH,
    errno.ENXIO: _PATH,
    errno.ENODEV: _PATH,
    errno.EIO: "look after the disk, and give the command again, with --resume where it has that option",
    errno.ESTALE: "the file system went away; give the command again, with --resume where it has that option",
    errno.EMFILE: "allow more open files (ulimit -n), or use fewer workers",
    errno.ENFILE: "the machine has too many open files; try again later",
}


@contextmanager
def ending() -> Iterator[None]:
    """Print an error of the block as one message on standard error, and end the process with its status."""
    threading.excepthook = _in_a_thread
    try:
        yield
    except UnexpectedError as error:
        _unexpected(error)
    except PorocoreError as error:
        _stop(str(error), REFUSED)
    except Interrupted as interruption:
        _stop(str(interruption), interruption.status, "")
    except KeyboardInterrupt:
        _stop("interrupted", INTERRUPTED, "")
    except OSError as error:
        if not error.filename and _came_of_printing(error) and error.errno in (*_OF_THE_SYSTEM, errno.EBADF):
            _drop_what_is_left()
            why = "closed" if error.errno == errno.EBADF else error.strerror
            _stop(f"standard output: {why}; send it somewhere else", REFUSED)
        if error.errno not in _OF_THE_SYSTEM:
            _unexpected(error)
        where = f"{error.filename}: " if error.filename else ""
        _stop(f"{where}{error.strerror}; {_OF_THE_SYSTEM[error.errno]}", REFUSED)
    except Exception as error:  # noqa: BLE001 - any error is reported
        _unexpected(error)


def _drop_what_is_left() -> None:
    """Lead standard output to the null device, so that Python does not try once more to write what is left."""
    with suppress(OSError, ValueError, AttributeError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())
        os.close(null)


def _came_of_printing(error: BaseException) -> bool:
    """Return whether an error was raised by a library that prints results."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    return bool(frames) and frames[-1].f_globals.get("__name__", "").partition(".")[0] in _PRINTERS


def _unexpected(error: BaseException) -> NoReturn:
    _stop(unexpected.describe(error) if launched()[0] == 0 else "", UNEXPECTED)


def _in_a_thread(args: threading.ExceptHookArgs) -> None:
    if args.exc_value is not None and not isinstance(args.exc_value, SystemExit):
        _tell(unexpected.describe(args.exc_value), "error: ")


def _stop(message: str, status: int, label: str = "error: ") -> NoReturn:
    if launched()[0] > 0:
        let_the_first_speak()
        sys.exit(status)
    _tell(message, label)
    sys.exit(status)


def _tell(message: str, label: str) -> None:
    """Print the message, bounded, where standard error is still open."""
    lines = [_cut(line) for line in without_line_breaks(message, sys.argv[1:]).splitlines()]
    if len(lines) > 1:
        hidden = len(lines) - MOST_LINES
        shown = [*lines[:MOST_LINES], f"and {hidden} more"] if hidden > 0 else lines
        lines = [f"{len(lines)} faults", *shown]
    with suppress(OSError, AttributeError):
        typer.secho(label, fg=typer.colors.RED, bold=True, err=True, nl=False)
        typer.echo("\n  ".join(lines), err=True)


def _cut(line: str) -> str:
    """Return both ends of a line that is too long."""
    half = LONGEST_LINE // 2
    return line if len(line) <= LONGEST_LINE else f"{line[:half]} … {line[-half:]}"
