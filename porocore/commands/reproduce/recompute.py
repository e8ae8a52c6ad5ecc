"""Recomputing of a publication (reproduce): its configurations, figures and pages."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from porocore.core.console import Console
from porocore.core.echo import echo
from porocore.core.files.atomic import new_folder
from porocore.errors import ConfigurationError
from porocore.plugins.kinds import OF_A_STUDY
from porocore.study.config.loading import as_stated_path, benchmark_path, load_config
from porocore.study.notes.checks import find_backends

#: Publications that can be recomputed.
PAPERS = ("dehghani2022",)


def reproduce(
    paper: str,
    folder: Path | str | None = None,
    *,
    figures: Sequence[str] | None = None,
    fem: str | None = None,
    surrogate: str | None = None,
    workers: int | None = None,
    pictures: bool = True,
    resume: bool = False,
    console: Console | None = None,
) -> list[Path]:
    """Recompute the figures and statements of a publication, and compare them.

    Parameters
    ----------
    paper
        One of ``PAPERS``.
    folder
        Place of everything; by default ``runs/reproduce-PAPER``.
    figures
        Figures such as ``"13"`` or ``"13a"``; only what they need is computed. By default all.
    fem, surrogate, workers
        Backends and processes instead of the configured ones.
    pictures
        Draw local fields, which needs pyvista.
    resume
        Continue the reproduction that the folder holds.
    console
        Display of the progress; by default none.

    Returns
    -------
    list of Path
        The page, or with ``figures`` their pictures.

    Raises
    ------
    ConfigurationError
        The publication or a figure is unknown.
    RunFolderError
        The folder cannot be written, or holds something else.
    """
    from porocore.commands.fields.pictures import require_pyvista
    from porocore.commands.reproduce.figures import select_figures
    from porocore.commands.reproduce.make import claim_results, draw, write_pages
    from porocore.commands.reproduce.study import Results

    if paper not in PAPERS:
        raise ConfigurationError(f"unknown publication {echo(paper)}; expected {', '.join(PAPERS)}")
    wanted = select_figures(figures)
    if pictures and any(figure.stage == "fields" for figure in wanted):
        require_pyvista()
    config, stated = (
        load_config(path).with_backends(fem, surrogate) for path in (benchmark_path(), as_stated_path())
    )
    if workers is not None:
        sampling = config.sampling.model_copy(update={"workers": workers})
        config = config.model_copy(update={"sampling": sampling})
    find_backends(config, OF_A_STUDY if any(f.stage == "column" for f in wanted) else ["cell solver"])
    place = new_folder(Path(folder or f"runs/reproduce-{paper}"))
    console, processes = console or Console.shown(False), config.sampling.worker_count()
    results = Results(place, config, stated, processes, console, pictures)
    claim_results(results, resume=resume)
    paths = draw(results, wanted)
    return paths if figures else [write_pages(results, wanted, f"porocore reproduce {paper}")]
