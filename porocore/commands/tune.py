"""``porocore tune``: search of the size of a network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli.common import check_workers, chosen_store, read_config
from porocore.cli.options import NoStoreOption, OutOption, StoreOption, SurrogateOption, WorkersOption
from porocore.core.console import Console
from porocore.core.echo import echo
from porocore.errors import ConfigurationError

if TYPE_CHECKING:
    from porocore.study.config.config import RunConfig
    from porocore.study.tuning import Tuning


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
        float, typer.Option(metavar="PERCENT", help="Allowed excess of the error over that of the best.")
    ] = 10.0,
    workers: WorkersOption = None,
    out: OutOption = None,
    store: StoreOption = None,
    no_store: NoStoreOption = False,
) -> None:
    """Try networks of several sizes and choose the smallest that is about as good as the best.

    Each is trained on the samples of the run and measured on its held-out states. With a configuration, missing
    samples are solved first. The run folder keeps trained networks, so the same command continues a search. Prints the
    lines for the configuration.
    """
    from porocore.study.run.folder import RunFolder
    from porocore.study.tuning import candidates

    if not 0 <= margin < float("inf"):
        raise ConfigurationError(f"--margin: expected a percentage of at least 0, got {margin:g}")
    check_workers(workers)
    kept = chosen_store(store, no_store)
    sizes = (_numbers("--depths", depths), _numbers("--widths", widths), _words(activations))
    if target.is_dir():
        if out is not None:
            raise ConfigurationError(f"{target} is a run folder; leave out --out")
        folder = RunFolder.open(target)
        config = folder.config.with_backends(None, surrogate)
        grid = candidates(config, *sizes)
    else:
        path, settings = read_config(target, None)
        config = settings.with_backends(None, surrogate)
        grid = candidates(config, *sizes)
        folder = RunFolder.claim(Path("runs") / path.stem if out is None else out, settings, resume=True)
    console = Console()
    with folder:
        from porocore.study import tuning
        from porocore.study.run import pipeline

        if not target.is_dir():
            pipeline.solve_reference(folder, console=console, store=kept)
            pipeline.sample(folder, console=console, store=kept)
        found = tuning.tune(
            folder, config, grid, console=console, margin=margin / 100, workers=workers, store=kept
        )
    _print(console, config, found, margin)


def _print(console: Console, config: RunConfig, found: Tuning, margin: float) -> None:
    from porocore.study.tuning import text_table

    for line in text_table(found.results, found.chosen):
        console.note(line)
    console.note(f"table and figure: {', '.join(map(str, found.files))}")
    console.note(f"the smallest within {margin:g} % of the best; for the configuration:")
    typer.echo("surrogate:")
    typer.echo(f"  backend: {config.surrogate.backend}")
    typer.echo(f"  model: {config.surrogate_model}")
    typer.echo("  options:")
    typer.echo(f"    hidden: {found.chosen.hidden}")
    typer.echo(f"    activation: {found.chosen.activation}")


def _numbers(option: str, text: str) -> list[int]:
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise ConfigurationError(
            f"{option}: expected whole numbers with commas between, such as 8,16, got {echo(text)}"
        ) from None


def _words(text: str | None) -> list[str] | None:
    return None if text is None else [word.strip() for word in text.split(",")]
