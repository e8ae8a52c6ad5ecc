"""``porocore reproduce``: a publication recomputed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from porocore.cli.common import check_workers
from porocore.cli.options import FemOption, ResumeOption, SurrogateOption
from porocore.core.console import Console


def reproduce(
    paper: Annotated[str, typer.Argument(metavar="PAPER", help="dehghani2022.", show_default=False)],
    figure: Annotated[
        list[str] | None,
        typer.Option(
            "--figure",
            metavar="N",
            help="Only this figure, such as 13 or 13a. Repeatable.",
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
            "--out", metavar="DIR", help="Folder of all results.", show_default="runs/reproduce-PAPER"
        ),
    ] = None,
    resume: ResumeOption = False,
) -> None:
    """Recompute all figures, numbers and statements of a publication's numerical part, and compare them.

    Writes figures/*.png, reproduction.md and index.html, and prints the path of the last. With --figure, only what
    these figures need is computed, and their paths are printed.
    """
    check_workers(workers)
    from porocore.commands.reproduce.recompute import reproduce as recompute

    paths = recompute(
        paper, out, figures=figure, fem=fem, surrogate=surrogate, workers=workers, pictures=pictures,
        resume=resume, console=Console(),
    )  # fmt: skip
    for path in paths:
        typer.echo(path)
