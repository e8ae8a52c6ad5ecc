"""``run`` and its steps ``sample``, ``train``, ``solve`` and ``report``."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli.common import (
    ClosureOption,
    ConfigArgument,
    FemOption,
    MacroOption,
    OutOption,
    ResumeOption,
    SurrogateOption,
    command,
    interruptible,
    located,
    read_config,
)
from porocore.core.console import Console
from porocore.errors import ConfigurationError, PluginError

if TYPE_CHECKING:
    from porocore.plugins.kinds import Kind
    from porocore.study.config.config import RunConfig
    from porocore.study.run_folder.folder import RunFolder


class Law(StrEnum):
    """Where the responses of the cell come from."""

    surrogate = "surrogate"
    linear = "linear"
    direct = "direct"


class FallbackKind(StrEnum):
    """What a macro run does where it leaves the sampled range."""

    none = "none"
    direct = "direct"


FallbackOption = Annotated[
    FallbackKind,
    typer.Option(
        "--fallback",
        help="direct: where the body leaves the sampled states, solve the cell there, learn from it and go on; "
        "a law of its own beside the others.",
    ),
]
LawOption = Annotated[
    list[Law] | None,
    typer.Option(
        "--law",
        metavar="LAW",
        help="surrogate, linear or direct (the cell itself, at every point); may be given several times.",
        show_default="surrogate and linear",
    ),
]


class ExecutorName(StrEnum):
    """Where the cells are solved."""

    auto = "auto"
    serial = "serial"
    processes = "processes"
    dask = "dask"


ExecutorOption = Annotated[
    ExecutorName | None,
    typer.Option("--executor", help="Where the cells are solved, instead of the configured place."),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        metavar="ADDRESS",
        help="Of a dask scheduler, such as tcp://node:8786; with --executor dask and none, workers start here.",
    ),
]
RunArgument = Annotated[Path, typer.Argument(metavar="RUN", help="Run folder.", show_default=False)]


def run(
    config: ConfigArgument = None,
    fem: FemOption = None,
    macro: MacroOption = None,
    surrogate: SurrogateOption = None,
    closure: ClosureOption = None,
    fallback: FallbackOption = FallbackKind.none,
    executor: ExecutorOption = None,
    scheduler: SchedulerOption = None,
    out: OutOption = None,
    resume: ResumeOption = False,
) -> None:
    """Sample, train, solve and report: a whole study.

    Prints the path of the report, a page to open in a browser. With --fem, --surrogate or a --closure that needs
    another model of surrogate, the options that the configuration gives for its own do not go over to the other
    one. --fem chooses the solvers of the cell and of the macroscale, --macro the second alone.
    With --closure NAME --resume, a run that is there goes on with another closure: its solutions and the
    surrogate that they need are added, and the report shows both.
    """
    path, settings = read_config(config, fem, surrogate, closure, macro)
    settings = settings.with_executor(executor, scheduler)
    _check_backends(path, settings, "cell solver", "macro solver", "sampler", "surrogate")
    folder = _claim(path, settings, out, resume)
    again = _backends(fem, macro)
    again += ["--surrogate", surrogate] if surrogate else []
    again += ["--closure", closure] if closure else []
    again += _where(executor, scheduler)
    again += ["--fallback", fallback] if fallback is not FallbackKind.none else []
    go_on = command("run", config, *again, "--out", folder.path, "--resume")
    with interruptible(go_on), located(path), folder:
        from porocore.study.stages import pipeline
        from porocore.study.stages.solving import USUAL_LAWS, with_fallback

        laws = with_fallback(USUAL_LAWS, fallback)
        report_path = pipeline.run(folder, settings, console=Console(), laws=laws)
    typer.echo(report_path)


def sample(
    target: Annotated[
        Path, typer.Argument(metavar="CONFIG|RUN", help="Configuration, or run folder to go on with.")
    ],
    fem: FemOption = None,
    executor: ExecutorOption = None,
    scheduler: SchedulerOption = None,
    retry_lost: Annotated[
        bool,
        typer.Option(
            "--retry-lost", help="Solve states again over which workers died or their time was over."
        ),
    ] = False,
    out: OutOption = None,
    resume: ResumeOption = False,
) -> None:
    """Solve the cell for the sampled states and for the held-out ones.

    From a configuration it starts a run folder. Prints the path of the data set.
    """
    from porocore.study.run_folder.folder import CONFIG, RunFolder

    if target.is_dir():
        if fem is not None or out is not None:
            raise ConfigurationError(
                f"{target} is a run folder, which has its backend and place; leave out --fem and --out"
            )
        folder = RunFolder.open(target)
        path = target / CONFIG
        settings = folder.config.with_executor(executor, scheduler)
    else:
        path, settings = read_config(target, fem)
        settings = settings.with_executor(executor, scheduler)
        _check_backends(path, settings, "cell solver", "sampler")
        folder = _claim(path, settings, out, resume)
    console = Console()
    again = _where(executor, scheduler)
    with interruptible(command("sample", folder.path, *again)), located(path), folder:
        from porocore.study.stages import pipeline

        pipeline.sample(folder, settings, console=console, retry_lost=retry_lost)
    console.note(f"next: {command('train', folder.path)}")
    typer.echo(folder.dataset)


def train(run: RunArgument, closure: ClosureOption = None) -> None:
    """Train the surrogate on the sampled states.

    Prints the path of the trained surrogate. With --closure NAME, it is the one that this closure needs, beside that of
    the run's own closure.
    """
    from porocore.study import backends

    folder = _open(run)
    folder.require(folder.dataset, "sample")
    config = backends.with_closure(folder.config, closure)
    backends.check("surrogate", config)
    console = Console()
    again = ["--closure", closure] if closure else []
    with interruptible(command("train", run, *again)), folder:
        from porocore.study.stages import pipeline

        pipeline.train(folder, config, console=console)
    console.note(f"next: {command('solve', run, *again)}")
    typer.echo(folder.surrogate_of(config))


def solve(
    run: RunArgument,
    fem: FemOption = None,
    macro: MacroOption = None,
    closure: ClosureOption = None,
    law: LawOption = None,
    fallback: FallbackOption = FallbackKind.none,
) -> None:
    """Solve the macroscopic problem, with the surrogate and linearly.

    Prints the paths of the solutions. Those that are there already stay; with --macro NAME (or --fem NAME), those of
    another backend are replaced, while cell and surrogate remain as they are. Solutions of another --closure are
    added to those that are there. --law direct solves the cell at every quadrature point instead of asking a surrogate
    (closure potential unless another is named); it is slow and the judge of every surrogate. A solve that was
    interrupted is continued by any backend. With a backend that can, several processes share the work: mpirun -n 2
    porocore solve RUN --fem dolfinx.
    """
    from porocore.core import parallel
    from porocore.plugins.registry import registry
    from porocore.study import backends
    from porocore.study.run_folder.folder import CONFIG
    from porocore.study.stages.solving import USUAL_LAWS, law_names, with_fallback
    from porocore.study.stages.stage_files import train_command

    folder = _open(run)
    folder.require(folder.dataset, "sample")
    laws = with_fallback(tuple(kind.value for kind in law) if law else USUAL_LAWS, fallback)
    own = backends.with_closure(folder.config, closure)
    direct_closure = closure or "potential"
    if "surrogate" in laws or "fallback" in laws:
        folder.require(folder.surrogate_of(own), train_command(folder, own))
    backend = macro or fem
    config = own.with_backends(macro=backend)
    rank, size = parallel.launched()
    if size > 1 and not registry().get("macro solver", config.macro_backend).distributed:
        raise PluginError(
            f"macro solver '{config.macro_backend}' cannot share its work among {size} MPI processes; "
            "start it without mpirun, or choose one that can, such as --fem dolfinx"
        )
    if size > 1 and ("direct" in laws or "fallback" in laws):
        raise PluginError(
            "--law direct and --fallback direct share their cells among processes themselves; start it without mpirun"
        )
    solver = backends.make_backend("macro solver", config)
    if solver.communicator.size != size:
        raise PluginError(
            f"{size} processes were started, but the MPI of macro solver '{config.macro_backend}' knows of "
            f"{solver.communicator.size}; start them with the mpirun of that MPI"
        )
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        console = Console(nowhere if rank else None)
        again = _backends(fem, macro)
        again += ["--closure", closure] if closure else []
        again += [word for kind in law or () for word in ("--law", kind)]
        again += ["--fallback", fallback] if fallback is not FallbackKind.none else []
        with (
            interruptible(command("solve", run, *again)),
            located(folder.path / CONFIG),
            solver.communicator.holding(folder),
        ):
            from porocore.study.stages import pipeline

            pipeline.solve(
                folder,
                own,
                console=console,
                solver=solver,
                backend=backend,
                laws=laws,
                direct_closure=direct_closure,
            )
        console.note(f"next: {command('report', run)}")
    if rank == 0:
        for path in folder.solutions(*law_names(own, laws, direct_closure)):
            typer.echo(path)


def report(run: RunArgument) -> None:
    """Write figures of merit, the files for ParaView and the report.

    Prints the path of the report, a page to open in a browser. Solutions of several closures, and of direct FE², are
    set beside one another.
    """
    from porocore.study.run_folder.files import LINEAR
    from porocore.study.stages.stage_files import train_command

    folder = _open(run)
    folder.require(folder.dataset, "sample")
    config = folder.config.with_closure(folder.shown_closure)
    folder.require(folder.surrogate_of(config), train_command(folder, config))
    for path in folder.solutions(config.closure, LINEAR):
        folder.require(path, "solve")
    with interruptible(command("report", run)), folder:
        from porocore.study.stages import pipeline

        pipeline.report(folder, folder.config, console=Console())
    typer.echo(folder.report)


def _open(path: Path) -> RunFolder:
    from porocore.study.run_folder.folder import RunFolder

    return RunFolder.open(path)


def _backends(fem: str | None, macro: str | None) -> list[str]:
    """The options of a command to go on with."""
    words = ["--fem", fem] if fem else []
    return words + (["--macro", macro] if macro else [])


def _where(executor: ExecutorName | None, scheduler: str | None) -> list[str]:
    """The options of a command to go on with."""
    words = ["--executor", str(executor)] if executor else []
    return words + (["--scheduler", scheduler] if scheduler else [])


def _claim(path: Path, settings: RunConfig, out: Path | None, resume: bool) -> RunFolder:
    from porocore.study.run_folder.folder import RunFolder

    return RunFolder.claim(Path("runs") / path.stem if out is None else out, settings, resume=resume)


def _check_backends(path: Path, settings: RunConfig, *needed: Kind) -> None:
    """Refuse what would stop a run half-way before a folder is bound to the configuration at ``path``."""
    from porocore.study.preflight.checks import check_backends

    with located(path):
        check_backends(settings, needed)
