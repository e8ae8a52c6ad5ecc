"""``run`` and its steps ``sample``, ``train``, ``solve`` and ``report``."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli.common import (
    ConfigArgument,
    FemOption,
    OutOption,
    ResumeOption,
    SurrogateOption,
    command,
    interruptible,
    read_config,
)
from porocore.console import Console
from porocore.errors import ConfigurationError, PluginError

if TYPE_CHECKING:
    from porocore.config import RunConfig
    from porocore.registry import Kind
    from porocore.runfolder import RunFolder

RunArgument = Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.", show_default=False)]


def run(
    config: ConfigArgument = None,
    fem: FemOption = None,
    surrogate: SurrogateOption = None,
    out: OutOption = None,
    resume: ResumeOption = False,
) -> None:
    """Sample, train, solve and report: a whole study.

    Prints the path of the report, a page to open in a browser. With --fem or --surrogate, the options that
    the configuration gives for its own backend do not go over to the other one.
    """
    path, settings = read_config(config, fem, surrogate)
    _check_backends(path, settings, "cell solver", "macro solver", "sampler", "surrogate")
    folder = _claim(path, settings, out, resume)
    again = ["--fem", fem] if fem else []
    again += ["--surrogate", surrogate] if surrogate else []
    with interruptible(command("run", config, *again, "--out", folder.path, "--resume")), folder:
        from porocore import pipeline

        report_path = pipeline.run(folder, settings, console=Console())
    typer.echo(report_path)


def sample(
    target: Annotated[
        Path, typer.Argument(metavar="CONFIG|RUN", help="Configuration, or run folder to go on with.")
    ],
    fem: FemOption = None,
    out: OutOption = None,
    resume: ResumeOption = False,
) -> None:
    """Solve the cell for the sampled states and for the held-out ones.

    From a configuration it starts a run folder. Prints the path of the data set.
    """
    from porocore.runfolder import RunFolder

    if target.is_dir():
        if fem is not None or out is not None:
            raise ConfigurationError(
                f"{target} is a run folder, which has its backend and place; leave out --fem and --out"
            )
        folder = RunFolder.open(target)
    else:
        path, settings = read_config(target, fem)
        _check_backends(path, settings, "cell solver", "sampler")
        folder = _claim(path, settings, out, resume)
    console = Console()
    with interruptible(command("sample", folder.path)), folder:
        from porocore import pipeline

        pipeline.sample(folder, folder.config, console=console)
    console.note(f"next: {command('train', folder.path)}")
    typer.echo(folder.dataset)


def train(run: RunArgument) -> None:
    """Train the surrogate on the sampled states.

    Prints the path of the trained surrogate.
    """
    folder = _open(run)
    folder.require(folder.dataset, "sample")
    console = Console()
    with interruptible(command("train", run)), folder:
        from porocore import pipeline

        pipeline.train(folder, folder.config, console=console)
    console.note(f"next: {command('solve', run)}")
    typer.echo(folder.surrogate)


def solve(run: RunArgument, fem: FemOption = None) -> None:
    """Solve the macroscopic problem, with the surrogate and linearly.

    Prints the paths of the solutions. Those that are there already stay; with --fem NAME, those of another
    backend are replaced, while cell and surrogate remain as they are. A solve that was interrupted is continued
    by any backend. With a backend that can, several processes share the work: mpirun -n 2 porocore solve RUN
    --fem dolfinx.
    """
    from porocore import backends, parallel
    from porocore.registry import registry

    folder = _open(run)
    folder.require(folder.dataset, "sample")
    folder.require(folder.surrogate, "train")
    config = folder.config.with_backends(fem)
    rank, size = parallel.launched()
    if size > 1 and not registry().get("macro solver", config.fem.backend).distributed:
        raise PluginError(
            f"macro solver '{config.fem.backend}' cannot share its work among {size} MPI processes; "
            "start it without mpirun, or choose one that can, such as --fem dolfinx"
        )
    solver = backends.make_backend("macro solver", config)
    if solver.world.size != size:
        raise PluginError(
            f"{size} processes were started, but the MPI of macro solver '{config.fem.backend}' knows of "
            f"{solver.world.size}; start them with the mpirun of that MPI"
        )
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        console = Console(nowhere if rank else None)
        again = ["--fem", fem] if fem else []
        with interruptible(command("solve", run, *again)), solver.world.holding(folder):
            from porocore import pipeline

            pipeline.solve(folder, folder.config, console=console, solver=solver, backend=fem)
        console.note(f"next: {command('report', run)}")
    if rank == 0:
        for path in folder.solutions():
            typer.echo(path)


def report(run: RunArgument) -> None:
    """Write figures of merit, the files for ParaView and the report.

    Prints the path of the report, a page to open in a browser.
    """
    folder = _open(run)
    folder.require(folder.dataset, "sample")
    folder.require(folder.surrogate, "train")
    for path in folder.solutions():
        folder.require(path, "solve")
    with interruptible(command("report", run)), folder:
        from porocore import pipeline

        pipeline.report(folder, folder.config, console=Console())
    typer.echo(folder.report)


def _open(path: Path) -> RunFolder:
    from porocore.runfolder import RunFolder

    return RunFolder.open(path)


def _claim(path: Path, settings: RunConfig, out: Path | None, resume: bool) -> RunFolder:
    from porocore.runfolder import RunFolder

    return RunFolder.claim(Path("runs") / path.stem if out is None else out, settings, resume=resume)


def _check_backends(path: Path, settings: RunConfig, *needed: Kind) -> None:
    """Refuse missing backends and unusable options before a folder is bound to the configuration at ``path``.

    A backend that only a later stage needs may be installed elsewhere; if it is here, its options are tried now.
    """
    from porocore import backends
    from porocore.config_errors import with_lines
    from porocore.registry import HOOKS, registry
    from porocore.yaml_document import YamlDocument

    for kind in needed:
        registry().find(kind, backends.backend_name(kind, settings))
    for kind in HOOKS:
        try:
            backends.check(kind, settings)
        except PluginError:
            if kind in needed:
                raise
        except ConfigurationError as error:
            raise ConfigurationError(with_lines(YamlDocument.read(path), str(error))) from error
