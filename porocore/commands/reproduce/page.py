"""Pages of a reproduction: tables in Markdown, and with all figures in HTML; count of verdicts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

from porocore.commands.reproduce.catalogue import PaperFigure
from porocore.commands.reproduce.claims import CheckedClaim
from porocore.report.format import duration
from porocore.report.page import environment

TITLE = "Dehghani & Zilian (2022), recomputed"
SOURCE = (
    "H. Dehghani and A. Zilian, Finite strain poro-hyperelasticity: an asymptotic multi-scale ALE-FSI approach "
    "supported by ANNs (2022)."
)
INTRODUCTION = (
    "Every number and every statement of the paper's numerical sections beside what porocore computes. The cell has "
    "channels of radius 0.25 and a Poisson's ratio of 0.35, which the published K, M and Q belong to; the paper's "
    "text says 0.2. Everything is dimensionless with E = 1. Figures are numbered as in the paper."
)
PARTS = (
    ("cell", "The cell"),
    ("cost", "Sampling, network and cost"),
    ("column", "The column"),
)


def verdicts(parts: Mapping[str, Sequence[CheckedClaim]]) -> str:
    """Return a sentence that counts the verdicts."""
    counts = Counter(row.verdict for rows in parts.values() for row in rows)
    return (
        f"Of {sum(counts.values())} rows, {counts['yes']} agree, {counts['partly']} agree in part, "
        f"{counts['no']} do not, and {counts['–']} have nothing to agree with (settings, times on other machines)."
    )


def markdown(parts: Mapping[str, Sequence[CheckedClaim]], command: str, timings: Mapping[str, float]) -> str:
    """The tables, to be kept as a document.

    Parameters
    ----------
    parts
        Rows by the keys of :data:`PARTS`.
    command
        Command that made the tables.
    timings
        Seconds of each part of the computation.
    """
    lines = [f"# {TITLE}", "", SOURCE, "", INTRODUCTION, "", verdicts(parts), ""]
    lines += [
        f"This page is written by `{command}`, together with all figures, in {duration(sum(timings.values()))}."
    ]
    for key, title in PARTS:
        lines += ["", f"## {title}", "", "| where | published | porocore | agrees |", "|---|---|---|---|"]
        for row in parts[key]:
            found = row.found + (f". {row.why[0].upper()}{row.why[1:]}" if row.why else "")
            lines.append(f"| {row.where} | {_cell(row.said)} | {_cell(found)} | {row.verdict} |")
    return "\n".join(lines) + "\n"


def html(
    parts: Mapping[str, Sequence[CheckedClaim]], figures: Sequence[PaperFigure], timings: Mapping[str, float]
) -> str:
    """The page with tables and figures, which lie beside it in ``figures/``."""
    return (
        environment("porocore.commands.reproduce")
        .get_template("page.html.j2")
        .render(
            title=TITLE,
            source=SOURCE,
            introduction=INTRODUCTION,
            verdicts=verdicts(parts),
            parts=[(key, title, parts[key]) for key, title in PARTS],
            figures=figures,
            timings=timings,
            total=sum(timings.values()),
        )
    )


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
