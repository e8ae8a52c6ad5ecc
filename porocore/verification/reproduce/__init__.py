"""A publication recomputed: its figures, numbers and statements beside ours."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from porocore.core.console import Console
from porocore.core.echo import echo
from porocore.core.files.atomic import new_folder
from porocore.errors import ConfigurationError
from porocore.plugins.kinds import KINDS
from porocore.study.benchmark import as_stated_path, benchmark_path
from porocore.study.config.loading import load_config
from porocore.study.preflight.checks import find_backends
from porocore.verification.reproduce.catalogue import select_figures

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
    """Recompute the figures, numbers and statements of a publication, and compare them.

    Parameters
    ----------
    paper
        Name of the publication, one of :data:`PAPERS`.
    folder
        Place of everything; by default ``runs/reproduce-PAPER``.
    figures
        Figures such as ``"13"`` or ``"13a"``; only what they need is computed. By default all.
    fem, surrogate
        Backends instead of the configured ones.
    workers
        Processes; by default one for each core.
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
    PluginError
        A backend or pyvista is missing.
    RunFolderError
        The folder cannot be written, or holds something else.
    """
    from porocore.verification.local_fields.pictures import require_pyvista
    from porocore.verification.reproduce.make import claim_folder, draw, write_pages
    from porocore.verification.reproduce.study import Results

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
    column = any(figure.stage == "column" for figure in wanted)
    find_backends(config, KINDS if column else ["cell solver"])
    results = Results(
        new_folder(Path(folder or Path("runs") / f"reproduce-{paper}")),
        config,
        stated,
        config.sampling.worker_count(),
        console or Console(io.StringIO()),
        pictures,
    )
    claim_folder(results, resume=resume)
    paths = draw(results, wanted)
    return paths if figures else [write_pages(results, wanted, f"porocore reproduce {paper}")]
