"""The macro stage: every load solved with each law by name, side by side where that pays.

Existing solutions stay; an interrupted solve continues from its checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

from porocore.core.console import Console
from porocore.core.echo import echo, suggestion
from porocore.core.files.store import ResultStore
from porocore.core.parallel.calls import Call, CallProcesses, Tell
from porocore.core.units import ResultUnits, speaking
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.solution import StepReport
from porocore.macro.boundary.symmetry import whole_specimen
from porocore.macro.composition.linearised_law import LinearisedLaw
from porocore.macro.composition.regions import RegionLaw
from porocore.macro.integration.newton import StepForecast
from porocore.macro.laws import AdaptiveLaw, ClosedLaw
from porocore.macro.laws.direct import AdaptiveSurrogate, DirectCellLaw, SolvesCells, cost_recorded
from porocore.macro.laws.linear import LinearPoroelasticity
from porocore.macro.linear_systems import step_in_words, work_in_words
from porocore.macro.problem import MacroProblem
from porocore.macro.reference import CellReference
from porocore.plugins.border import body_solution_of
from porocore.report.metrics import is_remnant
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.execution.members import MembersAtRest
from porocore.sampling.execution.solved_store import SolvedStore
from porocore.states import Array
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.notes.abilities import require_parts
from porocore.study.notes.guess import bodies_at_once
from porocore.study.run_folder import (
    LINEAR,
    RunFolder,
    StageClock,
    cut_short_timed,
    direct_law,
    fallback_law,
    timed,
    versions,
)
from porocore.study.stages.stage_files import (
    factory_of,
    linear_coefficients,
    load_reference,
    load_solution,
    load_surrogate,
    prepare_undeformed,
    training_set,
)
from porocore.study.store import solved_states, told

LawKind = Literal["surrogate", "linear", "direct", "fallback"]
#: Prepared members that each process keeps where every point of a body may have its own.
MEMBERS_OF_A_BODY = 16
#: Laws that are solved by default.
USUAL_LAWS: tuple[LawKind, ...] = ("surrogate", "linear")


@dataclass(frozen=True)
class CellSolves:
    """Cells that a law solves during a macro run: their solver, the record of its work and the pool."""

    cells: SolvesCells
    record: Path
    pool: CellPool


@dataclass(frozen=True)
class RunLaw:
    """A law of a run, and of one that solves cells the solves of each of them."""

    law: MacroLaw
    solves: tuple[CellSolves, ...] = ()

    @contextmanager
    def cost_recorded(self, solution: str) -> Iterator[None]:
        """Add the cells that the block solves to the records of ``solution``."""
        with ExitStack() as stack:
            for each in self.solves:
                stack.enter_context(cost_recorded(each.record, solution, each.cells.work))
            yield

    @contextmanager
    def taken_told(self, title: str, console: Console, clock: StageClock) -> Iterator[None]:
        """Tell what the block takes from the store, and count on the clock what it saves."""
        with ExitStack() as stack:
            for each in self.solves:
                pool = each.pool
                stack.enter_context(told(pool.known, title, console.note, clock.add, pool.workers))
            yield

    def tell_work(self, say: Callable[[str], None]) -> None:
        """Have the work of the law told between two steps."""
        for each in self.solves:
            each.cells.on_work = say

    def work_in_words(self) -> list[str]:
        """Return the work so far in a sentence for each cell."""
        return [each.cells.work.in_words() for each in self.solves]


def require_laws(laws: Sequence[LawKind]) -> None:
    """Refuse what is no sequence of kinds of laws.

    Raises
    ------
    ConfigurationError
        It is a text, or a kind is unknown.
    """
    kinds = get_args(LawKind)
    if isinstance(laws, str):
        raise ConfigurationError(f"laws: expected a sequence, such as ('linear',), got the text '{laws}'")
    for kind in laws:
        if kind not in kinds:
            advice = suggestion(str(kind), kinds, "the kinds of laws are")
            raise ConfigurationError(f"laws: no law is called {echo(kind)}; {advice}")


def with_fallback(laws: Sequence[LawKind], fallback: str) -> tuple[LawKind, ...]:
    """Return ``laws``, with the one that learns on the way unless ``fallback`` is ``none``."""
    more: tuple[LawKind, ...] = () if fallback == "none" else ("fallback",)
    return (*laws, *more)


def law_names(config: RunConfig, laws: Sequence[LawKind], direct_closure: str) -> list[str]:
    """Return the names under which :func:`solve` keeps the solutions."""
    names = {"surrogate": config.closure, "linear": LINEAR, "direct": direct_law(direct_closure)}
    names["fallback"] = fallback_law(config.closure)
    return [names[kind] for kind in dict.fromkeys(laws)]


def macro_laws(
    folder: RunFolder,
    config: RunConfig,
    stack: ExitStack,
    kinds: Sequence[LawKind] = USUAL_LAWS,
    direct_closure: str = "potential",
    store: ResultStore | None = None,
) -> dict[str, RunLaw]:
    """Return the laws of a run by name; processes that a law needs end with ``stack``."""
    found = dict[str, RunLaw]()
    for kind, name in zip(dict.fromkeys(kinds), law_names(config, kinds, direct_closure), strict=True):
        rest, *others = (
            (files.cell, _law_of_cell(files, one, kind, name, stack, direct_closure, store))
            for files, one in folder.of_each_cell(config)
        )
        named = {cell: each.law for cell, each in others if cell is not None}
        law = RegionLaw.by_cell(config.macro.regions, rest[1].law, named)
        found[name] = RunLaw(law, tuple(solves for _, each in (rest, *others) for solves in each.solves))
    return found


def _law_of_cell(
    folder: RunFolder,
    config: RunConfig,
    kind: LawKind,
    name: str,
    stack: ExitStack,
    direct_closure: str,
    store: ResultStore | None,
) -> RunLaw:
    """Return the law of a kind of one cell; see :func:`macro_laws`."""
    reference = load_reference(folder, config)
    if kind == "surrogate":
        return RunLaw(_of_the_surrogate(folder, config, reference))
    if kind == "linear" and config.cell.parameters:
        # Coefficients at the parameters of each point.
        return RunLaw(LinearisedLaw(_of_the_surrogate(folder, config, reference), name))
    if kind == "linear":
        return RunLaw(LinearPoroelasticity(linear_coefficients(reference, config)))
    pool = stack.enter_context(_pool(config, store))
    if kind == "fallback":
        return _learning(folder, config, pool, stack, name)
    rest = reference.resting(config.conductivity)
    identity = config.stages.cell + ("" if rest.conductivity is None else "-deformed")
    cells = DirectCellLaw(pool, rest, identity, *_members(config))
    closure = reference.closure(direct_closure, config.cell.solid, config.conductivity)
    return RunLaw(ClosedLaw(cells, closure, name=name), (CellSolves(cells, folder.direct_work, pool),))


def porosity_of(law: MacroLaw, reference: CellReference) -> float | Callable[[Array], Array]:
    """Return φ_f of the undeformed cell of a law of a run; with parameters a function of them, (n, m) to (n,)."""
    closed = law.law if isinstance(law, LinearisedLaw) else law
    return closed.porosity if isinstance(closed, ClosedLaw) and closed.parameters else reference.porosity


def _of_the_surrogate(folder: RunFolder, config: RunConfig, reference: CellReference) -> ClosedLaw:
    """Return the law of the fitted surrogate with the configured closure."""
    closure = reference.closure(config.closure, config.cell.solid, config.conductivity)
    return ClosedLaw(load_surrogate(folder, config), closure, identity=config.stages.training)


def _pool(config: RunConfig, store: ResultStore | None) -> CellPool:
    arguments = (config.fem.backend, config.fem.options, config.cell, config.conductivity)
    known: SolvedStore | None = solved_states(store, *arguments)
    kept = (MEMBERS_OF_A_BODY,) if config.cell.is_family else ()
    options = config.sampling.pool_options()
    return CellPool(factory_of(config.cell), (*arguments, *kept), **options, known=known)


def _members(config: RunConfig) -> tuple[tuple[str, ...], MembersAtRest] | tuple[()]:
    """Return names of the cell's parameters and what knows its undeformed members; nothing if it has none."""
    if not config.cell.is_family:
        return ()
    at_rest = MembersAtRest(*prepare_undeformed(config.fem.backend, config.fem.options, config.cell))
    return tuple(each.name for each in config.cell.parameters), at_rest


