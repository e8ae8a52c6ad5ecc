"""Composition of a run: each of its parts made from its part of the configuration and from files of the run.

Backends by their names and options; cells prepared for this process and for workers; samplers that know the study; what
a surrogate learns from; the laws of the body.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.family.mesh import UnstressedFamily, rest_data
from porocore.core.console import Console
from porocore.core.echo import cut, echo, suggestion
from porocore.core.files.store import ResultStore
from porocore.core.inputs import SampledRange
from porocore.errors import ConfigurationError, DataError
from porocore.interfaces.cell import CellSolver
from porocore.interfaces.law import MacroLaw
from porocore.interfaces.records import RestData
from porocore.interfaces.sampler import Explore, Remember, Sampler, StudyFacts, StudySampler, make_anew
from porocore.interfaces.surrogate import MORE_STATES, TrainingSet, least_states
from porocore.macro.laws.charges import ChargedLaw
from porocore.macro.laws.closure import CLOSURES, Closure
from porocore.macro.laws.composed import RegionLaw
from porocore.macro.laws.direct import AdaptiveSurrogate, DirectCellLaw, SolvesCells, cost_recorded
from porocore.macro.laws.evolution import EvolvingLaw, UnevolvedLaw
from porocore.macro.laws.linear import LinearisedLaw, LinearPoroelasticity
from porocore.macro.laws.macro_law import AdaptiveLaw, ClosedLaw
from porocore.macro.laws.relaxation import RelaxingLaw
from porocore.macro.reference import CellReference
from porocore.plugins.kinds import Kind
from porocore.plugins.registry import registry
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.execution.members import (
    MOST_MEMBERS,
    MembersAtRest,
    MemberSolver,
    PreparedFamily,
    UndeformedMemberSolver,
)
from porocore.sampling.execution.solved_store import SolvedStore, StoringSolver
from porocore.sampling.execution.tasks import Factory
from porocore.sampling.samplers.designs import RandomStates
from porocore.states import Array
from porocore.study.config.config import FemSettings, RunConfig
from porocore.study.notes.abilities import require_conductivity
from porocore.study.run.exploration import BodyAround, MacroExplorer
from porocore.study.run.folder import LINEAR, RunFolder, StageClock, direct_law, fallback_law, versions
from porocore.study.run.results import (
    finished,
    linear_coefficients,
    load_reference,
    load_surrogate,
    load_undeformed,
)
from porocore.study.store import solved_states, told
from porocore.surrogates.polynomial.surrogate import judge


def backends_of(config: RunConfig) -> dict[Kind, tuple[str, dict[str, Any]]]:
    """Return the name and the options of the backend of each kind."""
    return {
        "cell solver": (config.fem.backend, config.fem.options),
        "macro solver": (config.macro_backend, config.macro.options),
        "sampler": (config.sampling.sampler, config.sampling.sampler_options()),
        "surrogate": (config.surrogate.backend, config.surrogate.options),
    }


def make_backend(kind: Kind, config: RunConfig) -> Any:
    """Return the configured backend of one kind, made with its options.

    Raises
    ------
    PluginError
        The backend is unknown, missing or broken.
    ConfigurationError
        The backend does not take these options.
    """
    name, options = backends_of(config)[kind]
    positional = (config.input_space(),) if kind == "sampler" else ()
    implementation = registry().get(kind, name)
    if kind == "surrogate" and implementation.models:
        options = {**options, "model": config.model_of(implementation)}
    try:
        return implementation(*positional, **options)
    except TypeError as error:
        if not options:
            raise
        raise ConfigurationError(
            f"{kind} '{name}' does not take its options {echo(options)}: {cut(str(error))}"
        ) from error


def prepare_cell(
    backend: str, options: dict[str, Any], cell: Cell, conductivity: str = "piola"
) -> tuple[CellSolver, Any]:
    """Return a cell solver and the cell that it has prepared; worker processes call this once.

    Raises
    ------
    ConfigurationError
        The solver cannot compute the conductivity of a deformed pore, or not of this cell; or the cell is a family.
    """
    cell.require_member()
    solver = _cell_solver(backend, options, conductivity)
    return solver, solver.prepare(cell.in_equilibrium, **_keywords(conductivity))


def prepare_stored(
    store: ResultStore | None, backend: str, options: dict[str, Any], cell: Cell, conductivity: str = "piola"
) -> tuple[CellSolver, Any, SolvedStore | None]:
    """Return a cell solver that takes from a store what that holds, the prepared cell, and its states in the store."""
    solver, prepared = prepare_cell(backend, options, cell, conductivity)
    known = solved_states(store, backend, options, cell, conductivity)
    return solver if known is None else StoringSolver(solver, known), prepared, known


def prepare_family(
    backend: str,
    options: dict[str, Any],
    cell: Cell,
    conductivity: str = "piola",
    kept: int = MOST_MEMBERS,
) -> tuple[MemberSolver, PreparedFamily]:
    """Return a solver that keeps some members of a family, and the family; worker processes call this once.

    Raises
    ------
    ConfigurationError
        The solver cannot compute the conductivity of a deformed pore, or not of this cell.
    """
    members = MemberSolver(_cell_solver(backend, options, conductivity), kept)
    return members, members.prepare(cell.in_equilibrium, **_keywords(conductivity))


def prepare_undeformed(
    backend: str, options: dict[str, Any], cell: Cell
) -> tuple[UndeformedMemberSolver, PreparedFamily]:
    """Return a solver of the undeformed members of a family, and the family; worker processes call this once.

    Raises
    ------
    ConfigurationError
        The solver computes no conductivity.
    """
    members = UndeformedMemberSolver(_cell_solver(backend, options, "piola"))
    return members, members.prepare(UnstressedFamily(cell.in_equilibrium))


def _cell_solver(backend: str, options: dict[str, Any], conductivity: str) -> CellSolver:
    """Return a cell solver that computes a conductivity."""
    solver: CellSolver = registry().get("cell solver", backend)(**options)
    require_conductivity(type(solver), backend, conductivity)
    return solver


def _keywords(conductivity: str) -> dict[str, Any]:
    """Return the keywords with which a solver prepares a cell."""
    return {"deformed": True} if conductivity == "deformed" else {}


def factory_of(cell: Cell) -> Factory:
    """Return the function that prepares a cell, or a family of cells, in each worker."""
    return prepare_family if cell.is_family else prepare_cell


def cell_pool(
    config: RunConfig, store: ResultStore | None = None, members: int = MOST_MEMBERS, **how: Any
) -> CellPool:
    """Return the workers that solve the cell of a run, each of which keeps some ``members`` of a family.

    States that ``store`` holds are taken from there; ``how`` are further arguments of the pool.
    """
    arguments = (config.fem.backend, config.fem.options, config.cell, config.conductivity)
    known, kept = solved_states(store, *arguments), (members,) if config.cell.is_family else ()
    options = config.sampling.pool_options() | how
    return CellPool(factory_of(config.cell), (*arguments, *kept), **options, known=known)


def informed_sampler(folder: RunFolder) -> Sampler:
    """Return the configured sampler with the facts of the study, if it takes them."""
    sampler: Sampler = make_backend("sampler", folder.config)
    if isinstance(sampler, StudySampler):
        # Another closure than the one that the run began with learns from the same states.
        config, reference = folder.written, load_reference(folder)
        explore = explorer(config, reference, _body_around(folder))
        sampler.inform(study_facts(config, reference, explore, folder.remembered(), _rests(folder)))
    return sampler


def study_facts(
    config: RunConfig,
    reference: CellReference,
    explore: Explore,
    remember: Remember = make_anew,
    rests: RestData | None = None,
) -> StudyFacts:
    """Return what a sampler may know of the study of a cell.

    ``remember`` keeps its decisions, and ``rests`` are the undeformed members of a family.
    """
    return StudyFacts(
        reference.resting(config.conductivity),
        config.stages.cell,
        CLOSURES[config.closure].responses,
        explore,
        judge,
        config.cell.point_group,
        remember,
        rests,
    )


def explorer(config: RunConfig, reference: CellReference, around: BodyAround | None = None) -> MacroExplorer:
    """Return the macro problem of a study on a coarse mesh; ``around`` is the body of several cells, if it has them."""
    closure = reference.closure(config.closure, config.cell.solid, config.conductivity)
    body = BodyAround(config) if around is None else around
    with_its_memory = partial(with_memory, config=config)
    return MacroExplorer(body, closure, partial(make_backend, "macro solver", config), with_its_memory)


def _body_around(folder: RunFolder) -> BodyAround | None:
    """Return the body of several cells, one of which is that of the folder, with linear laws of the others."""
    whole = folder.whole.written
    if not whole.cells:
        return None
    others: dict[str | None, MacroLaw] = {
        name: with_memory(
            LinearPoroelasticity(linear_coefficients(folder.whole.of_cell(name))),
            whole.of_cell(name),
            linear=True,
        )
        for name in whole.cell_names
        if name != folder.cell
    }
    study = whole.model_copy(update={"macro": whole.fields_of(folder.cell)})
    return BodyAround(study, folder.cell, others)


def held_out_states(config: RunConfig, samples: Dataset) -> RandomStates:
    """Return the sampler of the held-out states; where ``samples`` do not fill the ranges, they lie between those."""
    test, within = config.sampling.test, None
    together = {"states_per_member": test.together} if config.cell.is_family else {}
    if not registry().get("sampler", config.sampling.sampler).fills_ranges:
        within = SampledRange.around(samples.inputs, samples.x()[samples.responses().stable])
    return RandomStates(config.input_space(), count=test.count, seed=test.seed, within=within, **together)


def drop_misplaced(held_out: Dataset, states: RandomStates) -> None:
    """Empty a data set whose held-out states lie elsewhere than ``states`` asks for: the samples have changed."""
    known = [request for request in states.ask() if request.key in held_out]
    if any(held_out.inputs_of(request.key) != request.x for request in known):
        held_out.drop(held_out.keys)


def training_set(folder: RunFolder) -> TrainingSet:
    """Return the stable states of the run, in contact or not.

    Raises
    ------
    DataError
        Sampling is not finished, or there are too few of them.
    """
    sampler, reference, config = informed_sampler(folder), load_reference(folder), folder.config
    dataset = finished(folder, folder.dataset, config.stages.sampling, sampler)
    responses = dataset.responses()
    good = np.flatnonzero(responses.stable)
    if len(good) < (least := least_states(len(dataset.inputs))):
        raise DataError(
            f"{folder.dataset}: {len(good)} of {len(dataset)} states are stable, too few to train on; at least {least} "
            f"are needed: {MORE_STATES}"
        )
    return TrainingSet(
        dataset.states()[good],
        responses[good],
        dataset.inputs,
        reference.resting(config.conductivity),
        config.stages.cell,
        versions(),
        config.cell.point_group,
        config.surrogate.tolerance,
        _rests(folder),
    )


def _rests(folder: RunFolder) -> RestData | None:
    """Return the undeformed members of the run's family; None for a cell without parameters."""
    if not folder.config.cell.is_family:
        return None
    dataset = load_undeformed(folder)
    return rest_data(folder.config.cell, dataset.states(), dataset.responses())


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
    """Return the laws of a run by name, with their memory; processes that a law needs end with ``stack``."""
    found = dict[str, RunLaw]()
    for kind, name in zip(dict.fromkeys(kinds), _names(folder, kinds, direct_closure), strict=True):
        of_cells = {
            files.cell: (files.config, law_of_cell(files, stack, kind, direct_closure, store))
            for files in folder.of_each_cell
        }
        laws = {
            cell: with_memory(each.law, config, linear=kind == "linear")
            for cell, (config, each) in of_cells.items()
        }
        law = law_of_body(folder.config, laws)
        found[name] = RunLaw(law, tuple(solves for _, each in of_cells.values() for solves in each.solves))
    return found


