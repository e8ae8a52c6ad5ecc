"""Helpers of several commands: reading a configuration, interruption, store, tables on standard output."""

from __future__ import annotations

import math
import os
import re
import shlex
import signal
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer

from porocore.core.echo import comma_advice, cut, did_you_mean, echo
from porocore.core.parallel import launched
from porocore.errors import ConfigurationError, UnexpectedError

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from porocore.core.files.store import ResultStore
    from porocore.core.units import ResultUnits, Scales
    from porocore.study.config.config import RunConfig
    from porocore.study.run.folder import RunFolder


#: Exit status after Ctrl-C, and after SIGTERM.
INTERRUPTED, TERMINATED = 130, 143


class Interrupted(Exception):
    """Ctrl-C or SIGTERM, with the command to continue as text and the exit status."""

    def __init__(self, message: str, status: int = INTERRUPTED) -> None:
        super().__init__(message)
        self.status = status


def in_units_of(units: ResultUnits) -> AbstractContextManager[None]:
    """Return a context whose messages have these units."""
    from porocore.core.units import using_units

    return using_units(units)


@contextmanager
def interruptible(advice: str = "") -> Iterator[None]:
    """Acknowledge Ctrl-C or SIGTERM and turn it into :class:`Interrupted`; typer would end silently, as at an EOF."""
    from porocore.sampling.execution.interrupts import listening

    message = f"interrupted; continue with: {advice}" if advice else "interrupted"
    came: set[int] = set()

    def status() -> int:
        return TERMINATED if signal.SIGTERM in came else INTERRUPTED

    def say(text: str) -> None:
        if launched()[0] == 0:
            print(text, file=sys.stderr, flush=True)

    def end() -> None:
        # The bar of a terminal hides the cursor.
        say(f"\x1b[?25h\n{message}" if sys.stderr.isatty() else message)
        os._exit(status())

    try:
        with listening(say, end, came):
            yield
    except EOFError as error:
        raise UnexpectedError(f"EOFError: {error}") from error
    except KeyboardInterrupt as error:
        raise Interrupted(message, status()) from error


@contextmanager
def located(path: Path) -> Iterator[None]:
    """Put file and line before every complaint about a key of the configuration at ``path``."""
    from porocore.core.files.yaml_document import YamlDocument
    from porocore.study.config import errors as config_errors

    with config_errors.located(YamlDocument.read(path)):
        yield


def read_config(
    path: Path | None,
    fem: str | None,
    surrogate: str | None = None,
    closure: str | None = None,
    macro: str | None = None,
    cell_only: bool = False,
) -> tuple[Path, RunConfig]:
    """Return path and configuration, the packaged one for None, with the chosen backends and closure.

    With ``cell_only`` the file need not say more than a cell.
    """
    from porocore.study.config.config import with_closure
    from porocore.study.config.loading import benchmark_path, load_config
    from porocore.study.run.folder import CONFIG, RECORD

    path = benchmark_path() if path is None else path
    require_no_result(path)
    if (path / RECORD).is_file():
        raise ConfigurationError(
            f"{path}: expected a configuration file, got a run folder; its configuration is {path / CONFIG}, and "
            f"to go on with it: {command('run', path / CONFIG, '--out', path, '--resume')}"
        )
    return path, with_closure(load_config(path, cell_only).with_backends(fem, surrogate, macro), closure)


def require_no_result(path: Path) -> None:
    """Refuse a result of a run, such as its metrics, in the place of a configuration."""
    from porocore.study.run.folder import CONFIG, RECORD

    of_a_run = path.is_file() and (path.parent / RECORD).is_file()
    if of_a_run and path.suffix not in (".yaml", ".yml"):
        raise ConfigurationError(
            f"{path}: expected a configuration file, got a file of the run folder {path.parent}, whose configuration "
            f"is {path.parent / CONFIG}"
        )


def failed(text: str) -> NoReturn:
    """End the command with exit status 1 and a message about checks that failed."""
    typer.secho("failed: ", fg=typer.colors.RED, bold=True, err=True, nl=False)
    typer.echo(text, err=True)
    raise typer.Exit(1)


def claim(path: Path, settings: RunConfig, out: Path | None, resume: bool) -> RunFolder:
    """Return the run folder of the configuration at ``path``, ``out`` or one by its name, made or opened."""
    from porocore.study.run.folder import RECORD, RunFolder

    place = Path("runs") / path.stem if out is None else out
    note_nothing_to_resume(place, RECORD, "run", resume=resume)
    return RunFolder.claim(place, settings, resume=resume)


def note_nothing_to_resume(place: Path, record: str, work: str, *, resume: bool) -> None:
    """Say on standard error that ``--resume`` finds no folder, and folders with a similar name that hold such work."""
    if not resume or place.exists():
        return
    from porocore.core.console import Console

    beside = place.parent.iterdir() if place.parent.is_dir() else ()
    names = [each.name for each in beside if (each / record).is_file()]
    question = did_you_mean(place.name, names)
    Console().note(f"nothing to resume in {place}; a new {work} begins{f'; {question}' if question else ''}")