def _learning(folder: RunFolder, config: RunConfig, pool: CellPool, stack: ExitStack, name: str) -> RunLaw:
    """Return the law whose surrogate learns the states outside the sampled range that the run reaches."""
    reference, surrogate = load_reference(folder, config), load_surrogate(folder, config)
    dataset = Dataset.create_or_open(
        folder.fallback,
        inputs=config.input_space(),
        identity=config.stages.sampling,
        provenance=versions(),
    )
    stack.enter_context(dataset.writing())
    adaptive = AdaptiveSurrogate(
        pool,
        dataset,
        training_set(folder, config),
        partial(make_backend, "surrogate", config),
        config.surrogate.seed,
        objective=config.surrogate_model == "potential",
    )
    law = AdaptiveLaw(
        adaptive.known(surrogate),
        reference.closure(config.closure, config.cell.solid, config.conductivity),
        adaptive,
        identity=f"{config.stages.training} with fallback",
        name=name,
    )
    return RunLaw(law, (CellSolves(adaptive, folder.fallback_work, pool),))


#: Law and load of a solution.
Case = tuple[str, float]


def solve(
    folder: RunFolder,
    config: RunConfig,
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
    by default the closure of ``config`` does. Cells that a law solves are taken from ``store`` where it holds them.
    Solutions do not depend on one another: several are solved at a time where there are cores and memory, in
    ``processes`` if they are given and not too many.

    Raises
    ------
    ConfigurationError
        ``laws`` is no sequence of known kinds.
    """
    require_laws(laws)
    closure = direct_closure or config.closure
    kinds = dict(zip(law_names(config, laws, closure), dict.fromkeys(laws), strict=True))
    solver = make_backend("macro solver", config) if solver is None else solver
    with ExitStack() as stack:
        stack.enter_context(speaking(config.result_units))
        kept = solver.communicator.on_root(partial(_kept, folder, config, list(kinds), backend))
        missing = [case for case, (stays, _) in kept.items() if not stays]
        own = {kinds[name] for name, _ in missing} <= set(USUAL_LAWS) and solver.communicator.size == 1
        count = bodies_at_once(config, len(missing)) if own else 1
        if count > 1:
            console.note(f"solving: {len(missing)} solutions, {count} at a time")
            given = processes is not None and count >= min(processes.count, len(missing))
            with nullcontext(processes) if processes and given else CallProcesses(count) as workers:
                _solve_beside(folder, config, kinds, kept, backend, console, workers)
        else:
            chosen = macro_laws(folder, config, stack, laws, closure, store)
            said: set[str] = set()
            for load in config.macro.loads:
                _solve_load(folder, config, load, chosen, kept, solver, backend, console, said)
    return list(kinds)


def _kept(
    folder: RunFolder, config: RunConfig, names: Sequence[str], backend: str | None
) -> dict[Case, tuple[bool, str]]:
    """Return whether the folder holds a solution that may stay, and a line on one that it holds, for each case."""
    found = {}
    for load in config.macro.loads:
        for name in names:
            path, stays, line = folder.solution(name, load), False, ""
            if path.exists():
                solution = load_solution(folder, name, load)
                of = solution.backend
                stays = backend is None or of == backend
                if stays and solution.units.as_text() != config.result_units.as_text():
                    # Scales and units may change while a run goes on.
                    replace(solution, units=config.result_units).save(path)
                line = f"solving: {path.name} is there already"
                if not stays:
                    line = (
                        f"solving: {path.name} is of {of or 'another backend'}; solved again with {backend}"
                    )
            found[name, load] = stays, line
    return found


def _solve_load(
    folder: RunFolder,
    config: RunConfig,
    load: float,
    laws: dict[str, RunLaw],
    kept: dict[Case, tuple[bool, str]],
    solver: MacroSolver,
    backend: str | None,
    console: Console,
    said: set[str],
) -> None:
    communicator, prepared = solver.communicator, None
    problem = config.macro.problem(load)
    for name, run in laws.items():
        path = folder.solution(name, load)
        stays, line = kept[name, load]
        _say_once(line, said, console)
        if stays:
            continue
        if prepared is None:
            prepared = prepared_body(solver, config, problem, backend)
            _say_once(_remark(solver, prepared), said, console)
        clock = StageClock()
        with (
            communicator.holding(timed(folder.timings, _stage(name, load), clock)),
            run.cost_recorded(path.stem),
            run.taken_told(path.stem, console, clock),
            body_progress(console, f"{name}, load {load:g}", problem, config.result_units) as (show, say),
        ):
            run.tell_work(say)
            words = solve_body(folder, config, run, problem, solver, prepared, backend, name, show)
        if words:
            console.note(f"{path.stem}: {words}")
        for line in run.work_in_words():
            console.note(f"{path.stem}: {line}")


def prepared_body(
    solver: MacroSolver, config: RunConfig, problem: MacroProblem, backend: str | None = None
) -> Any:
    """Return what a macro solver makes of a problem; ``backend`` is its name if it is not the configured one.

    Raises
    ------
    ConfigurationError
        The solver does not offer a part of the problem.
    """
    require_parts(type(solver), backend or config.macro_backend, problem)
    return solver.prepare(problem)


def _remark(solver: MacroSolver, prepared: Any) -> str:
    line = solver.remark(prepared)
    return line and f"solving: {line}"


def _stage(law: str, load: float) -> str:
    return f"macro, {law}, load {load:g}"


def solve_body(
    folder: RunFolder,
    config: RunConfig,
    run: RunLaw,
    problem: MacroProblem,
    solver: MacroSolver,
    prepared: Any,
    backend: str | None,
    name: str,
    show: Callable[[StepReport], None],
) -> str:
    """Solve one load with one law, save the solution, and return the work of the linear systems in words."""
    load, communicator = problem.load, solver.communicator
    checkpoint = folder.macro_checkpoint(name, load)
    solution = body_solution_of(solver, prepared, run.law, problem, checkpoint=checkpoint, on_step=show)
    solution = replace(
        whole_specimen(solution, problem),
        backend=backend or config.macro_backend,
        units=config.result_units,
    )
    communicator.on_root(partial(solution.save, folder.solution(name, load)))
    communicator.on_root(partial(checkpoint.unlink, missing_ok=True))
    return work_in_words(solution.work)


def solve_elsewhere(
    tell: Tell, folder: RunFolder, config: RunConfig, laws: Sequence[LawKind], case: Case, backend: str | None
) -> str:
    """Solve one load with one of ``laws`` in this process; see :func:`solve_body`.

    ``tell`` receives how the linear systems are solved, and then every step.
    """
    name, load = case
    with ExitStack() as stack:
        stack.enter_context(speaking(config.result_units))
        # All of them, since the libraries of a surrogate are loaded before those of the solver, as in one process.
        run = macro_laws(folder, config, stack, laws)[name]
        solver = make_backend("macro solver", config.with_backends(macro=backend))
        problem = config.macro.problem(load)
        prepared = prepared_body(solver, config, problem, backend)
        tell(_remark(solver, prepared))
        return solve_body(folder, config, run, problem, solver, prepared, backend, name, tell)


def _solve_beside(
    folder: RunFolder,
    config: RunConfig,
    kinds: dict[str, LawKind],
    kept: dict[Case, tuple[bool, str]],
    backend: str | None,
    console: Console,
    processes: CallProcesses,
) -> None:
    """Solve what is missing in processes; show one after the other, as if they were solved in that order."""
    laws = tuple(kinds.values())
    calls = {
        _stage(*case): processes.submit(
            f"while it solved '{case[0]}' under load {case[1]:g}",
            *(solve_elsewhere, folder, config, laws, case, backend),
        )
        for case, (stays, _) in kept.items()
        if not stays
    }
    said: set[str] = set()
    with cut_short_timed(folder.timings, calls, processes):
        for (name, load), (_, line) in kept.items():
            _say_once(line, said, console)
            if call := calls.pop(_stage(name, load), None):
                _follow(folder, config, name, load, call, console, said)


def _follow(
    folder: RunFolder, config: RunConfig, name: str, load: float, call: Call, console: Console, said: set[str]
) -> None:
    """Show the steps of a solve in another process, and how it ended."""
    call.begin()
    problem = config.macro.problem(load)
    with (
        timed(folder.timings, _stage(name, load), StageClock(call.time)),
        body_progress(console, f"{name}, load {load:g}", problem, config.result_units, call.time) as (
            show,
            _,
        ),
    ):
        for told in call.reports():
            if isinstance(told, StepReport):
                show(told)
            else:
                _say_once(told, said, console)
        words = call.result()
    if words:
        console.note(f"{folder.solution(name, load).stem}: {words}")


def _say_once(line: str, said: set[str], console: Console) -> None:
    """Print a line that is the same for several loads when it first comes."""
    if line and line not in said:
        console.note(line)
        said.add(line)


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

    ``clock`` tells the time of the process that solves; by default this one does. ``scale`` returns the factor from the
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
