"""The pages of the documentation, and what stands in them: tables and blocks of code, in order."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *ROOT.glob("docs/**/*.md"),
        *ROOT.glob("benchmarks/*.md"),
        *ROOT.glob("plugins/*/README.md"),
        *ROOT.glob("examples/calibrations/README.md"),
        *ROOT.glob("examples/plugins/*/README.md"),
    ]
)
#: An opening fence with its language, the lines below it, and a fence that is as long and as far indented.
_BLOCK = re.compile(
    r"(?:^<!-- *(?P<note>[^\n]*?) *-->\n+)?"
    r"^(?P<indent> *)(?P<fence>```+)(?P<language>[\w-]*)[^\n]*\n(?P<text>.*?)^(?P=indent)(?P=fence) *$",
    flags=re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """A block of code: where it stands, its language, its text, and the remark for tests right above it.

    ``line`` is that of the first line of ``text``, from 1; ``note`` is the text of an HTML comment, else empty.
    """

    page: str
    line: int
    language: str
    text: str
    note: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def name_of(path: Path) -> str:
    """A page by its path in the repository."""
    return path.relative_to(ROOT).as_posix()


def page(name: str) -> str:
    """The text of a file of the repository."""
    return (ROOT / name).read_text(encoding="utf-8")


def blocks_of(text: str, name: str = "") -> list[Block]:
    """All blocks of code of a page, in order; those that the page only quotes inside another one are not."""
    return [
        Block(
            name,
            text.count("\n", 0, found.start("text")) + 1,
            found["language"],
            textwrap.dedent(found["text"]),
            found["note"] or "",
        )
        for found in _BLOCK.finditer(text)
    ]


def all_blocks(*languages: str) -> Iterator[Block]:
    """The blocks of all pages in one of ``languages``."""
    for path in PAGES:
        found = blocks_of(path.read_text(encoding="utf-8"), name_of(path))
        yield from (block for block in found if block.language in languages)


def rows(text: str) -> Iterator[list[str]]:
    """Cells of every table row, without the bars."""
    for line in text.splitlines():
        if line.startswith("| "):
            cells = re.split(r"(?<!\\)\|", line)[1:-1]
            yield [cell.strip() for cell in cells]
