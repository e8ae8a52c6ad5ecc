"""Cases of the table of strangers' files: a command on the files of one folder, and what it must answer."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.helpers.command_run import Ended

#: One folder of files for each kind of trial, with a README of one line.
FOLDERS = Path(__file__).parents[1] / "strangers"


@dataclass(frozen=True)
class Case:
    """One command on the files of a stranger.

    Attributes
    ----------
    folder
        The folder below ``tests/strangers`` whose files are copied into the empty working folder.
    words
        The command line behind ``porocore``, with paths relative to the working folder; or a text that tells what
        ``check`` does from Python, where no command is run.
    status
        The exit status.
    says
        Words that standard output and standard error must contain; white space counts as one blank.
    never
        Words that they must not contain.
    check
        Called in the working folder with how the command ended, or with None: holds results to their right values.
    before
        Called with the working folder before the command: what a file cannot hold.
    own_process
        For what closes its streams or ends its process.
    slow
        For the slow suite.
    """

    folder: str
    words: tuple[str, ...] | str
    status: int = 0
    says: tuple[str, ...] = ()
    never: tuple[str, ...] = ()
    check: Callable[[Path, Ended | None], None] | None = None
    before: Callable[[Path], None] | None = None
    own_process: bool = False
    slow: bool = False

    @property
    def name(self) -> str:
        """The folder and the command line."""
        words = self.words if isinstance(self.words, str) else " ".join(self.words)
        return f"{self.folder}: {words}"

    def make_files(self, folder: Path) -> None:
        """Copy the files of the stranger into ``folder``, which does not exist."""
        shutil.copytree(FOLDERS / self.folder, folder)
