"""Exceptions that nobody expected: the whole goes to a file, one line says where that is."""

from __future__ import annotations

import os
import platform
import shlex
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from uuid import uuid4

from porocore.core.echo import shortened
from porocore.errors import UnexpectedError

#: Characters of an exception's own words in the line.
MOST = 200
#: Distributions whose versions are listed.
_PACKAGES = (
    "porocore", "porocore-fem-skfem", "porocore-fem-dolfinx", "porocore-surrogate-torch", "porocore-surrogate-jax",
    "numpy", "scipy", "h5py", "scikit-fem", "torch", "jax", "pydantic", "typer", "gmsh", "meshio",
)  # fmt: skip
_FOLDER = "_porocore_folder"


def note_folder(error: BaseException | None, folder: Path) -> None:
    """Remember on an exception the run folder that it came out of, where its file will go."""
    if error is not None and not hasattr(error, _FOLDER):
        with suppress(AttributeError):  # of a class with slots
            setattr(error, _FOLDER, folder)


def describe(error: BaseException) -> str:
    """Return one line on an exception that nobody expected, after writing the whole of it to a file.

    The file is in the run folder that the exception came out of, else in the user's folder for such things
    (``$XDG_STATE_HOME/porocore``), else among the temporary files. Where none can be written, the line says so.
    """
    kind = "memory ran out" if isinstance(error, MemoryError) else f"unexpected {_name(type(error))}"
    if isinstance(error, UnexpectedError):
        kind = "unexpected"
    words = " ".join(str(error).split())
    said = f"{kind}: {shortened(words, MOST)}" if words else kind
    try:
        written = f"the whole of it is in {_write(error)}"
    except OSError as fault:
        written = f"no file could be written that holds the whole of it ({fault.strerror or fault})"
    if isinstance(error, MemoryError):
        return f"{said}; take a coarser mesh, fewer states or fewer workers; {written}"
    return f"{said} ({_place(error)}), a fault of porocore or of a plugin; {written}; please report it"


def _name(kind: type[BaseException]) -> str:
    """Return the name of a class, with its module where that is not Python's own."""
    return kind.__qualname__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__qualname__}"


def _place(error: BaseException) -> str:
    """Return module and line where an exception was raised."""
    frames = list(traceback.walk_tb(error.__traceback__))
    if not frames:
        return "outside of Python"
    frame, line = frames[-1]
    return f"{frame.f_globals.get('__name__', '?')}, line {line}"


def _write(error: BaseException) -> Path:
    """Write the file, in the first folder that takes it.

    Raises
    ------
    OSError
        None does.
    """
    name = f"porocore-error-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}-{uuid4().hex[:4]}.txt"
    text = _text(error).encode(errors="backslashreplace")
    refused: OSError | None = None
    for folder in _folders(error):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            path = folder / name
            # Never through a link that somebody has put there, nor over a file.
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
            with os.fdopen(os.open(path, flags, 0o600), "wb") as file:
                file.write(text)
            return path
        except OSError as fault:
            refused = refused or fault
    assert refused is not None
    raise refused


def _folders(error: BaseException) -> Iterator[Path]:
    folder = getattr(error, _FOLDER, None)
    if isinstance(folder, Path) and folder.is_dir():
        yield folder
    state = os.environ.get("XDG_STATE_HOME")
    with suppress(RuntimeError):  # no home
        yield (Path(state) if state else Path.home() / ".local" / "state") / "porocore"
    with suppress(OSError):
        yield Path(tempfile.gettempdir())


def _text(error: BaseException) -> str:
    """Return the whole: command line, versions, platform, traceback."""
    details = error.details if isinstance(error, UnexpectedError) else ""
    return "\n".join(
        [
            f"command: {shlex.join(sys.argv)}",
            f"folder: {_current_folder()}",
            f"time: {time.strftime('%Y-%m-%d %H:%M:%S %z')}",
            f"python: {platform.python_version()}, {sys.executable}",
            f"platform: {platform.platform()}",
            f"versions: {', '.join(_versions())}",
            "",
            "".join(traceback.format_exception(error)).rstrip(),
            *(["", "where it was first raised:", details.rstrip()] if details else []),
            "",
        ]
    )


def _versions() -> Iterator[str]:
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):
            yield f"{name} {version(name)}"


def _current_folder() -> str:
    try:
        return os.getcwd()
    except OSError as error:
        return f"none ({error.strerror})"
