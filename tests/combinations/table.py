"""Run rows of the table and print what came out as Markdown: ``python tests/combinations/table.py [SEED [ROW...]]``."""

from __future__ import annotations

import sys
import tempfile
import traceback
from pathlib import Path

import numpy as np
from levels import FACTORS
from pairs import all_pairs
from row_runs import Outcome, run_row

HEADINGS = (*FACTORS, "cells", "bodies", "two processes", "s")


def line(row: dict[str, str], outcome: Outcome) -> str:
    """Return the row of the table."""
    if outcome.refused:
        figures = [f"refused: {outcome.refused.splitlines()[0]}", "", "", f"{outcome.seconds:.0f}"]
    else:
        numbers = (outcome.cells, outcome.bodies, outcome.processes)
        figures = ["–" if np.isnan(x) else f"{x:.0e}" for x in numbers] + [f"{outcome.seconds:.0f}"]
    return "| " + " | ".join([*row.values(), *figures]) + " |"


def main() -> int:
    """Run all rows of a seed; the status is 1 where one could not be run."""
    rows = all_pairs(FACTORS, int(sys.argv[1]) if len(sys.argv) > 1 else 0)
    chosen = [rows[int(k)] for k in sys.argv[2:]] or rows
    print("| " + " | ".join(HEADINGS) + " |\n|" + "---|" * len(HEADINGS), flush=True)
    failed = 0
    for row in chosen:
        with tempfile.TemporaryDirectory() as folder:
            try:
                print(line(row, run_row(row, Path(folder))), flush=True)
            except Exception:  # noqa: BLE001 - the other rows go on
                failed += 1
                print("| " + " | ".join([*row.values(), "FAILED |"]), flush=True)
                traceback.print_exc()
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
