"""Files of docs/architecture.md, each with the first line of its docstring: those of the tree, and the list below it.

.venv/bin/python docs/make_architecture.py [--check]

The files of the second level have their lines in the tree, whose rooms are described by hand. The list between the
comments ``<!-- files -->`` and ``<!-- end -->`` has the sub-rooms and the plugins with all their files. With --check
nothing is written; the exit status is 1 where the page is not what this makes.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "architecture.md"
#: Column at which the first lines begin.
COLUMN = 25


def first_line(path: Path) -> str:
    """Return the first line of the docstring of a module."""
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    return (docstring or "").partition("\n")[0].replace("``", "`")


def in_the_tree(path: Path) -> str:
    """Return the first line of a module as the tree has it, without capital and full stop."""
    text = first_line(path).removesuffix(".")
    return text[0].lower() + text[1:] if text[1:2].islower() else text


def with_tree(page: str) -> str:
    """Return the page whose tree has the entries that are there, in the order of the page, and their first lines.

    Rooms keep their line of the page; a new room gets the first line of its ``__init__.py``.
    """
    found = re.search(r"(?<=^```\nporocore/\n).*?(?=^```$)", page, re.MULTILINE | re.DOTALL)
    assert found, "docs/architecture.md has no tree that begins with porocore/"
    rows: dict[str, str] = {}
    above = ""
    for row in found[0].splitlines():
        name = row.split(maxsplit=1)[0]
        if len(row) - len(row.lstrip()) == 2:
            above = name if name.endswith("/") else ""
            rows[name] = row
        else:
            rows[above + name] = row

    def lines(folder: Path, depth: int) -> Iterator[str]:
        there = {path.name for path in folder.glob("*.py")} | {
            f"{path.parent.name}/" for path in folder.glob("*/__init__.py")
        }
        if depth > 2:
            there.discard("__init__.py")
        key = "" if depth == 2 else f"{folder.name}/"
        order = list(rows)
        for name in sorted(
            there, key=lambda each: (order.index(key + each) if key + each in rows else len(order), each)
        ):
            path = folder / name
            if name.endswith(".py") and name != "__init__.py":
                yield f"{' ' * depth}{name}".ljust(COLUMN - 1) + f" {in_the_tree(path)}"
            elif key + name in rows:
                yield rows[key + name]
            else:
                yield f"{' ' * depth}{name}".ljust(COLUMN - 1) + f" {in_the_tree(path / '__init__.py')}"
            if name.endswith("/") and depth == 2:
                yield from lines(path, 4)

    made = "".join(f"{line}\n" for line in lines(ROOT / "porocore", 2))
    return page[: found.start()] + made + page[found.end() :]


def listed() -> Iterator[str]:
    """Yield the lines of the list: each sub-room and each plugin, and its files below it."""
    rooms = sorted(path.parent for path in (ROOT / "porocore").glob("*/*/__init__.py"))
    plugins = sorted(path.parent for path in (ROOT / "plugins").glob("*/porocore_*/__init__.py"))
    for folder in [*rooms, *plugins]:
        yield ""
        yield f"{folder.relative_to(ROOT)}/: {first_line(folder / '__init__.py')}"
        for path in sorted(folder.glob("*.py")):
            if path.name != "__init__.py":
                yield f"    {path.name}".ljust(COLUMN - 1) + f" {first_line(path)}"


def with_files(page: str) -> str:
    """Return the page with the first lines of all files, in the tree and in the list."""
    files = re.compile(r"^<!-- files -->\n.*?^<!-- end -->$", re.MULTILINE | re.DOTALL)
    made = "\n".join(["<!-- files -->", "```", *list(listed())[1:], "```", "<!-- end -->"])
    return files.sub(lambda _: made, with_tree(page))


def main() -> None:
    """Write the page, or tell whether it is up to date."""
    text = PAGE.read_text(encoding="utf-8")
    made = with_files(text)
    if sys.argv[1:] == ["--check"]:
        if made != text:
            sys.exit(f"{PAGE} is out of date; run .venv/bin/python docs/make_architecture.py")
    else:
        PAGE.write_text(made, encoding="utf-8")


if __name__ == "__main__":
    main()
