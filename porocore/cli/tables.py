"""Tables on standard output: console, plain tables, numbers with decimals."""

from __future__ import annotations

import math
import sys
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

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
