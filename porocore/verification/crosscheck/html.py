"""The crosscheck as one HTML page: worst lines, times, sections, pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from porocore.report.page import Picture, Pictures, environment
from porocore.study.run_folder.provenance import versions
from porocore.verification.crosscheck.check import CrossCheck
from porocore.verification.crosscheck.comparison import Comparison, Part
from porocore.verification.crosscheck.figure import difference_figure

#: Title, what the first column holds, and what is compared, of each part.
PARTS: dict[Part, tuple[str, str, str]] = {
    "plugin": ("Plugins", "kind", "Installed plugins that cannot be used."),
    "cell": (
        "Cell solvers",
        "state",
        "Averages and exact derivatives at three states, and the conductivity. Differences are relative to the "
        "largest component of the tensor; where an average vanishes at rest, to what an ordinary deformation of 0.1 "
        "would make of it.",
    ),
    "surrogate": (
        "Surrogates",
        "where",
        "Every surrogate was trained on the same solved states. Its largest error on held-out states, and the largest "
        "difference of every two at states between them, are shares of the range of what was solved. Two may differ by "
        "three times the sum of their own errors.",
    ),
    "body": (
        "Macro solvers",
        "law",
        "The same body under the same law. Histories are compared at every time, relative to the value there or to a "
        "hundredth of the largest, and nodal fields at the times that are kept. Below, zero is drawn at 10⁻¹⁷.",
    ),
}


@dataclass(frozen=True)
class PageSection:
    """One part on the page."""

    part: Part
    title: str
    case: str
    text: str
    lines: list[Comparison]
    pictures: list[Picture]


@dataclass(frozen=True)
class Summary:
    """One part and pair in one line."""

    title: str
    pair: str
    count: int
    failed: int
    worst: Comparison


def render(result: CrossCheck) -> str:
    """The page as text."""
    return (
        environment("porocore.verification.crosscheck")
        .get_template("page.html.j2")
        .render(
            title=result.config.title or "Crosscheck",
            comparisons=result.comparisons,
            failed=result.failed,
            worst=result.worst,
            summary=summarise(result.comparisons),
            sections=list(_sections(result)),
            times=times(result),
            provenance=versions(),
            config_text=result.config.resolved_yaml(),
        )
    )


def summarise(comparisons: tuple[Comparison, ...]) -> list[Summary]:
    """The worst line of each part and pair."""
    groups: dict[tuple[Part, str], list[Comparison]] = {}
    for line in comparisons:
        groups.setdefault((line.part, line.pair), []).append(line)
    return [
        Summary(
            PARTS[part][0],
            pair,
            len(lines),
            sum(not line.passed for line in lines),
            max(lines, key=lambda line: line.excess),
        )
        for (part, pair), lines in groups.items()
    ]


def times(result: CrossCheck) -> list[tuple[str, str, float]]:
    """Backend, work, seconds."""
    rows = [(run.backend, f"cell, {what}", s) for run in result.cells for what, s in run.seconds.items()]
    if result.samples is not None:
        count = len(result.samples.training.states) + len(result.samples.states)
        rows.append(
            (result.samples.backend, f"{count} states to learn from and to test on", result.samples.seconds)
        )
    rows += [(run.name, "training", run.seconds) for run in result.surrogates]
    rows += [(run.backend, f"body, law {run.law}", run.seconds) for run in result.bodies]
    return rows


def _sections(result: CrossCheck) -> Any:
    for part, (title, case, text) in PARTS.items():
        lines = [line for line in result.comparisons if line.part == part]
        pictures = _pictures(result) if part == "body" else []
        if lines or pictures:
            yield PageSection(part, title, case, text, lines, pictures)


def _pictures(result: CrossCheck) -> list[Picture]:
    laws = dict.fromkeys(run.law for run in result.bodies if run.solution is not None)
    return [
        Pictures().svg(
            law,
            difference_figure([run for run in result.bodies if run.law == law]),
            f"Law {law}: histories and their differences",
        )
        for law in laws
    ]
