"""Atomic writing of a file (atomic_path), new folders for results, refusal of a place inside a run."""

from __future__ import annotations

import errno
import os
import re
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from porocore.core.echo import reason
from porocore.core.files.reading import obstacle, require_ordinary
from porocore.errors import RunFolderError

#: Bytes of a file's name that leave room for that of its temporary one.
LONGEST_NAME = 230
#: A folder with a file of this name holds a run.
RUN_RECORD = "run.json"
#: Errors of the system where a disk or a quota is full.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def file_stem(name: str) -> str:
    """Return a name as that of a file: ASCII letters, numbers and signs that no system minds."""
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    return re.sub(r"[^A-Za-z0-9._=,-]+", "-", plain).strip("-")


def new_folder(path: Path) -> Path:
    """Make a folder for results before the work for them begins, and return it.

    Raises
    ------
    RunFolderError
        It cannot be made or written, or it is a run folder or in one.
    """
    require_outside_a_run(path)
    require_a_way(path)
    require_no_file(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        if not os.access(path, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise RunFolderError(
            f"{path}: expected a folder that can be written: {error.strerror or error}; choose another --out"
        ) from None
    return path


def require_a_way(path: Path, option: str = "--out") -> None:
    """Refuse a place at or below a symbolic link that leads nowhere, or below a file.

    Raises
    ------
    RunFolderError
        It is one.
    """
    if found := obstacle(path):
        mend = "remove or mend that link, or " if "symbolic link" in found else ""
        raise RunFolderError(f"{option} {path}: {found}; {mend}choose another {option}")


def require_no_file(path: Path) -> None:
    """Refuse the path of something that is no folder as that of a folder.

    Raises
    ------
    RunFolderError
        It is one.
    """
    if path.exists() and not path.is_dir():
        raise RunFolderError(f"{path}: expected a folder, got a file; choose another --out")


def require_outside_a_run(path: Path) -> None:
    """Refuse a place among the files of a run, which belong to that run alone.

    Raises
    ------
    RunFolderError
        It is a run folder or in one, or it cannot be looked at.
    """
    try:
        for above in (path, *path.parents):
            if (above / RUN_RECORD).is_file():
                where = "a run folder" if above == path else f"in the run folder {above}"
                raise RunFolderError(
                    f"{path} is {where}, whose files belong to its run; choose another --out"
                )
    except OSError as error:
        raise RunFolderError(f"{path}: {error.strerror or error}; choose another --out") from None


def place_for(path: Path, option: str = "--out") -> Path:
    """Return ``path`` if a file can be written there, before the work for it begins; its folder is made.

    Raises
    ------
    RunFolderError
        It cannot, or something is there that is no file.
    """
    require_a_way(path, option)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if os.path.lexists(path):
            require_ordinary(path)
        elif not os.access(path.parent, os.W_OK | os.X_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        elif len(os.fsencode(path.name)) > LONGEST_NAME:
            raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
    except OSError as error:
        raise RunFolderError(
            f"{option} {path}: no file can be written there: {error.strerror or error}; choose another"
        ) from None
    return path


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; it replaces ``path``, synchronised to the disk, if the block succeeds.

    Raises
    ------
    RunFolderError
        The disk is full or read-only; ``path`` is as it was before.
    """
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists():
            require_ordinary(path)  # a device would become a file
        yield part
        with open(part, "rb+") as file:
            os.fsync(file.fileno())
        os.replace(part, path)
    except OSError as error:
        advice = "make room or choose another --out" if error.errno in FULL else "choose another --out"
        raise RunFolderError(f"cannot write {path}: {reason(error)}; {advice}") from None
    finally:
        with suppress(OSError):  # not only a missing file: the error above is the one to tell
            part.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a text file whole, in UTF-8 and with the same ends of lines on every system.

    Raises
    ------
    RunFolderError
        The disk is full or read-only.
    """
    with atomic_path(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")
