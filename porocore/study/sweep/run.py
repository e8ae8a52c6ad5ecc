"""Run of a sweep: samples and surrogate of the family, then the body of each value, side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial

from porocore.core.console import Console, Task
from porocore.core.echo import echo
from porocore.core.files.store import ResultStore
from porocore.core.parallel.calls import CallProcesses
from porocore.core.units import speaking
from porocore.errors import ConfigurationError, SolveError
from porocore.interfaces.solution import StepReport
from porocore.sampling.samplers.macro_driven import MacroDriven
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.notes.guess import bodies_at_once, macro_time
from porocore.study.run_folder import RunFolder
from porocore.study.stages import pipeline
from porocore.study.stages.solving import (
    USUAL_LAWS,
    LawKind,
    law_names,
    macro_laws,
    prepared_body,
    require_laws,
    solve_body,
)
from porocore.study.sweep.plan import SweepPlan, SweepPoint
from porocore.study.sweep.results import ParameterSweep, point_files

#: Laws that a sweep may have.
SWEEP_LAWS: tuple[LawKind, ...] = ("surrogate", "linear")


@dataclass(frozen=True)
class PointProgress:
    """Progress of one value: the solution under way in words, and the share of all of its solutions that is done."""

    words: str
    share: float


def require_sweep_laws(laws: Sequence[LawKind]) -> None:
    """Refuse laws that a sweep cannot have: it is the surrogate that knows all values.

    Raises
    ------
    ConfigurationError
        The surrogate is missing, or a law solves cells.
    """
    require_laws(laws)
    if other := [law for law in laws if law not in SWEEP_LAWS]:
        raise ConfigurationError(f"laws: expected some of {', '.join(SWEEP_LAWS)}, got {echo(other[0])}")
    if "surrogate" not in laws:
        raise ConfigurationError(f"laws: expected surrogate among them, got {', '.join(laws) or 'none'}")


def run_sweep(
    folder: RunFolder,
    plan: SweepPlan,
    *,
    console: Console,
    laws: Sequence[LawKind] = USUAL_LAWS,
    store: ResultStore | None = None,
) -> ParameterSweep:
    """Sample and learn the family, solve the body of each value, and write table and pictures.

    The folder is that of the run of ``plan.family``. What it holds is not computed again, and finished values stay.

    Raises
    ------
    ConfigurationError
        See :func:`require_sweep_laws`.
    SolveError
        The body could be solved for no value.
    """
    from porocore.study.sweep.figure import write_sweep  # matplotlib is slow to import

    require_sweep_laws(laws)
    for note in plan.notes:
        console.note(note)
    learn(folder, plan, console=console, store=store)
    names = law_names(plan.family, laws, plan.family.closure)
    failures = solve_points(folder, plan, laws, names, console)
    for point, message in failures.items():
        console.warn(f"{point}: no solution: {message}")
    if len(failures) == len(plan.points):
        raise SolveError(f"no value could be solved; {next(iter(failures.values()))}")
    sweep = ParameterSweep(plan, folder, tuple(names), frozenset(failures))
    with speaking(plan.family.result_units):
        write_sweep(sweep)
    if flagged := int(sweep.flagged.sum()):
        console.warn(
            f"{flagged} of {len(plan.points)} values leave the states that the surrogate is trusted in "
            "(flagged_largest in sweep.csv); sample more states, or wider ranges"
        )
    return sweep


def learn(folder: RunFolder, plan: SweepPlan, *, console: Console, store: ResultStore | None = None) -> None:
    """Sample the family and train its surrogate, unless the folder holds it."""
    config = plan.family
    if isinstance(make_backend("sampler", config), MacroDriven):
        at = ", ".join(f"{each.name} = {config.macro.fields[each.name]}" for each in plan.swept)
        console.warn(
            f"the sampler macro-driven explores the body at {at} alone; other values may leave the sampled states, "
            "which flags them: choose sampling.sampler: sobol"
        )
    pipeline.learn(folder, config, console=console, store=store)


def solve_points(
    folder: RunFolder, plan: SweepPlan, laws: Sequence[LawKind], names: Sequence[str], console: Console
) -> dict[str, str]:
    """Solve the body of every point that the folder does not hold; return the message of each that has no solution."""
    places = [point_files(folder, plan, point) for point in plan.points]
    missing = [
        (point, place)
        for point, place in zip(plan.points, places, strict=True)
        if not all(path.exists() for path in place.solutions(*names))
    ]
    if kept := len(places) - len(missing):
        console.note(f"sweep: {kept} of {len(places)} values are there already")
    if not missing:
        return {}
    config = plan.family
    work = len(missing) * sum(macro_time(config, load) for load in config.macro.loads)
    count = bodies_at_once(config, len(missing), work)
    with console.task("sweep", "values") as task, CallProcesses(count) as processes:
        runs: Iterator[Callable[[Callable[[PointProgress], None]], None]]
        if count > 1:
            runs = _elsewhere(processes, missing, laws)
        else:
            runs = (
                partial(solve_point, folder=place, config=place.config, laws=laws) for _, place in missing
            )
        failures = {}
        for done, ((point, _), run) in enumerate(zip(missing, runs, strict=True)):
            try:
                run(partial(_show, task, point.name, done, len(missing)))
            except SolveError as error:
                failures[point.name] = str(error)
        task.update(len(missing), len(missing), failed=len(failures))
    return failures


def _elsewhere(
    processes: CallProcesses, missing: Sequence[tuple[SweepPoint, RunFolder]], laws: Sequence[LawKind]
) -> Iterator[Callable[[Callable[[PointProgress], None]], None]]:
    """Yield functions that follow the points as they are solved in processes."""
    calls = [
        processes.submit(f"while it solved {point.name}", solve_point, place, place.config, laws)
        for point, place in missing
    ]
    for call in calls:

        def follow(show: Callable[[PointProgress], None]) -> None:
            call.begin()  # noqa: B023 - it is called before the next one is made
            for told in call.reports():  # noqa: B023
                show(told)
            call.result()  # noqa: B023

        yield follow


def _show(task: Task, name: str, done: int, count: int, progress: PointProgress) -> None:
    reached = done + progress.share
    task.update(done, count, detail=f"{name}: {progress.words}", work=(reached, count - reached))


def solve_point(
    tell: Callable[[PointProgress], None], folder: RunFolder, config: RunConfig, laws: Sequence[LawKind]
) -> None:
    """Solve what is missing of the body of one point, under every load with each law; ``tell`` takes the progress."""
    units = config.result_units
    with ExitStack() as stack:
        stack.enter_context(speaking(units))
        runs = macro_laws(folder, config, stack, laws)
        solver = make_backend("macro solver", config)
        done, count = 0, len(runs) * len(config.macro.loads)
        for load in config.macro.loads:
            problem, prepared = config.macro.problem(load), None
            for name, run in runs.items():
                if not folder.solution(name, load).exists():

                    def show(
                        step: StepReport, name: str = name, load: float = load, done: int = done
                    ) -> None:
                        at, end = (units.text(t, "time") for t in (step.time, config.macro.time.end))
                        share = (done + step.time / config.macro.time.end) / count
                        tell(PointProgress(f"{name}, load {load:g}, t = {at} of {end}", share))

                    prepared = prepared_body(solver, config, problem) if prepared is None else prepared
                    solve_body(folder, config, run, problem, solver, prepared, None, name, show)
                done += 1
