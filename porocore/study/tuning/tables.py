"""Results of a search as tune.json, tune.csv, tune.png and a table of text."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from porocore.core.files.atomic import atomic_path
from porocore.core.files.plain_data import write_json
from porocore.study.config.config import RunConfig
from porocore.study.run_folder.folder import RunFolder
from porocore.study.tuning.training import Result

FORMAT, VERSION = "porocore-tune", 1


def write_tables(
    folder: RunFolder, config: RunConfig, results: Sequence[Result], chosen: Result, margin: float
) -> tuple[Path, Path, Path]:
    """Write ``tune.json``, ``tune.csv`` and the figure ``tune.png`` into the run folder; return their paths."""
    from porocore.report.figures.surrogate import tuning_figure

    paths = tuple(folder.path / f"tune.{ending}" for ending in ("json", "csv", "png"))
    document = {
        "format": FORMAT,
        "version": VERSION,
        "backend": config.surrogate.backend,
        "model": config.surrogate_model,
        "margin": margin,
        "chosen": asdict(chosen),
        "candidates": [asdict(result) for result in results],
    }
    write_json(paths[0], document, indent=2, allow_nan=False)
    names = sorted({name for result in results for name in result.errors})
    with atomic_path(paths[1]) as part, open(part, "w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["depth", "width", "activation", "parameters", "error", *names, "seconds"])
        for r in results:
            rows.writerow(
                [r.depth, r.width, r.activation, r.parameters, r.error, *map(r.errors.get, names), r.seconds]
            )
    with atomic_path(paths[2]) as part:
        points = [(r.activation, r.parameters, r.error) for r in results if r.error is not None]
        assert chosen.error is not None
        best = min(error for _, _, error in points)
        part.write_bytes(tuning_figure(points, (chosen.parameters, chosen.error), (1 + margin) * best))
    return paths[0], paths[1], paths[2]


def text_table(results: Sequence[Result], chosen: Result) -> Iterator[str]:
    """Yield the lines of the table, smallest network first."""
    yield f"{'hidden':<16}{'activation':<12}{'parameters':>11}{'error':>11}{'training':>11}"
    for r in results:
        error = "diverged" if r.error is None else f"{100 * r.error:.3g} %"
        mark = "  <- chosen" if r == chosen else ""
        hidden = str(r.candidate.hidden)
        yield f"{hidden:<16}{r.activation:<12}{r.parameters:>11}{error:>11}{r.seconds:>9.1f} s{mark}"
