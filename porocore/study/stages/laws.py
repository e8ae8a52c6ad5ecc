"""Laws of a run by name: the surrogate's, linear, direct FE², a surrogate that learns on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal, get_args

from porocore.core.console import Console
from porocore.core.echo import echo, suggestion
from porocore.core.files.store import ResultStore
from porocore.errors import ConfigurationError
from porocore.interfaces.law import MacroLaw
from porocore.macro.composition.linearised_law import LinearisedLaw
from porocore.macro.composition.region_law import RegionLaw
from porocore.macro.laws import AdaptiveLaw, ClosedLaw
from porocore.macro.laws.adaptive_surrogate import AdaptiveSurrogate
from porocore.macro.laws.direct import DirectCellLaw
from porocore.macro.laws.direct_record import SolvesCells, cost_recorded
from porocore.macro.laws.linear import LinearPoroelasticity
from porocore.macro.reference import CellReference
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.execution.members import MembersAtRest
from porocore.sampling.execution.solved_store import SolvedStore
from porocore.states import Array
from porocore.study.backends import make_backend
from porocore.study.config.config import RunConfig
from porocore.study.run_folder.files import LINEAR, direct_law, fallback_law
from porocore.study.run_folder.folder import RunFolder
from porocore.study.run_folder.provenance import versions
from porocore.study.run_folder.stage_times import StageClock
from porocore.study.stages.stage_files import (
    factory_of,
    linear_coefficients,
    load_reference,
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
