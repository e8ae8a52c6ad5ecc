"""Run of a sweep: samples and surrogate of the family, then the body of each value, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack

from porocore.core.console import Console
from porocore.core.echo import echo
from porocore.core.files.store import ResultStore
from porocore.core.parallel.calls import Tell
from porocore.core.units import using_units
from porocore.errors import ConfigurationError, SolveError
from porocore.interfaces.solution import StepReport
from porocore.sampling.samplers.macro_driven import MacroDriven
from porocore.study.notes.forecast import bodies_at_once, macro_time
from porocore.study.run import pipeline
from porocore.study.run.composition import (
    USUAL_LAWS,
    LawKind,
    law_names,
    macro_laws,
    make_backend,
    require_laws,
)
from porocore.study.run.folder import RunFolder
from porocore.study.run.solving import prepared_body, solve_body
from porocore.study.series import Case, CaseProgress, RunSeries
from porocore.study.sweep.plan import SweepPlan
from porocore.study.sweep.results import ParameterSweep, point_files

#: Laws that a sweep may have.
SWEEP_LAWS: tuple[LawKind, ...] = ("surrogate", "linear")


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
    config, series = plan.family, SweepSeries(folder, plan, laws)
    cases = series.cases()
    missing = sum(series.find(case) is None for case in cases)
    work = missing * sum(
        macro_time(config.closure, config.macro.problem(load)) for load in config.macro.loads
    )
    reasons = series.run(cases, console, bodies_at_once(config, missing, work))
    failures = {case.key: reason for case, reason in zip(cases, reasons, strict=True) if reason}
    for point, message in failures.items():
        console.warn(f"{point}: no solution: {message}")
    if len(failures) == len(plan.points):
        raise SolveError(f"no value could be solved; {next(iter(failures.values()))}")
    sweep = ParameterSweep(plan, folder, tuple(series.names), frozenset(failures))
    with using_units(plan.family.result_units):
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
    pipeline.learn(folder, console=console, store=store)


def solve_point(tell: Tell, folder: RunFolder, laws: Sequence[LawKind]) -> str:
    """Solve what is missing of the body of one point, under every load with each law; return no reason of a failure."""
    config, units = folder.config, folder.config.result_units
    with ExitStack() as stack:
        stack.enter_context(using_units(units))
        runs = macro_laws(folder, stack, laws)
        solver = make_backend("macro solver", config)
        done, count = 0, len(runs) * len(config.macro.loads)
        for load in config.macro.loads:
            problem, prepared = config.problem(load), None
            for name, run in runs.items():
                if not folder.solution(name, load).exists():

                    def show(
                        step: StepReport, name: str = name, load: float = load, done: int = done
                    ) -> None:
                        at, end = (units.text(t, "time") for t in (step.time, config.macro.time.end))
                        share = (done + step.time / config.macro.time.end) / count
                        tell(CaseProgress(f"{name}, load {load:g}, t = {at} of {end}", share))

                    prepared = (
                        prepared_body(solver, config.macro_backend, problem) if prepared is None else prepared
                    )
                    solve_body(folder, run.law, name, solver, problem, prepared, show)
                done += 1
    return ""


class SweepSeries(RunSeries[str]):
    """Points of a sweep; a result is the reason why there is no solution, or empty. The run folder has the solutions.

    Parameters
    ----------
    folder, plan, laws
        The run of the family, the sweep and its laws.
    """

    title, unit = "sweep", "values"
    function = solve_point

    def __init__(self, folder: RunFolder, plan: SweepPlan, laws: Sequence[LawKind]) -> None:
        super().__init__({})
        self._laws, self.names = laws, law_names(plan.family.closure, laws)
        self._places = {point.name: point_files(folder, plan, point) for point in plan.points}

    def cases(self) -> list[Case]:
        """Return the points as cases."""
        return [Case(name, (place, self._laws), name) for name, place in self._places.items()]

    def find(self, case: Case) -> str | None:
        """Return no reason of a failure where all solutions are there."""
        there = all(path.exists() for path in self._places[case.key].solutions(*self.names))
        return "" if there else None

    def save(self, case: Case, result: str) -> None:
        """Do nothing: who solves a point saves its solutions, and one without is tried again."""

    def lost(self, case: Case, error: Exception) -> str:
        """Return why a body has no solution."""
        if not isinstance(error, SolveError):
            raise error
        return str(error)

    def failed(self, result: str) -> bool:
        """Return whether there is no solution."""
        return bool(result)