def _names(folder: RunFolder, kinds: Sequence[LawKind], direct_closure: str | None) -> list[str]:
    closure = folder.config.closure
    return law_names(closure, kinds, direct_closure or closure)


def law_of_body(config: RunConfig, laws: Mapping[str | None, MacroLaw]) -> MacroLaw:
    """Return the law of a body by those of its cells; None names that of the rest of the body, or the only one."""
    named = {name: law for name, law in laws.items() if name is not None}
    return RegionLaw.by_cell(config.macro.regions, laws[None], named)


def with_memory(law: MacroLaw, config: RunConfig, *, linear: bool = False) -> MacroLaw:
    """Return the law of a cell with what the study lets it remember: rates of parameters, relaxation, fixed charges.

    They stand one in the other in this order: the charges turn the pressure of the body into that of the pores, the
    relaxation this one into that of the equilibrium, and the evolution gives the cell its parameters. Their own numbers
    are parameters of the law, whose values :meth:`~porocore.study.config.config.RunConfig.problem` has.

    Parameters
    ----------
    law
        Law of a closure, or a ``linear`` one, in equilibrium; the parameters of the latter stay as they begin.
    config
        Study of the cell alone.
    """
    ranges = {each.name: (each.lower, each.upper) for each in config.cell.parameters}
    rates = {
        name: evolution.rate_of(name, law.parameters)
        for name, evolution in config.macro.evolution.items()
        if name in law.parameters
    }
    if rates:
        law = UnevolvedLaw(law, rates) if linear else EvolvingLaw(law, rates, ranges)
    if config.cell.relaxation is not None:
        law = RelaxingLaw(law, len(config.cell.relaxation.branches), small_strain=linear)
    charges = config.macro.charges
    return law if charges is None else ChargedLaw(law, charges.osmotic)


