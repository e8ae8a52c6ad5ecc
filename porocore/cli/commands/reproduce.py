"""``porocore reproduce``: a publication recomputed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli.common import FemOption, SurrogateOption, check_workers, command, interruptible, read_config
from porocore.core.console import Console
from porocore.core.echo import echo
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from porocore.plugins.kinds import Kind

PAPERS = ("dehghani2022",)


def reproduce(
    paper: Annotated[str, typer.Argument(metavar="PAPER", help="dehghani2022.", show_default=False)],
    figure: Annotated[
        list[str] | None,
        typer.Option(
            "--figure",
            metavar="N",
            help="Only this figure, such as 13 or 13a; several times.",
            show_default="all",
        ),
    ] = None,
    fem: FemOption = None,
    surrogate: SurrogateOption = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", help="Processes.", show_default="as many as cores")
    ] = None,
    pictures: Annotated[
        bool, typer.Option("--pictures/--no-pictures", help="Draw local fields, which needs pyvista.")
    ] = True,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="DIR", help="Where everything goes.", show_default="runs/reproduce-PAPER"
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the reproduction that the folder already holds.")
    ] = False,
) -> None:
    """Recompute all figures, numbers and statements of a publication's numerical part, and set ours beside them.

    Writes figures/*.png, reproduction.md and index.html, and prints the path of the last. With --figure, only what
    these figures need is computed, and their paths are printed.
    """
    if paper not in PAPERS:
        raise ConfigurationError(f"unknown publication {echo(paper)}; expected {', '.join(PAPERS)}")
    check_workers(workers)
    again = command(
        "reproduce", paper, *(w for f in figure or () for w in ("--figure", f)), *(["--fem", fem] if fem else []),
        *(["--surrogate", surrogate] if surrogate else []), *([] if pictures else ["--no-pictures"]),
        *(["--out", out] if out else []), "--resume",
    )  # fmt: skip
    from porocore.verification.reproduce.catalogue import chosen

    figures = chosen(figure)
    with interruptible(again):
        from porocore.core.files.atomic import new_folder
        from porocore.study.benchmark import as_stated_path
        from porocore.study.preflight.checks import find_backends
        from porocore.verification.local_fields.pictures import require
        from porocore.verification.reproduce.make import claim_folder, draw, write_pages
        from porocore.verification.reproduce.study import Results

        if pictures and any(f.stage == "fields" for f in figures):
            require()
        _, config = read_config(None, fem, surrogate)
        _, stated = read_config(as_stated_path(), fem, surrogate)
        if workers is not None:
            config = config.model_copy(
                update={"sampling": config.sampling.model_copy(update={"workers": workers})}
            )
        results = Results(
            out or Path("runs") / f"reproduce-{paper}",
            config,
            stated,
            config.sampling.worker_count(),
            Console(),
            pictures,
        )
        needed: tuple[Kind, ...] = ("cell solver",)
        if any(f.stage == "column" for f in figures):
            needed = ("cell solver", "macro solver", "sampler", "surrogate")
        find_backends(config, needed)
        new_folder(results.folder)
        claim_folder(results, resume=resume)
        paths = draw(results, figures)
        if figure is None:
            paths = [write_pages(results, figures, f"porocore reproduce {paper}")]
    for path in paths:
        typer.echo(path)
