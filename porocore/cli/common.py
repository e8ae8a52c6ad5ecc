"""What the commands share."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.core.echo import echo
from porocore.errors import ConfigurationError, UnexpectedError

if TYPE_CHECKING:
    from porocore.study.config.config import RunConfig

ConfigArgument = Annotated[
    Path | None,
    typer.Argument(metavar="CONFIG", help="Configuration (YAML).", show_default="the packaged benchmark"),
]
FemOption = Annotated[
    str | None,
    typer.Option("--fem", metavar="NAME", help="Finite-element backend instead of the configured one."),
]
MacroOption = Annotated[
    str | None,
    typer.Option(
        "--macro", metavar="NAME", help="Backend of the macroscale, where it is not that of the cell."
    ),
]
SurrogateOption = Annotated[
    str | None,
    typer.Option("--surrogate", metavar="NAME", help="Surrogate backend instead of the configured one."),
]
ClosureOption = Annotated[
    str | None,
    typer.Option(
        "--closure", metavar="NAME", help="mean-gradient or potential, instead of the configured one."
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", metavar="DIR", help="Run folder.", show_default="runs/<name of the configuration>"),
]
ResumeOption = Annotated[
    bool, typer.Option("--resume", help="Continue the run that the folder already holds.")
]


class Interrupted(Exception):
    """Ctrl-C; the text says how to go on."""


@contextmanager
def interruptible(advice: str = "") -> Iterator[None]:
    """Turn Ctrl-C into :class:`Interrupted`; typer would make a silent exit of it, and of the end of a stream, too."""
    try:
        yield
    except EOFError as error:
        raise UnexpectedError(f"EOFError: {error}") from error
    except KeyboardInterrupt as error:
        raise Interrupted(f"interrupted; continue with: {advice}" if advice else "interrupted") from error


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
) -> tuple[Path, RunConfig]:
    """The configuration, the packaged one for None, with the chosen backends and closure."""
    from porocore.study.backends import with_closure
    from porocore.study.benchmark import benchmark_path
    from porocore.study.config.config import load_config
    from porocore.study.run_folder.folder import CONFIG, RECORD

    path = benchmark_path() if path is None else path
    if (path / RECORD).is_file():
        raise ConfigurationError(
            f"{path}: expected a configuration file, got a run folder; its configuration is {path / CONFIG}, and "
            f"to go on with it: {command('run', path / CONFIG, '--out', path, '--resume')}"
        )
    return path, with_closure(load_config(path).with_backends(fem, surrogate, macro), closure)


def check_workers(workers: int | None) -> None:
    """Refuse a number of processes that cannot be.

    Raises
    ------
    ConfigurationError
        It is below 1, or larger than any machine has use for.
    """
    from porocore.core.models.bounds import MOST_WORKERS

    if workers is not None and not 1 <= workers <= MOST_WORKERS:
        raise ConfigurationError(f"--workers: expected 1 to {MOST_WORKERS}, got {echo(workers)}")


def command(*words: object) -> str:
    """A command to copy into a shell; None is left out."""
    return shlex.join(["porocore", *(str(word) for word in words if word is not None)])


def parse_inputs(option: str, what: str, text: str) -> dict[str, float]:
    """``"H22=-0.2,p=0.1"`` → finite numbers by name.

    Raises
    ------
    ConfigurationError
        It is something else than ``what``; names ``option``.
    """
    found: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = (word.strip() for word in part.partition("="))
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not name or name in found or not math.isfinite(number):
            raise ConfigurationError(f"{option}: expected {what}, got {echo(text)}")
        found[name] = number
    return found
