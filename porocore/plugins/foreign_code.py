"""Calls of a plugin's code, with exits and output caught; origin of its classes; where its code failed."""

from __future__ import annotations

import importlib.util
import io
import os
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from porocore.core.echo import shortened
from porocore.errors import PorocoreError

#: Characters of a foreign error that are shown.
MOST = 300


@dataclass(frozen=True)
class Attempt:
    """Result of a call of foreign code.

    Attributes
    ----------
    value
        What it returned; None where it raised.
    error
        What it raised; None where it returned.
    seconds
        Wall time [s].
    printed
        What was written to standard output meanwhile.
    """

    value: Any
    error: BaseException | None
    seconds: float
    printed: str


def attempt(call: Callable[..., Any], *arguments: Any) -> Attempt:
    """Call foreign code; it can neither end the program nor write into its output. Ctrl-C goes through."""
    began = time.perf_counter()
    value, error = None, None
    with _standard_output_kept() as printed:
        try:
            value = call(*arguments)
        except KeyboardInterrupt:
            raise
        except BaseException as raised:  # noqa: BLE001 - sys.exit and its like are faults of the plugin here
            error = raised
    return Attempt(value, error, time.perf_counter() - began, printed())


@contextmanager
def _standard_output_kept() -> Iterator[Callable[[], str]]:
    """Keep the standard output of Python, libraries and child processes; yield a function that returns it."""
    python, kept = io.StringIO(), ""
    with suppress(AttributeError, OSError, ValueError):  # where there is none, or it is closed
        sys.stdout.flush()
    with tempfile.TemporaryFile() as file:
        try:
            before = os.dup(1)
        except OSError:  # closed, as in a daemon
            before = None
        if before is not None:
            os.dup2(file.fileno(), 1)
        try:
            with redirect_stdout(python):
                yield lambda: python.getvalue() + kept
        finally:
            if before is not None:
                os.dup2(before, 1)
                os.close(before)
            file.seek(0)
            kept = file.read().decode("utf-8", "replace")


_KNOWN: WeakKeyDictionary[type, str] = WeakKeyDictionary()


def note_origin(implementation: type, words: str) -> None:
    """Remember where a class comes from, such as "sampler 'halton' of acme 1.0"."""
    _KNOWN[implementation] = words


def origin_of(thing: object) -> str:
    """Return where the class of an object comes from, with its file."""
    classes = type(thing).__mro__
    known = next((cls for cls in classes if cls in _KNOWN), classes[0])
    file = getattr(sys.modules.get(known.__module__), "__file__", None)
    words = _KNOWN.get(known, known.__name__)
    return f"{words} ({file})" if file else words


def reason_of(error: BaseException) -> str:
    """Return a failure in foreign code in one line: its class and the first words of its message."""
    try:
        text = " ".join(str(error).split())
    except Exception:  # noqa: BLE001 - an error that cannot be told is still one
        text = "its message cannot be read"
    text = shortened(text, MOST)
    # Errors that porocore raises say who is meant.
    return text if isinstance(error, PorocoreError) else f"{type(error).__name__}: {text}".removesuffix(": ")


def place_of(error: BaseException, module: str) -> str:
    """Return file and line at which the package of ``module`` failed; its file where no line of it was reached."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}:{error.lineno}"
    roots = _roots(module)
    lines = [
        f"{frame.filename}:{frame.lineno}"
        for frame in traceback.extract_tb(error.__traceback__)
        if any(frame.filename == root or frame.filename.startswith(f"{root}{os.sep}") for root in roots)
    ]
    return lines[-1] if lines else file_of(module)


def file_of(module: str) -> str:
    """Return the file of a module, found without importing it; empty where there is none."""
    rest = module.split(".")[1:]
    for root in map(Path, _roots(module)):
        if not rest and root.is_file():
            return str(root)
        inside = root.joinpath(*rest)
        for path in (inside.with_suffix(".py"), inside / "__init__.py"):
            if path.is_file():
                return str(path)
    return ""


def _roots(module: str) -> list[str]:
    """Return the folders of the package of a module, or its one file."""
    try:
        spec = importlib.util.find_spec(module.partition(".")[0])
    except (ImportError, ValueError, AttributeError):
        return []
    if spec is None:
        return []
    return list(spec.submodule_search_locations or ()) or ([spec.origin] if spec.origin else [])