def chosen_store(store: Path | None, no_store: bool) -> ResultStore | None:
    """Return the store of the options ``--store`` and ``--no-store``.

    Raises
    ------
    ConfigurationError
        Both are given, or the path leads to a file or nowhere.
    """
    from porocore.core.files.reading import obstacle
    from porocore.study import store as stores

    if no_store and store is not None:
        raise ConfigurationError("--store and --no-store exclude each other; leave one out")
    if store is not None and (found := obstacle(store)):
        raise ConfigurationError(f"--store {store}: {found}; choose another")
    if store is not None and store.exists() and not store.is_dir():
        raise ConfigurationError(f"--store {store}: expected a folder, got a file; choose another")
    return stores.chosen_store(False if no_store else True if store is None else store)


def check_workers(workers: int | None) -> None:
    """Refuse a number of processes that is out of bounds.

    Raises
    ------
    ConfigurationError
        The number is below 1 or above the limit.
    """
    from porocore.core.models.bounds import MOST_WORKERS

    if workers is not None and not 1 <= workers <= MOST_WORKERS:
        raise ConfigurationError(f"--workers: expected 1 to {MOST_WORKERS}, got {echo(workers)}")


def command(*words: object, **options: object) -> str:
    """Return a command to copy into a shell.

    Parameters
    ----------
    *words
        Name and arguments of the command; None is left out.
    **options
        Values by option: True for a flag alone, a sequence for an option that is repeated, None or False for one that
        is left out.
    """
    said = [str(word) for word in words if word is not None]
    for name, given in options.items():
        option = f"--{name.replace('_', '-')}"
        for value in given if isinstance(given, list | tuple) else [given]:
            if value is not None and value is not False:
                said += [option] if value is True else [option, str(value)]
    return shell_line(["porocore", *said])


def shell_line(words: Sequence[str]) -> str:
    """Return words as a line for the shells of this system."""
    if sys.platform == "win32":
        from subprocess import list2cmdline

        return list2cmdline(words)
    return shlex.join(words)


def parse_pressure(option: str, text: str, scales: Scales | None) -> float:
    """Return the dimensionless pressure of a text such as ``0.1`` or ``1 kPa``.

    Raises
    ------
    ConfigurationError
        It is no pressure, or has a unit where the configuration has no scales; the message names ``option``.
    """
    from porocore.core.units import UnitError, value_of

    try:
        value = value_of(text, "pressure", scales)
    except UnitError as error:
        raise ConfigurationError(f"{option}: {error}") from None
    if not math.isfinite(value):
        raise ConfigurationError(f"{option}: expected a finite number, got {text}")
    return value


def _commas_in(text: str) -> str:
    """Return the advice on the first decimal comma among values such as ``H22=-0,1,p=0.1``; empty where none is one."""
    values = (part.partition("=")[2] for part in re.split(r",(?=\s*\w+\s*=)", text))
    return next(filter(None, map(comma_advice, values)), "")


def parse_inputs(option: str, what: str, text: str, scales: Scales | None = None) -> dict[str, float]:
    """Return finite numbers by name from a text such as ``"H22=-0.2,p=0.1"``; with ``scales`` p may have a unit.

    Raises
    ------
    ConfigurationError
        The text is not ``what``; the message names ``option``.
    """
    found: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = (word.strip() for word in part.partition("="))
        if name == "p" and value and name not in found:
            found[name] = parse_pressure(f"{option} p", value, scales)
            continue
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not name or "=" not in part:
            raise ConfigurationError(f"{option}: expected {what}, got {echo(text)}{_commas_in(text)}")
        if name in found:
            raise ConfigurationError(f"{option}: {cut(name)} is given twice; expected {what}")
        if not math.isfinite(number):
            raise ConfigurationError(
                f"{option}: {cut(name)}: expected a finite number, got {echo(value)}; write {what}"
            )
        found[name] = number
    return found


#: Columns of a page where standard output is no terminal.
WIDTH = 130
MINUS = str.maketrans("-", "−")


def page(width: int = WIDTH) -> Console:
    """Return the console of the results, as wide as the terminal, or ``width`` without one."""
    from rich.console import Console

    return Console(width=None if sys.stdout.isatty() else width, highlight=False)


def plain_table(headings: Sequence[str], numbers: Collection[int] = (), title: str | None = None) -> Table:
    """Return a table without lines; the columns in ``numbers`` are aligned to the right."""
    from rich.table import Table
    from rich.text import Text

    # A text is no markup, in which a unit in brackets is lost.
    table = Table(title_justify="left", title_style="", box=None, pad_edge=False, header_style="bold")
    table.title = None if title is None else Text(title)
    for i, heading in enumerate(headings):
        right = i in numbers
        table.add_column(Text(heading), justify="right" if right else "left", no_wrap=right)
    return table


def decimals(value: float, digits: int) -> str:
    """Return a number with so many decimals; a dash for NaN and infinity."""
    return "–" if not math.isfinite(value) else f"{value + 0.0:.{digits}f}".translate(MINUS)
