"""The macro stage: laws of a run by name, every load solved with each, its progress, fallback that learns.

Existing solutions stay; an interrupted solve continues from its checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal, get_args

from porocore.core.console import Console
from porocore.core.echo import echo, suggestion
from porocore.core.files.store import ResultStore
from porocore.core.units.results import ResultUnits, speaking
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.solution import StepReport
from porocore.macro.boundary.symmetry import whole_specimen
from porocore.macro.integration.forecast import StepForecast
from porocore.macro.laws import AdaptiveLaw, ClosedLaw
from porocore.macro.laws.adaptive_surrogate import AdaptiveSurrogate
from porocore.macro.laws.direct import DirectCellLaw
from porocore.macro.laws.direct_record import SolvesCells, cost_recorded
from porocore.macro.laws.linear import LinearPoroelasticity
from porocore.macro.linear_systems.figures import step_in_words, work_in_words
from porocore.macro.problem import MacroProblem
from porocore.plugins.border import body_solution_of
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.execution.solved_store import SolvedStore
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.preflight.abilities import require_parts
from porocore.study.run_folder.files import LINEAR, direct_law, fallback_law
from porocore.study.run_folder.folder import RunFolder
from porocore.study.run_folder.provenance import versions
from porocore.study.stages.stage_files import (
    linear_coefficients,
    load_reference,
    load_solution,
    load_surrogate,
    prepare_cell,
    training_set,
)
from porocore.study.stages.stage_times import StageClock, timed
from porocore.study.store import solved_states, told

LawKind = Literal["surrogate", "linear", "direct", "fallback"]
#: Laws that are solved by default.
USUAL_LAWS: tuple[LawKind, ...] = ("surrogate", "linear")


@dataclass(frozen=True)
class RunLaw:
    """A law of a run, and for one that solves cells their solver, the record of its work and the pool."""

    law: MacroLaw
    cells: SolvesCells | None = None
    record: Path | None = None
    pool: CellPool | None = None

    def cost_recorded(self, solution: str) -> AbstractContextManager[None]:
        """Add the cells that the block solves to the record of ``solution``."""
        if self.cells is None or self.record is None:
            return nullcontext()
        return cost_recorded(self.record, solution, self.cells.work)

    def taken_told(self, title: str, console: Console, clock: StageClock) -> AbstractContextManager[None]:
        """Tell what the block takes from the store, and count on the clock what it saves."""
        if self.pool is None:
            return nullcontext()
        return told(self.pool.known, title, console.note, clock.add, self.pool.workers)


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
) -> list[str]:
    """Solve the macro problem under every load with each of ``laws``; return the laws' names.

    With ``solver``, named ``backend``, solutions of other backends are replaced; otherwise the configured one solves
    what is missing. All processes that share a solver call this. ``direct_closure`` closes the cells of direct FE²;
    by default the closure of ``config`` does. Cells that a law solves are taken from ``store`` where it holds them.

    Raises
    ------
    ConfigurationError
        ``laws`` is no sequence of known kinds.
    """
    require_laws(laws)
    with ExitStack() as stack:
        stack.enter_context(speaking(config.result_units))
        chosen = macro_laws(folder, config, stack, laws, direct_closure or config.closure, store)
        if solver is None:
            solver = make_backend("macro solver", config)
        said: set[str] = set()
        for load in config.macro.loads:
            _solve_load(folder, config, load, chosen, solver, backend, console, said)
        return list(chosen)


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
    reference = load_reference(folder, config)
    laws: dict[str, RunLaw] = {}
    for kind, name in zip(dict.fromkeys(kinds), law_names(config, kinds, direct_closure), strict=True):
        if kind == "surrogate":
            closure = reference.closure(config.closure, config.cell.solid, config.conductivity)
            surrogate = load_surrogate(folder, config)
            laws[name] = RunLaw(ClosedLaw(surrogate, closure, identity=config.stages.training))
        elif kind == "linear":
            laws[name] = RunLaw(LinearPoroelasticity(linear_coefficients(reference, config)))
        elif kind == "fallback":
            laws[name] = _learning(folder, config, stack.enter_context(_pool(config, store)), stack, name)
        else:
            rest = reference.resting(config.conductivity)
            identity = config.stages.cell + ("" if rest.conductivity is None else "-deformed")
            pool = stack.enter_context(_pool(config, store))
            cells = DirectCellLaw(pool, rest, identity)
            closure = reference.closure(direct_closure, config.cell.solid, config.conductivity)
            laws[name] = RunLaw(ClosedLaw(cells, closure, name=name), cells, folder.direct_work, pool)
    return laws


def _pool(config: RunConfig, store: ResultStore | None) -> CellPool:
    arguments = (config.fem.backend, config.fem.options, config.cell, config.conductivity)
    known: SolvedStore | None = solved_states(store, *arguments)
    return CellPool(prepare_cell, arguments, **config.sampling.pool_options(), known=known)


def _learning(folder: RunFolder, config: RunConfig, pool: CellPool, stack: ExitStack, name: str) -> RunLaw:
    """Return the law whose surrogate learns the states outside the sampled range that the run reaches."""
    reference, surrogate = load_reference(folder, config), load_surrogate(folder, config)
    dataset = Dataset.create_or_open(
        folder.fallback,
        inputs=config.sampling.input_space(),
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
    return RunLaw(law, adaptive, folder.fallback_work, pool)


def _solve_load(
    folder: RunFolder,
    config: RunConfig,
    load: float,
    laws: dict[str, RunLaw],
    solver: MacroSolver,
    backend: str | None,
    console: Console,
    said: set[str],
) -> None:
    communicator, prepared = solver.communicator, None
    problem = config.macro.problem(load)
    for name, run in laws.items():
        path = folder.solution(name, load)
        if communicator.on_root(partial(_is_solved, folder, name, load, backend, console)):
            continue
        if prepared is None:
            require_parts(type(solver), backend or config.macro_backend, problem)
            prepared = solver.prepare(problem)
            _say_once(solver.remark(prepared), said, console)
        checkpoint, clock = folder.macro_checkpoint(name, load), StageClock()
        with (
            communicator.holding(timed(folder.timings, f"macro, {name}, load {load:g}", clock)),
            run.cost_recorded(path.stem),
            run.taken_told(path.stem, console, clock),
            body_progress(console, f"{name}, load {load:g}", problem, config.result_units) as (show, say),
        ):
            if run.cells is not None:
                run.cells.on_work = say
            solution = body_solution_of(
                solver, prepared, run.law, problem, checkpoint=checkpoint, on_step=show
            )
            solution = whole_specimen(solution, problem)
            solution = replace(solution, backend=backend or config.macro_backend)
            communicator.on_root(partial(solution.save, path))
        if words := work_in_words(solution.work):
            console.note(f"{path.stem}: {words}")
        if run.cells is not None:
            console.note(f"{path.stem}: {run.cells.work.in_words()}")
        communicator.on_root(partial(checkpoint.unlink, missing_ok=True))


def _say_once(line: str, said: set[str], console: Console) -> None:
    """Print a line that is the same for several loads when it first comes."""
    if line and line not in said:
        console.note(f"solving: {line}")
        said.add(line)


@contextmanager
def body_progress(
    console: Console, title: str, problem: MacroProblem, units: ResultUnits
) -> Iterator[tuple[Callable[[StepReport], None], Callable[[str], None]]]:
    """Show the progress of a macro solve; yield what to call after each step, and with the work between two steps."""
    time, length = units.factor("time"), units.factor("displacement")
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
        update(f"settlement {length * step.settlement:.4g}{of_length}{step_in_words(step.work)}")

    with console.task(title, unit.strip(), "t = ") as task:
        yield show, update


def _is_solved(folder: RunFolder, law: str, load: float, backend: str | None, console: Console) -> bool:
    """Return True if the folder holds a solution that may stay."""
    path = folder.solution(law, load)
    if not path.exists():
        return False
    found = load_solution(folder, law, load)
    if backend is None or found.backend == backend:
        console.note(f"solving: {path.name} is there already")
        return True
    console.note(
        f"solving: {path.name} is of {found.backend or 'another backend'}; solved again with {backend}"
    )
    return False
