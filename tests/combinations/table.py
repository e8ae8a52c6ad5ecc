"""Run rows of the table, or put what came out into its page.

``table.py [SEED [ROW...]]`` runs rows and prints them as Markdown. ``table.py --page FILE...`` reads such output of
seed 0, in any order, and writes it into docs/combinations.md; a later file replaces rows of an earlier one, and the
page itself may be the first.
"""

from __future__ import annotations

import sys
import tempfile
import traceback
from pathlib import Path

import numpy as np

from tests.combinations.levels import FACTORS
from tests.combinations.pairs import all_pairs
from tests.combinations.row_runs import Outcome, run_row

PAGE = Path(__file__).parents[2] / "docs" / "combinations.md"
FIGURES = ("cells", "bodies", "two processes")
HEADINGS = (*FACTORS, *FIGURES, "s")


def line(row: dict[str, str], outcome: Outcome) -> str:
    """Return the row of the table."""
    if outcome.refused:
        figures = [f"refused: {outcome.refused.splitlines()[0]}", "", "", f"{outcome.seconds:.0f}"]
    else:
        numbers = (outcome.cells, outcome.bodies, outcome.processes)
        figures = ["–" if np.isnan(x) else f"{x:.0e}" for x in numbers] + [f"{outcome.seconds:.0f}"]
    return "| " + " | ".join([*row.values(), *figures]) + " |"


def header(*before: str) -> str:
    """Return the first two lines of the table."""
    headings = (*before, *HEADINGS)
    return "| " + " | ".join(headings) + " |\n|" + "---|" * len(headings)


def cells_of(text: str) -> dict[tuple[str, ...], list[str]]:
    """Return what stands in the columns after the levels, by levels; of the page, or as printed without a number."""
    found = {}
    for printed in filter(lambda text: text.startswith("| "), text.splitlines()):
        cells = [cell.strip() for cell in printed.strip("| ").split("|")][-len(HEADINGS) :]
        if len(cells) == len(HEADINGS) and cells[: len(FACTORS)] != list(FACTORS):
            found[tuple(cells[: len(FACTORS)])] = cells[len(FACTORS) :]
    return found


def factors() -> str:
    """Return the factors and their levels."""
    lines = [f"| {name} | {', '.join(levels)} |" for name, levels in FACTORS.items()]
    return "\n".join(["| factor | levels |", "|---|---|", *lines])


def result(found: dict[tuple[str, ...], list[str]]) -> str:
    """Return all rows of seed 0 below the largest differences.

    Raises
    ------
    KeyError
        A row was not found.
    """
    lines, numbers = [header("row")], []
    for number, row in enumerate(all_pairs(FACTORS, 0)):
        figures = found[tuple(row.values())]
        if not figures[0].startswith("refused"):
            numbers.append([float(x) for x in figures[: len(FIGURES)]])
        lines.append(f"| {number} | " + " | ".join([*row.values(), *figures]) + " |")
    largest = ", ".join(f"{x:.0e} ({name})" for name, x in zip(FIGURES, np.max(numbers, axis=0), strict=True))
    return (
        f"{len(numbers)} of {len(lines) - 1} rows ran. The largest differences are {largest}.\n\n"
        + "\n".join(lines)
    )


def write_page(files: list[str]) -> None:
    """Put the factors, all rows of seed 0 and the largest differences between the marks of the page."""
    found: dict[tuple[str, ...], list[str]] = {}
    for file in files:
        found |= cells_of(Path(file).read_text(encoding="utf-8"))
    page = PAGE.read_text(encoding="utf-8")
    for name, body in (("factors", factors()), ("result", result(found))):
        begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
        before, _, rest = page.partition(begin)
        page = f"{before}{begin}\n\n{body}\n\n{end}{rest.partition(end)[2]}"
    PAGE.write_text(page, encoding="utf-8")


def run_rows(seed: int, numbers: list[int]) -> int:
    """Run rows of a seed, all where none is given; the status is 1 where one could not be run."""
    rows = all_pairs(FACTORS, seed)
    print(header(), flush=True)
    failed = 0
    for row in [rows[number] for number in numbers] or rows:
        with tempfile.TemporaryDirectory() as folder:
            try:
                print(line(row, run_row(row, Path(folder))), flush=True)
            except Exception:  # noqa: BLE001 - the other rows go on
                failed += 1
                print("| " + " | ".join([*row.values(), "FAILED |"]), flush=True)
                traceback.print_exc()
    return min(failed, 1)


def main() -> int:
    """Do what the command line says."""
    words = sys.argv[1:]
    if words[:1] == ["--page"]:
        write_page(words[1:])
        return 0
    return run_rows(int(words[0]) if words else 0, [int(word) for word in words[1:]])


if __name__ == "__main__":
    sys.exit(main())
