"""``tune``: which network is large enough."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from porocore.cli.common import (
    OutOption,
    SurrogateOption,
    check_workers,
    command,
    interruptible,
    read_config,
)
from porocore.core.console import Console
from porocore.core.echo import echo
from porocore.errors import ConfigurationError


def tune(
    target: Annotated[
        Path, typer.Argument(metavar="RUN|CONFIG", help="Run folder, or the configuration of one.")
    ],
    surrogate: SurrogateOption = None,
    depths: Annotated[str, typer.Option(metavar="LIST", help="Numbers of hidden layers.")] = "1,2,3",
    widths: Annotated[str, typer.Option(metavar="LIST", help="Widths of a layer.")] = "8,16,24,40",
    activations: Annotated[
        str | None,
        typer.Option(metavar="LIST", help="Activations.", show_default="all that the model has"),
    ] = None,
    margin: Annotated[
        float, typer.Option(metavar="PERCENT", help="How much worse than the best the chosen one may be.")
    ] = 10.0,
    workers: Annotated[
        int | None,
        typer.Option(metavar="N", help="Processes.", show_default="as configured for sampling"),
    ] = None,
    out: OutOption = None,
) -> None:
    """Try networks of several sizes and choose the smallest that is about as good as the best.

    Each is trained on the samples of the run and measured on its held-out states; with a configuration, these
    are solved first where they are missing. What is trained already is kept, so the same command continues a
    search. Prints the lines for the configuration.
    """
    from porocore.study.run_folder.folder import RunFolder
    from porocore.study.tuning import tune as tuning

    if not 0 <= margin < float("inf"):
        raise ConfigurationError(f"--margin: expected a percentage of at least 0, got {margin:g}")
    check_workers(workers)
    grid_of = (_numbers("--depths", depths), _numbers("--widths", widths), _words(activations))
    console = Console()
    if target.is_dir():
        if out is not None:
            raise ConfigurationError(f"{target} is a run folder; leave out --out")
        folder = RunFolder.open(target)
        config = folder.config.with_backends(None, surrogate)
        grid = tuning.candidates(config, *grid_of)
    else:
        path, settings = read_config(target, None)
        config = settings.with_backends(None, surrogate)
        grid = tuning.candidates(config, *grid_of)
        folder = RunFolder.claim(Path("runs") / path.stem if out is None else out, settings, resume=True)
    again = command(
        "tune", folder.path, *(["--surrogate", surrogate] if surrogate else []),
        "--depths", depths, "--widths", widths, *(["--activations", activations] if activations else []),
    )  # fmt: skip
    with interruptible(again), folder:
        if not target.is_dir():
            from porocore.study.stages import pipeline

            pipeline.sample(folder, folder.config, console=console)
        with console.task("tuning", "candidates") as task:

            def show(done: int, result: tuning.Result | None) -> None:
                error = (
                    "" if result is None or result.error is None else f", error {100 * result.error:.2g} %"
                )
                detail = "" if result is None else f"{result.candidate.key}{error}"
                task.update(done, len(grid), detail=detail)

            count = config.sampling.worker_count() if workers is None else workers
            results = tuning.tune(folder, config, grid, workers=count, on_result=show)
        chosen = tuning.smallest_good(results, margin / 100)
        paths = tuning.write_tables(folder, config, results, chosen, margin / 100)
    for line in tuning.lines(results, chosen):
        console.note(line)
    console.note(f"table and figure: {', '.join(str(path) for path in paths)}")
    console.note(f"the smallest within {margin:g} % of the best; for the configuration:")
    typer.echo("surrogate:")
    typer.echo(f"  backend: {config.surrogate.backend}")
    typer.echo(f"  model: {config.surrogate_model}")
    typer.echo("  options:")
    typer.echo(f"    hidden: {chosen.candidate.hidden}")
    typer.echo(f"    activation: {chosen.activation}")


def _numbers(option: str, text: str) -> list[int]:
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise ConfigurationError(
            f"{option}: expected whole numbers with commas between, such as 8,16, got {echo(text)}"
        ) from None


def _words(text: str | None) -> list[str] | None:
    return None if text is None else [word.strip() for word in text.split(",")]
