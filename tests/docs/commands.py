"""The commands of a block of shell code, one after the other."""

from __future__ import annotations

import re
import shlex
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass

from tests.docs.pages import Block, all_blocks

#: What only a shell can make sense of.
_SHELL = re.compile(r"[$`|<>;&*?(){}~]")


@dataclass(frozen=True)
class Command:
    """One command of a page, possibly of several lines.

    ``line`` counts from 1 in the page; ``words`` are those that the shell would see, without comments, as far as
    this can be told without a shell.
    """

    page: str
    line: int
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}: {self.text}"

    @property
    def words(self) -> list[str]:
        return shlex.split(self.text, comments=True)

    @property
    def plain(self) -> bool:
        """Whether it is one program with words to be taken as they stand."""
        return not _SHELL.search(self._outside)

    @property
    def piped(self) -> bool:
        """Whether it is more than one program, or reads or writes a file by the shell."""
        return re.search(r"[|<>;&]", self._outside) is not None

    @property
    def _outside(self) -> str:
        """Without comment and what is quoted so that the shell leaves it alone."""
        return re.sub(r"'[^']*'|\"[^\"$`]*\"|\s#.*", "", self.text)

    @property
    def is_porocore(self) -> bool:
        return bool(self.words) and self.words[0].rsplit("/", 1)[-1] == "porocore"


def commands_of(block: Block) -> Iterator[Command]:
    """In order; a loop, a condition, a here-document or a continued line is one command."""
    lines: list[str] = []
    for number, line in enumerate(block.text.splitlines(), block.line):
        if not lines and (not line.strip() or line.lstrip().startswith("#")):
            continue
        lines.append(line)
        text = "\n".join(lines)
        if _complete(text):
            yield Command(block.page, number - len(lines) + 1, text)
            lines = []
    assert not lines, f"{block}: no complete command: {lines}"


def _complete(text: str) -> bool:
    if text.endswith("\\"):
        return False
    if heredoc := re.search(r"<<-?\s*['\"]?(\w+)", text):
        return re.search(rf"\n\s*{heredoc[1]}$", text) is not None
    if not re.match(r"\s*(if|for|while|until|case|\w+\s*\(\))|.*[({]$", text):
        return text.count('"') % 2 == 0 or "'" in text
    return subprocess.run(["bash", "-n", "-c", text], capture_output=True, check=False).returncode == 0


def all_commands() -> Iterator[Command]:
    """Of all pages."""
    for block in all_blocks("sh", "bash", "console", "shell"):
        yield from commands_of(block)
