"""Files of a crosscheck: the JSON document, and one HTML page with its figure, worst lines, times, sections."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from porocore.commands.crosscheck.bodies import BodyRun, history_difference
from porocore.commands.crosscheck.check import CrossCheck, document
from porocore.commands.crosscheck.comparison import BODY, Comparison, Part
from porocore.commands.crosscheck.relaxation import PathRun
from porocore.core.fields import provided
from porocore.core.files.atomic import write_text
from porocore.core.files.plain_data import write_json
from porocore.report.figures.style import DASHED, DOTTED, GREY, TIME_COLOURS, legend_above, new_figure, styled
from porocore.report.page import Picture, Pictures, environment
from porocore.study.run.folder import versions

PANELS = {
    "displacement": "largest displacement max$|u|$ [–]",
    "pressure_max": "largest pore pressure $p\\,/E$ [–]",
    "drained": "drained volume [–]",
}
#: What is smaller is drawn here: a difference of zero has no place on a logarithmic axis.
LEAST = 1e-17


@styled
def difference_figure(runs: Sequence[BodyRun]) -> Figure:
    """One law; three histories side by side.

    Parameters
    ----------
    runs
        Of one law, at least one with a solution.

    Returns
    -------
    Figure
        Above, the histories of every macro solver; below, the relative difference of every pair with the
        same time steps, logarithmic, with the tolerance.
    """
    solved = [(run.backend, run.solution.history) for run in runs if run.solution is not None]
    pairs = list(combinations(range(len(solved)), 2))
    figure = new_figure(11.5, 5.6 if pairs else 3.4)
    rows = 2 if pairs else 1
    ratios = (1.25, 1)[:rows]
    panels = figure.subplots(rows, 3, sharex=True, squeeze=False, gridspec_kw={"height_ratios": ratios})
    for column, (name, label) in enumerate(PANELS.items()):
        axes = panels[0, column]
        for i, (backend, history) in enumerate(solved):
            # The first pale and wide, so that those that coincide with it are seen on it.
            look = {"lw": 5.0, "alpha": 0.35} if i == 0 else {"lw": 1.7, "ls": "-" if i == 1 else DASHED}
            axes.plot(history.time, getattr(history, name), color=TIME_COLOURS[i % 6], label=backend, **look)
        axes.set_ylabel(label)
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        axes.margins(x=0.01)
    for column, name in enumerate(PANELS if pairs else ()):
        axes = panels[1, column]
        for k, (i, j) in enumerate(pairs):
            (one, a), (other, b) = solved[i], solved[j]
            if len(a.time) != len(b.time):
                continue
            difference = history_difference(getattr(a, name), getattr(b, name))[1:]
            axes.plot(
                a.time[1:],
                np.maximum(difference, LEAST),
                color=TIME_COLOURS[(k + 2) % 6],
                marker="o",
                ms=(4.4, 3.0, 1.8)[k % 3],
                lw=(2.6, 1.6, 1.0)[k % 3],
                ls=("-", DASHED, DOTTED)[k % 3],
                label=f"{one} – {other}",
            )
        axes.axhline(BODY, color=GREY, ls=DASHED, lw=1.2, label="tolerance")
        axes.set_yscale("log")
    panels[-1, 1].set_xlabel("time $t$ [–]")
    if pairs:
        limits = [axes.get_ylim() for axes in panels[1]]
        for axes in panels[1]:
            axes.set_ylim(min(low for low, _ in limits), max(10 * BODY, *(high for _, high in limits)))
        panels[1, 0].set_ylabel("relative difference [–]")
        panels[1, 2].legend(loc="best")
    figure.align_ylabels()
    legend_above(figure, panels[0, 0], columns=6)
    return figure


@styled
def path_figure(run: PathRun) -> Figure:
    """Stress and fluid volume of the relaxing cell and of the law along one path, by the number of the step."""
    P, steps = provided(run.cell.stress), np.arange(len(run.path.times))
    figure = new_figure(11.5, 3.4)
    left, right = figure.subplots(1, 2)
    largest = np.abs(np.nan_to_num(P)).max(axis=0)
    shown = [(i, j) for i, j in np.ndindex(3, 3) if largest[i, j] > 1e-3 * largest.max()]
    for k, (i, j) in enumerate(shown):
        colour, label = TIME_COLOURS[k % 6], f"$P_{{{i + 1}{j + 1}}}$"
        left.plot(steps, P[:, i, j], color=colour, lw=5.0, alpha=0.35, label=label)
        left.plot(steps, run.stress[:, i, j], color=colour, lw=1.7, ls=DASHED)
    right.plot(
        steps, provided(run.cell.fluid_volume), color=TIME_COLOURS[0], lw=5.0, alpha=0.35, label="cell"
    )
    right.plot(steps, run.fluid_volume, color=TIME_COLOURS[0], lw=1.7, ls=DASHED, label="law")
    left.set_ylabel("stress $P_E/E$ [–]")
    right.set_ylabel("fluid volume φ [–]")
    for axes in (left, right):
        axes.set_xlabel("step of the path")
        axes.margins(x=0.01)
        axes.legend(loc="best")
    return figure


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
    "relaxation": (
        "Solid that relaxes",
        "path",
        "The law that relaxes the stress and the pressure of the cell in equilibrium, against the cell with the stress "
        "history of each of its points. Differences of P_E are relative to its largest component along the path, those "
        "of φ to its change.",
    ),
    "body": (
        "Macro solvers",
        "law",
        "The same body under the same law. Histories are compared at every time, relative to the value there or to a "
        "hundredth of the largest, and nodal fields at the times that are kept. Below, zero is drawn at 10⁻¹⁷.",
    ),
}


def write(folder: Path, result: CrossCheck) -> tuple[Path, Path]:
    """Write crosscheck.json and crosscheck.html in the place of older ones, and return their paths.

    Raises
    ------
    RunFolderError
        The folder cannot be written.
    """
    data, page = folder / "crosscheck.json", folder / "crosscheck.html"
    write_json(data, document(result), allow_nan=False)
    write_text(page, render(result))
    return data, page


def render(result: CrossCheck) -> str:
    """The page as text."""
    return (
        environment("porocore.commands.crosscheck")
        .get_template("page.html.j2")
        .render(
            title=result.config.title or "Crosscheck",
            comparisons=result.comparisons,
            paths=result.paths,
            failed=result.failed,
            worst=result.worst,
            summary=summarise(result.comparisons),
            sections=list(_sections(result)),
            times=times(result),
            provenance=versions(),
            config_text=result.config.resolved_yaml(),
        )
    )


def summarise(comparisons: tuple[Comparison, ...]) -> list[dict[str, Any]]:
    """Return a line for each part and pair: their number, how many failed, and the worst."""
    groups: dict[tuple[Part, str], list[Comparison]] = {}
    for line in comparisons:
        groups.setdefault((line.part, line.pair), []).append(line)
    return [
        {
            "title": PARTS[part][0],
            "pair": pair,
            "count": len(lines),
            "failed": sum(not line.passed for line in lines),
            "worst": max(lines, key=lambda line: line.excess),
        }
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
    rows += [
        (run.backend, f"cell, {run.path.name}, {what}", seconds)
        for run in result.paths
        for what, seconds in run.seconds.items()
    ]
    return rows


def _sections(result: CrossCheck) -> Iterator[dict[str, Any]]:
    for part, (title, case, text) in PARTS.items():
        lines = [line for line in result.comparisons if line.part == part]
        pictures = _pictures(result) if part == "body" else _paths(result) if part == "relaxation" else []
        if lines or pictures:
            yield {
                "part": part,
                "title": title,
                "case": case,
                "text": text,
                "lines": lines,
                "pictures": pictures,
            }


def _paths(result: CrossCheck) -> list[Picture]:
    return [
        Pictures().svg(
            f"path-{k}", path_figure(run), f"{run.path.name}, {run.backend}: cell with its history, and law"
        )
        for k, run in enumerate(result.paths, start=1)
        if np.isfinite(run.stress_error)
    ]


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
