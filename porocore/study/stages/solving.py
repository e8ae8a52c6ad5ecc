"""The macro stage: every load solved with each law by name, side by side where that pays.

Existing solutions stay; an interrupted solve continues from its checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

from porocore.cell.cell import Cell
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
from porocore.macro.laws.closure import Closure
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
from porocore.study.config.config import FemSettings, RunConfig
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
    def accounted(self, solution: str, console: Console, clock: StageClock) -> Iterator[None]:
        """Add the cells that the block solves to the records of ``solution``; note what comes from the store.

        What that saves counts on the clock.
        """
        with ExitStack() as stack:
            for each in self.solves:
                pool = each.pool
                stack.enter_context(cost_recorded(each.record, solution, each.cells.work))
                stack.enter_context(told(pool.known, solution, console.note, clock.add, pool.workers))
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


def law_names(closure: str, laws: Sequence[LawKind], direct_closure: str | None = None) -> list[str]:
    """Return the names under which :func:`solve` keeps the solutions; direct FE² may have another closure."""
    names = {"surrogate": closure, "linear": LINEAR, "direct": direct_law(direct_closure or closure)}
    names["fallback"] = fallback_law(closure)
    return [names[kind] for kind in dict.fromkeys(laws)]


def macro_laws(
    folder: RunFolder,
    stack: ExitStack,
    kinds: Sequence[LawKind] = USUAL_LAWS,
    direct_closure: str | None = None,
    store: ResultStore | None = None,
) -> dict[str, RunLaw]:
    """Return the laws of a run by name; processes that a law needs end with ``stack``."""
    found = dict[str, RunLaw]()
    config = folder.config
    closure = direct_closure or config.closure
    for kind, name in zip(dict.fromkeys(kinds), law_names(config.closure, kinds, closure), strict=True):
        rest, *others = (
            (files.cell, _law_of_cell(files, kind, name, stack, closure, store))
            for files in folder.of_each_cell
        )
        named = {cell: each.law for cell, each in others if cell is not None}
        law = RegionLaw.by_cell(config.macro.regions, rest[1].law, named)
        found[name] = RunLaw(law, tuple(solves for _, each in (rest, *others) for solves in each.solves))
    return found


def _law_of_cell(
    folder: RunFolder,
    kind: LawKind,
    name: str,
    stack: ExitStack,
    direct_closure: str,
    store: ResultStore | None,
) -> RunLaw:
    """Return the law of a kind of one cell; see :func:`macro_laws`."""
    config = folder.config
    if kind == "surrogate":
        return RunLaw(_of_the_surrogate(folder))
    if kind == "linear" and config.cell.parameters:
        # Coefficients at the parameters of each point.
        return RunLaw(LinearisedLaw(_of_the_surrogate(folder), name))
    if kind == "linear":
        return RunLaw(LinearPoroelasticity(linear_coefficients(folder)))
    reference, pool = load_reference(folder), stack.enter_context(_pool(config, store))
    if kind == "fallback":
        return _learning(folder, pool, stack, name)
    rest = reference.resting(config.conductivity)
    identity = config.stages.cell + ("" if rest.conductivity is None else "-deformed")
    cells = DirectCellLaw(pool, rest, identity, *_members(config.cell, config.fem))
    closure = reference.closure(direct_closure, config.cell.solid, config.conductivity)
    return RunLaw(ClosedLaw(cells, closure, name=name), (CellSolves(cells, folder.direct_work, pool),))


def porosity_of(law: MacroLaw, reference: CellReference) -> float | Callable[[Array], Array]:
    """Return φ_f of the undeformed cell of a law of a run; with parameters a function of them, (n, m) to (n,)."""
    closed = law.law if isinstance(law, LinearisedLaw) else law
    return closed.porosity if isinstance(closed, ClosedLaw) and closed.parameters else reference.porosity


def _of_the_surrogate(folder: RunFolder) -> ClosedLaw:
    """Return the law of the fitted surrogate with the configured closure."""
    closure = _closure(folder)
    return ClosedLaw(load_surrogate(folder), closure, identity=folder.config.stages.training)


def _closure(folder: RunFolder) -> Closure:
    """Return the configured closure of the run's cell."""
    config = folder.config
    return load_reference(folder).closure(config.closure, config.cell.solid, config.conductivity)


def _pool(config: RunConfig, store: ResultStore | None) -> CellPool:
    arguments = (config.fem.backend, config.fem.options, config.cell, config.conductivity)
    known: SolvedStore | None = solved_states(store, *arguments)
    kept = (MEMBERS_OF_A_BODY,) if config.cell.is_family else ()
    options = config.sampling.pool_options()
    return CellPool(factory_of(config.cell), (*arguments, *kept), **options, known=known)


def _members(cell: Cell, fem: FemSettings) -> tuple[tuple[str, ...], MembersAtRest] | tuple[()]:
    """Return names of the cell's parameters and what knows its undeformed members; nothing if it has none."""
    if not cell.is_family:
        return ()
    at_rest = MembersAtRest(*prepare_undeformed(fem.backend, fem.options, cell))
    return tuple(each.name for each in cell.parameters), at_rest


def _learning(folder: RunFolder, pool: CellPool, stack: ExitStack, name: str) -> RunLaw:
    """Return the law whose surrogate learns the states outside the sampled range that the run reaches."""
    config, surrogate = folder.config, load_surrogate(folder)
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
        training_set(folder),
        partial(make_backend, "surrogate", config),
        config.surrogate.seed,
        objective=config.surrogate_model == "potential",
    )
    law = AdaptiveLaw(
        adaptive.known(surrogate),
        _closure(folder),
        adaptive,
        identity=f"{config.stages.training} with fallback",
        name=name,
    )
    return RunLaw(law, (CellSolves(adaptive, folder.fallback_work, pool),))


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
        stack.enter_context(speaking(config.result_units))
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
            clock, problem = solves.begin(case, note_once), config.macro.problem(case.load)
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
            problem = config.macro.problem(case.load)
            prepared = prepared_body(self._solver, config.macro_backend, problem)
            self._prepared = problem, prepared
            if line := self._solver.remark(prepared):
                note(f"solving: {line}")
        return StageClock()

    def end(
        self, case: SolutionCase, show: Callable[[StepReport], None], busy: Callable[[str], None], *_: Any
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
        stack.enter_context(speaking(config.result_units))
        # All of them, since the libraries of a surrogate are loaded before those of the solver, as in one process.
        solves = _Here(folder, macro_laws(folder, stack, laws), make_backend("macro solver", config))
        solves.begin(case, tell)
        return solves.end(case, tell, tell)


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