def law_of_cell(
    folder: RunFolder,
    stack: ExitStack,
    kind: LawKind,
    direct_closure: str | None = None,
    store: ResultStore | None = None,
) -> RunLaw:
    """Return the law of a kind of one cell in equilibrium; see :func:`macro_laws`."""
    config = folder.config
    (name,) = _names(folder, (kind,), direct_closure)
    if kind == "surrogate":
        return RunLaw(_of_the_surrogate(folder))
    if kind == "linear" and config.cell.parameters:
        # Coefficients at the parameters of each point.
        return RunLaw(LinearisedLaw(_of_the_surrogate(folder), name))
    if kind == "linear":
        return RunLaw(LinearPoroelasticity(linear_coefficients(folder)))
    reference, pool = load_reference(folder), stack.enter_context(cell_pool(config, store, MEMBERS_OF_A_BODY))
    if kind == "fallback":
        return _learning(folder, pool, stack, name)
    rest = reference.resting(config.conductivity)
    identity = config.stages.cell + ("" if rest.conductivity is None else "-deformed")
    cells = DirectCellLaw(pool, rest, identity, *_members(config.cell, config.fem))
    closure = reference.closure(direct_closure or config.closure, config.cell.solid, config.conductivity)
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
        objective=config.learns_potential,
    )
    law = AdaptiveLaw(
        adaptive.known(surrogate),
        _closure(folder),
        adaptive,
        identity=f"{config.stages.training} with fallback",
        name=name,
    )
    return RunLaw(law, (CellSolves(adaptive, folder.fallback_work, pool),))
