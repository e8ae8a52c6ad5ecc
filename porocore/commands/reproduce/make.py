"""The reproduction as a whole: its folder, its figures, its pages in Markdown and HTML."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path

from porocore.commands.reproduce import claims_cell, claims_column, claims_cost
from porocore.commands.reproduce.claims import CheckedClaim, check_claims
from porocore.commands.reproduce.figures import PaperFigure, Stage
from porocore.commands.reproduce.study import Results
from porocore.commands.sensitivity.figures import write_figures
from porocore.core.echo import reason
from porocore.core.files.atomic import atomic_path, write_text
from porocore.core.files.claim import claim_folder
from porocore.core.files.plain_data import write_json
from porocore.core.files.reading import read_json
from porocore.errors import DataError, RunFolderError
from porocore.report.figures.style import write_pictures
from porocore.report.format import duration
from porocore.report.page import environment
from porocore.study.run.folder import stage_times, timed

RECORD = "reproduction.json"
#: What computes each stage.
STAGES: dict[Stage, Callable[[Results], object]] = {
    "fields": lambda results: results.fields,
    "sensitivity": lambda results: results.sensitivity,
    "column": lambda results: results.column,
}
CLAIMS = {
    "cell": claims_cell.CLAIMS,
    "cost": claims_cost.CLAIMS,
    "column": claims_column.CLAIMS,
}


def claim_results(results: Results, *, resume: bool) -> None:
    """Bind the folder to these configurations.

    Raises
    ------
    RunFolderError
        It holds another reproduction, this one without ``resume``, or something else.
    DataError
        Its record is damaged.
    """
    record = results.folder / RECORD
    identity = {"column": results.config.identity, "as stated": results.as_stated_config.identity}

    def check() -> None:
        try:
            held = read_json(record)["identity"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise DataError(
                f"{record}: not the record of a reproduction ({reason(error)}); choose another --out"
            ) from error
        if held != identity:
            raise RunFolderError(
                f"{results.folder} holds a reproduction with other backends or of another version; choose another --out"
            )

    claim_folder(
        results.folder,
        RECORD,
        "reproduction",
        resume=resume,
        # Each of its runs has a lock of its own.
        lock=nullcontext(),
        begin=lambda: write_json(record, {"identity": identity}, indent=1),
        check=check,
    )


def draw(results: Results, figures: Sequence[PaperFigure]) -> list[Path]:
    """Write ``figures/figure-NNp.png`` for each; computes what they need."""
    for stage in dict.fromkeys(figure.stage for figure in figures):
        STAGES[stage](results)
    folder = results.folder / "figures"
    paths = []
    with timed(results.timings, "figures"), results.console.task("figures", "figures") as task:
        for i, figure in enumerate(figures):
            task.update(i, len(figures), detail=f"figure {figure.name}")
            if figure.stage != "fields" or results.pictures:
                paths.append(folder / figure.file)
                _write(results, figure, paths[-1])
        task.update(len(figures), len(figures))
    return paths


def _write(results: Results, figure: PaperFigure, path: Path) -> None:
    source = results.folder / figure.stage / f"{figure.label}.png"
    if figure.stage == "sensitivity":
        write_figures(source.parent, results.sensitivity, [figure.label])
    if figure.draw is not None:
        write_pictures(figure.draw(results), path)
        return
    with atomic_path(path) as part:
        shutil.copyfile(source, part)


def write_pages(results: Results, figures: Sequence[PaperFigure], command: str) -> Path:
    """Check every claim and write ``reproduction.json``, ``reproduction.md`` and ``index.html``; returns the last."""
    for needed in STAGES.values():
        needed(results)
    _ = results.as_stated, results.call_seconds
    with timed(results.timings, "claims"):
        found = {key: check_claims(claims, results) for key, claims in CLAIMS.items()}
    timings = {stage: each.seconds for stage, each in stage_times(results.timings).items()}
    record, page = results.folder / RECORD, results.folder / "index.html"
    rows = {key: [asdict(row) for row in part] for key, part in found.items()}
    write_json(record, read_json(record) | {"claims": rows}, indent=1, ensure_ascii=False)
    for path, text in (
        (results.folder / "reproduction.md", markdown(found, command, timings)),
        (page, html(found, figures, timings)),
    ):
        write_text(path, text)
    return page


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
PARTS = {"cell": "The cell", "cost": "Sampling, network and cost", "column": "The column"}


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
    for key, title in PARTS.items():
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
            parts=[(key, title, parts[key]) for key, title in PARTS.items()],
            figures=figures,
            timings=timings,
            total=sum(timings.values()),
        )
    )


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
