"""The macro stage: every load solved with each law by name, side by side where that pays.

Existing solutions stay; an interrupted solve continues from its checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

from porocore.core.console import Console
from porocore.core.files.store import ResultStore
from porocore.core.parallel.calls import Call, CallProcesses, Tell
from porocore.core.units import ResultUnits, using_units
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.solution import StepReport
from porocore.macro.boundary.symmetry import whole_specimen
from porocore.macro.integration.newton import StepForecast
from porocore.macro.linear_systems import step_in_words, work_in_words
from porocore.macro.problem import MacroProblem
from porocore.plugins.border import body_solution_of
from porocore.report.metrics import is_remnant
from porocore.study.notes.abilities import require_parts
from porocore.study.notes.forecast import bodies_at_once
from porocore.study.run.composition import (
    USUAL_LAWS,
    LawKind,
    RunLaw,
    law_names,
    macro_laws,
    make_backend,
    require_laws,
)
from porocore.study.run.folder import RunFolder, StageClock, cut_short_timed, timed
from porocore.study.run.results import load_solution


def solve(
    folder: RunFolder,
    *,
    console: Console,
    solver: MacroSolver | None = None,
    backend: str | None = None,
    laws: Sequence[LawKind] = USUAL_LAWS,
    direct_closure: str | None = None,
    store: ResultStore | None = None,
    processes: CallProcesses | None = None,
) -> list[str]:
    """Solve the macro problem under every load with each of ``laws``; return the laws' names.

    With ``solver``, named ``backend``, solutions of other backends are replaced; otherwise the configured one solves
    what is missing. All processes that share a solver call this. ``direct_closure`` closes the cells of direct FE²;
    by default the closure of the run does. Cells that a law solves are taken from ``store`` where it holds them.
    Solutions do not depend on one another: several are solved at a time where there are cores and memory, in
    ``processes`` if they are given and not too many.

    Raises
    ------
    ConfigurationError
        ``laws`` is no sequence of known kinds.
    """
    require_laws(laws)
    folder = folder.with_config(folder.config.with_backends(macro=backend))
    config = folder.config
    kinds = dict(zip(law_names(config.closure, laws, direct_closure), dict.fromkeys(laws), strict=True))
    solver = make_backend("macro solver", config) if solver is None else solver
    with ExitStack() as stack:
        stack.enter_context(using_units(config.result_units))
        kept = solver.communicator.on_root(partial(_kept, folder, list(kinds), backend))
        missing = [case for case, (stays, _) in kept.items() if not stays]
        own = {kinds[case.law] for case in missing} <= set(USUAL_LAWS) and solver.communicator.size == 1
        count = bodies_at_once(config, len(missing)) if own else 1
        solves: _Here | _Beside
        runs = dict[str, RunLaw]()
        if count > 1:
            console.note(f"solving: {len(missing)} solutions, {count} at a time")
            given = processes is not None and count >= min(processes.count, len(missing))
            workers = processes if processes and given else stack.enter_context(CallProcesses(count))
            solves = _Beside(folder, tuple(kinds.values()), missing, workers)
            stack.enter_context(cut_short_timed(folder.timings, solves.calls, workers))
        else:
            runs = macro_laws(folder, stack, laws, direct_closure, store)
            solves = _Here(folder, runs, solver)
        noted: set[str] = set()

        def note_once(line: str) -> None:
            """Print a line that is the same for several loads when it first comes."""
            if line and line not in noted:
                console.note(line)
                noted.add(line)

        for case, (stays, line) in kept.items():
            note_once(line)
            if stays:
                continue
            clock, problem = solves.begin(case, note_once), config.problem(case.load)
            title, stem = f"{case.law}, load {case.load:g}", folder.solution(*case).stem
            with (
                solver.communicator.holding(timed(folder.timings, case.stage, clock)),
                runs[case.law].accounted(stem, console, clock) if runs else nullcontext(),
                body_progress(console, title, problem, config.result_units, clock.now) as (show, busy),
            ):
                lines = solves.end(case, show, busy, note_once)
            for line in lines:
                console.note(f"{stem}: {line}")
    return list(kinds)


class SolutionCase(NamedTuple):
    """Law and load of a solution."""

    law: str
    load: float

    @property
    def stage(self) -> str:
        """Name of its solve in the record of times."""
        return f"macro, {self.law}, load {self.load:g}"


def _kept(
    folder: RunFolder, names: Sequence[str], backend: str | None
) -> dict[SolutionCase, tuple[bool, str]]:
    """Return whether the folder holds a solution that may stay, and a line on one that it holds, for each case."""
    found, units = {}, folder.config.result_units
    for load in folder.config.macro.loads:
        for name in names:
            path, stays, line = folder.solution(name, load), False, ""
            if path.exists():
                solution = load_solution(folder, name, load)
                of = solution.backend
                stays = backend is None or of == backend
                if stays and solution.units.as_text() != units.as_text():
                    # Scales and units may change while a run goes on.
                    replace(solution, units=units).save(path)
                line = f"solving: {path.name} is there already"
                if not stays:
                    line = (
                        f"solving: {path.name} is of {of or 'another backend'}; solved again with {backend}"
                    )
            found[SolutionCase(name, load)] = stays, line
    return found


class _Here:
    """Solves of a body in this process; the laws of a load share what the solver makes of it."""

    def __init__(self, folder: RunFolder, laws: Mapping[str, RunLaw], solver: MacroSolver) -> None:
        self._folder, self._laws, self._solver = folder, laws, solver
        self._prepared: tuple[MacroProblem, Any] | None = None

    def begin(self, case: SolutionCase, note: Callable[[str], None]) -> StageClock:
        """Prepare the body under a load, unless it is; return a clock that has begun."""
        if self._prepared is None or self._prepared[0].load != case.load:
            self._prepared = None  # which makes room for the next
            config = self._folder.config
            problem = config.problem(case.load)
            prepared = prepared_body(self._solver, config.macro_backend, problem)
            self._prepared = problem, prepared
            if line := self._solver.remark(prepared):
                note(f"solving: {line}")
        return StageClock()

    def end(
        self,
        case: SolutionCase,
        show: Callable[[StepReport], None],
        busy: Callable[[str], None],
        note: Callable[[str], None],
    ) -> list[str]:
        """Solve a case, and return lines on its work."""
        run = self._laws[case.law]
        assert self._prepared is not None
        run.tell_work(busy)
        words = solve_body(self._folder, run.law, case.law, self._solver, *self._prepared, show)
        return [*words, *run.work_in_words()]


class _Beside:
    """Solves of a body in other processes, all begun at once, and followed one after the other.

    Attributes
    ----------
    calls
        Those that are not followed yet, by stage.
    """

    def __init__(
        self,
        folder: RunFolder,
        laws: Sequence[LawKind],
        missing: Iterable[SolutionCase],
        processes: CallProcesses,
    ) -> None:
        self.calls = {
            case.stage: processes.submit(
                f"while it solved '{case.law}' under load {case.load:g}",
                *(solve_elsewhere, folder, laws, case),
            )
            for case in missing
        }
        self._followed: Call | None = None

    def begin(self, case: SolutionCase, note: Callable[[str], None]) -> StageClock:
        """Wait until a case has begun; return the clock of its process."""
        self._followed = self.calls.pop(case.stage)
        self._followed.begin()
        return StageClock(self._followed.time)

    def end(
        self,
        case: SolutionCase,
        show: Callable[[StepReport], None],
        busy: Callable[[str], None],
        note: Callable[[str], None],
    ) -> list[str]:
        """Show the steps of a case until it has ended, and return lines on its work."""
        call = self._followed
        assert call is not None
        for each in call.reports():
            (show if isinstance(each, StepReport) else note)(each)
        found: list[str] = call.result()
        return found


def solve_elsewhere(tell: Tell, folder: RunFolder, laws: Sequence[LawKind], case: SolutionCase) -> list[str]:
    """Solve one load with one of ``laws`` in this process; see :func:`solve_body`.

    ``tell`` receives how the linear systems are solved, and then every step.
    """
    config = folder.config
    with ExitStack() as stack:
        stack.enter_context(using_units(config.result_units))
        # All of them, since the libraries of a surrogate are loaded before those of the solver, as in one process.
        solves = _Here(folder, macro_laws(folder, stack, laws), make_backend("macro solver", config))
        solves.begin(case, tell)
        return solves.end(case, tell, tell, tell)


def prepared_body(solver: MacroSolver, name: str, problem: MacroProblem) -> Any:
    """Return what the macro solver of a name makes of a problem.

    Raises
    ------
    ConfigurationError
        The solver does not offer a part of the problem.
    """
    require_parts(type(solver), name, problem)
    return solver.prepare(problem)


def solve_body(
    folder: RunFolder,
    law: MacroLaw,
    name: str,
    solver: MacroSolver,
    problem: MacroProblem,
    prepared: Any,
    show: Callable[[StepReport], None],
) -> list[str]:
    """Solve one load with the law of a name, save the solution, and return the work of the linear systems in words."""
    checkpoint, on_root = folder.macro_checkpoint(name, problem.load), solver.communicator.on_root
    solution = body_solution_of(solver, prepared, law, problem, checkpoint=checkpoint, on_step=show)
    solution = replace(
        whole_specimen(solution, problem),
        backend=folder.config.macro_backend,
        units=folder.config.result_units,
    )
    on_root(partial(solution.save, folder.solution(name, problem.load)))
    on_root(partial(checkpoint.unlink, missing_ok=True))
    return list(filter(None, [work_in_words(solution.work)]))


@contextmanager
def body_progress(
    console: Console,
    title: str,
    problem: MacroProblem,
    units: ResultUnits,
    clock: Callable[[], float] | None = None,
    scale: Callable[[str], float] = lambda quantity: 1.0,
) -> Iterator[tuple[Callable[[StepReport], None], Callable[[str], None]]]:
    """Show the progress of a macro solve; yield what to call after each step, and with the work between two steps.

    ``clock`` gives the time of the process that solves; by default this one does. ``scale`` returns the factor from the
    numbers of the problem to those of the study, by the quantity, where the problem is in other units.
    """
    time, length = (scale(kind) * units.factor(kind) for kind in ("time", "displacement"))
    unit, of_length = (f" {units.name(kind)}" if units.given else "" for kind in ("time", "displacement"))
    forecast, reached, work = StepForecast(problem), 0.0, (0.0, 1.0)

    def update(detail: str) -> None:
        task.update(float(f"{time * reached:.6g}"), time * problem.time.end, detail=detail, work=work)

    def show(step: StepReport) -> None:
        nonlocal reached, work
        forecast.add(step.time)
        reached, work = step.time, forecast.work
        for line in step.notes:
            console.note(f"{title}: {line}")
        name, moved = (
            ("heave", step.heave) if step.heave > abs(step.settlement) else ("settlement", step.settlement)
        )
        if is_remnant(moved, step.displacement):
            name, moved = "largest displacement", step.displacement
        update(f"{name} {length * moved:.4g}{of_length}{step_in_words(step.work)}")

    with console.task(title, unit.strip(), "t = ", clock) as task:
        yield show, update
