"""``porocore run`` and its steps ``sample``, ``train``, ``solve`` and ``report``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from porocore.cli.common import chosen_store, claim, command, interruptible, located, read_config
from porocore.cli.options import (
    ClosureOption,
    ConfigArgument,
    ExecutorOption,
    FallbackName,
    FallbackOption,
    FemOption,
    LawName,
    LawOption,
    MacroOption,
    NoStoreOption,
    OutOption,
    ResumeOption,
    RunArgument,
    SchedulerOption,
    StoreOption,
    SurrogateOption,
)
from porocore.core.console import Console
from porocore.errors import ConfigurationError, PluginError, RunFolderError

if TYPE_CHECKING:
    from porocore.interfaces.macro import MacroSolver
    from porocore.plugins.kinds import Kind
    from porocore.study.config.config import RunConfig
    from porocore.study.run.composition import LawKind
    from porocore.study.run.folder import RunFolder


def run(
    config: ConfigArgument = None,
    fem: FemOption = None,
    macro: MacroOption = None,
    surrogate: SurrogateOption = None,
    closure: ClosureOption = None,
    law: LawOption = None,
    fallback: FallbackOption = FallbackName.none,
    executor: ExecutorOption = None,
    scheduler: SchedulerOption = None,
    out: OutOption = None,
    resume: ResumeOption = False,
    store: StoreOption = None,
    no_store: NoStoreOption = False,
) -> None:
    """Sample, train, solve and report: a whole study.

    Prints the path of the report, a page to open in a browser. --fem chooses the solvers of the cell and of the
    macroscale, --macro the second alone. Another backend, or another model of surrogate, does not take over the
    configured options.
    --closure NAME --resume continues a run with another closure: its solutions and its surrogate are added, and the
    report shows both. --laws surrogate leaves linear poroelasticity out, with which the report compares.
    """
    path, settings = read_config(config, fem, surrogate, closure, macro)
    laws = _laws_of_run(law, fallback)
    settings = settings.with_executor(executor, scheduler)
    _check_backends(path, settings, "cell solver", "macro solver", "sampler", "surrogate")
    kept = chosen_store(store, no_store)
    folder = claim(path, settings, out, resume)
    again = command(
        "run", config, fem=fem, macro=macro, surrogate=surrogate, closure=closure, law=law, executor=executor,
        scheduler=scheduler, fallback=_unless_none(fallback), out=folder.path, resume=True, store=store,
        no_store=no_store,
    )  # fmt: skip
    with interruptible(again), located(path), folder:
        from porocore.study.run import pipeline

        report_path = pipeline.run(folder, console=Console(), laws=laws, store=kept)
    typer.echo(report_path)


def sample(
    target: Annotated[
        Path, typer.Argument(metavar="CONFIG|RUN", help="Configuration, or run folder to continue.")
    ],
    fem: FemOption = None,
    executor: ExecutorOption = None,
    scheduler: SchedulerOption = None,
    retry_lost: Annotated[
        bool,
        typer.Option(
            "--retry-lost", help="Solve states again whose workers died or exceeded the time limit."
        ),
    ] = False,
    out: OutOption = None,
    resume: ResumeOption = False,
    store: StoreOption = None,
    no_store: NoStoreOption = False,
) -> None:
    """Solve the cell for the sampled states and for the held-out ones.

    A configuration starts a run folder. Prints the path of the data set.
    """
    from porocore.study.run.folder import CONFIG, RunFolder

    kept = chosen_store(store, no_store)
    if target.is_dir():
        if fem is not None or out is not None:
            raise ConfigurationError(
                f"{target} is a run folder, which has its backend and place; leave out --fem and --out"
            )
        folder = RunFolder.open(target)
        path = target / CONFIG
        folder = folder.with_config(folder.config.with_executor(executor, scheduler))
    else:
        path, settings = read_config(target, fem)
        settings = settings.with_executor(executor, scheduler)
        _check_backends(path, settings, "cell solver", "sampler")
        folder = claim(path, settings, out, resume)
    console, again = (
        Console(),
        command(
            "sample", folder.path, executor=executor, scheduler=scheduler, store=store, no_store=no_store
        ),
    )
    with interruptible(again), located(path), folder:
        from porocore.study.run import pipeline

        pipeline.solve_reference(folder, console=console, store=kept)
        pipeline.sample(folder, console=console, retry_lost=retry_lost, store=kept)
    console.note(f"next: {command('train', folder.path)}")
    for files in folder.of_each_cell:
        typer.echo(files.dataset)


def train(
    run: RunArgument,
    closure: ClosureOption = None,
    store: StoreOption = None,
    no_store: NoStoreOption = False,
) -> None:
    """Train the surrogate on the sampled states.

    Prints the path of the trained surrogate. --closure NAME trains the surrogate of another closure beside that of the
    run's own.
    """
    from porocore.study.config.config import with_closure
    from porocore.study.notes.checks import check_backend
    from porocore.study.run.results import require_samples

    folder, kept = _open(run), chosen_store(store, no_store)
    require_samples(folder)
    folder = folder.with_config(with_closure(folder.config, closure))
    check_backend("surrogate", folder.config)
    console = Console()
    with interruptible(command("train", run, closure=closure, store=store, no_store=no_store)), folder:
        from porocore.study.run import pipeline

        pipeline.train(folder, console=console, store=kept)
    console.note(f"next: {command('solve', run, closure=closure)}")
    for files in folder.of_each_cell:
        typer.echo(files.surrogate)


def solve(
    run: RunArgument,
    fem: FemOption = None,
    macro: MacroOption = None,
    closure: ClosureOption = None,
    law: LawOption = None,
    fallback: FallbackOption = FallbackName.none,
    store: StoreOption = None,
    no_store: NoStoreOption = False,
) -> None:
    """Solve the macroscopic problem, with the surrogate and linearly.

    Prints the paths of the solutions. Existing solutions stay; --macro NAME (or --fem NAME) replaces those of another
    backend and keeps cell and surrogate. Solutions of another --closure are added. --law direct solves the cell at
    every quadrature point instead of asking a surrogate (closure potential unless another is named); it is slow, and
    the reference for every surrogate. Any backend continues an interrupted solve. Several processes may share the work
    of a backend that supports it: mpirun -n 2 porocore solve RUN --fem dolfinx.
    """
    from porocore.core import parallel
    from porocore.study.config.config import with_closure
    from porocore.study.run.composition import USUAL_LAWS, law_names, with_fallback
    from porocore.study.run.folder import CONFIG
    from porocore.study.run.results import require_samples, require_surrogates

    folder, kept = _open(run), chosen_store(store, no_store)
    require_samples(folder)
    laws = with_fallback(tuple(kind.value for kind in law) if law else USUAL_LAWS, fallback)
    own = with_closure(folder.config, closure)
    folder = folder.with_config(own)
    direct_closure = closure or "potential"
    if "surrogate" in laws or "fallback" in laws:
        require_surrogates(folder)
    backend = macro or fem
    solver = _shared_solver(own.with_backends(macro=backend), laws)
    rank, _ = parallel.launched()
    again = command(
        "solve", run, fem=fem, macro=macro, closure=closure, law=law, fallback=_unless_none(fallback), store=store,
        no_store=no_store,
    )  # fmt: skip
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        console = Console(nowhere if rank else None)
        with (
            interruptible(again),
            located(folder.path / CONFIG),
            solver.communicator.holding(folder),
        ):
            from porocore.study.run import pipeline

            pipeline.solve(
                folder, console=console, solver=solver, backend=backend, laws=laws,
                direct_closure=direct_closure, store=kept,
            )  # fmt: skip
        console.note(f"next: {command('report', run)}")
    if rank == 0:
        for path in folder.solutions(*law_names(own.closure, laws, direct_closure)):
            typer.echo(path)


def _shared_solver(config: RunConfig, laws: Sequence[str]) -> MacroSolver:
    """Return the macro solver, after a check that it can share the work among the processes that were started."""
    from porocore.core import parallel
    from porocore.plugins.registry import registry
    from porocore.study.run.composition import make_backend

    name, (_, size) = config.macro_backend, parallel.launched()
    if size > 1 and not registry().get("macro solver", name).distributed:
        raise PluginError(
            f"macro solver '{name}' cannot share its work among {size} MPI processes; "
            "start it without mpirun, or choose one that can, such as --fem dolfinx"
        )
    if size > 1 and ("direct" in laws or "fallback" in laws):
        raise PluginError(
            "--law direct and --fallback direct share their cells among processes themselves; start it without mpirun"
        )
    solver: MacroSolver = make_backend("macro solver", config)
    if solver.communicator.size != size:
        raise PluginError(
            f"{size} processes were started, but the MPI of macro solver '{name}' knows of "
            f"{solver.communicator.size}; start them with the mpirun of that MPI"
        )
    return solver


def report(run: RunArgument) -> None:
    """Write figures of merit, the files for ParaView and the report.

    Prints the path of the report, a page to open in a browser. It compares the solutions that there are: of closures,
    linear poroelasticity and direct FE².
    """
    from porocore.study.run.results import require_samples, require_surrogates

    folder = _open(run)
    require_samples(folder)
    shown = folder.with_config(folder.config.with_closure(folder.shown_closure))
    require_surrogates(shown)
    for path in folder.solutions(shown.config.closure):
        _require_no_series(folder, path)
        folder.require(path, "solve")
    with interruptible(command("report", run)), folder:
        from porocore.study.run import pipeline

        pipeline.report(folder, console=Console())
    typer.echo(folder.report)


def _require_no_series(folder: RunFolder, solution: Path) -> None:
    """Refuse a folder of a sweep or of tuned cells whose run itself was not solved."""
    for name, points in (
        ("sweep", f", with the solutions of its values below {folder.path / 'sweep'}"),
        ("tune", ""),
    ):
        table = folder.path / f"{name}.csv"
        if table.is_file() and not solution.exists():
            raise RunFolderError(
                f"{folder.path} holds the results of 'porocore {name}': open {table} and "
                f"{table.with_suffix('.png').name}{points}; a report is of the run itself, which 'porocore solve "
                f"{folder.path}' solves first"
            )


def _open(path: Path) -> RunFolder:
    from porocore.study.run.folder import RunFolder

    return RunFolder.open(path)


def _laws_of_run(law: list[LawName] | None, fallback: FallbackName) -> tuple[LawKind, ...]:
    """Return the laws that a run solves with; its report shows the surrogate, whatever is beside it."""
    from porocore.study.run.composition import USUAL_LAWS, with_fallback

    laws: tuple[LawKind, ...] = tuple(kind.value for kind in law) if law else USUAL_LAWS
    if "surrogate" not in laws:
        raise ConfigurationError(
            f"--laws: expected surrogate, which the report of a run shows, got {', '.join(laws)}; add --laws "
            "surrogate, or solve with other laws alone by porocore solve RUN --law"
        )
    return with_fallback(laws, fallback)


def _unless_none(fallback: FallbackName) -> FallbackName | None:
    """Return the fallback for a command to continue, None without one."""
    return None if fallback is FallbackName.none else fallback


def _check_backends(path: Path, settings: RunConfig, *needed: Kind) -> None:
    """Refuse what would stop a run later, before a folder belongs to the configuration at ``path``."""
    from porocore.study.notes.checks import check_backends

    with located(path):
        check_backends(settings, needed)
