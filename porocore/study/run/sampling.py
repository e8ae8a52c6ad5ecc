"""The sampling stage: undeformed members of a family, states that a sampler asks for, and the held-out ones.

States that the data sets hold are not solved again.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack

from porocore.core.console import Console
from porocore.core.files.store import ResultStore
from porocore.core.units import using_units
from porocore.errors import DataError
from porocore.interfaces.sampler import Sampler
from porocore.sampling.campaign import CampaignProgress, CampaignSummary, WarmStarts, run_campaign
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.execution.interrupts import listening
from porocore.sampling.forecast import Guess
from porocore.states import Array, Status
from porocore.study.notes.abilities import uncovered
from porocore.study.notes.forecast import guessed_times
from porocore.study.run.composition import (
    cell_pool,
    drop_misplaced,
    held_out_states,
    informed_sampler,
    prepare_undeformed,
)
from porocore.study.run.folder import RunFolder, timed, versions
from porocore.study.run.results import load_reference, undeformed_members
from porocore.study.store import solved_members, told


def sample(
    folder: RunFolder,
    *,
    console: Console,
    retry_lost: bool = False,
    store: ResultStore | None = None,
    pool: CellPool | None = None,
    sampled: Callable[[], None] = lambda: None,
) -> None:
    """Solve the sampler's states and the held-out random states; those that ``store`` holds are taken from there.

    ``pool`` solves them, as :func:`~porocore.study.run.composition.cell_pool` makes them; by default new ones.
    ``sampled`` is called when the sampler's states are known, before the held-out ones. With ``retry_lost``, states
    over which workers died or hung in an earlier session are solved again. The undeformed members of a family of
    cells are solved before, by workers of their own.
    """
    config = folder.config
    inputs = config.input_space()
    for warning in uncovered(inputs, config.cell.point_group):
        console.warn(folder.said_of_cell(warning))
    provenance = {"config": config.resolved_yaml(), **versions(), **load_reference(folder).mesh}
    stages = [
        ("sampling", folder.dataset, config.stages.sampling),
        ("held-out states", folder.test_dataset, config.stages.test),
    ]
    with ExitStack() as stack:
        stack.enter_context(using_units(config.result_units))
        stack.enter_context(listening(console.note))
        if config.cell.is_family:
            solve_undeformed(folder, provenance, console=console, retry_lost=retry_lost, store=store)
        sampler = informed_sampler(folder)
        workers = (
            stack.enter_context(cell_pool(config, store, on_warning=console.warn)) if pool is None else pool
        )
        states, ended, known = sampler, 0, workers.known
        solved: Array | None = None
        starts: WarmStarts | None = None
        for title, path, identity in stages:
            dataset = Dataset.create_or_open(path, inputs=inputs, identity=identity, provenance=provenance)
            if path == folder.test_dataset:
                sampled()
                samples = Dataset.open(folder.dataset)
                solved, starts = samples.seconds(), WarmStarts(samples, config.cell.modulus)
                drop_misplaced(dataset, held_out_states(config, samples))
                states = held_out_states(config, samples)
            if retry_lost:
                dataset.drop(dataset.ended(Status.lost))
            guess = guessed_times(config, states, solved)
            summary = _campaign(title, states, workers, dataset, folder, console, guess, starts)
            ended += summary.solved
            _tell(title, summary, folder, console)
    if known and known.found:
        console.note(f"store: {known.found} of {ended} states were taken, {ended - known.found} were solved")
    if known and known.store.fault:
        console.warn(f"{known.store.fault}; the solved states are in the run folder alone")


def solve_undeformed(
    folder: RunFolder,
    provenance: Mapping[str, str],
    *,
    console: Console,
    retry_lost: bool = False,
    store: ResultStore | None = None,
) -> None:
    """Solve the undeformed members of a family into a data set of their own; see :func:`sample`.

    A member that cannot be made, or whose solve fails, is a row with a status.

    Raises
    ------
    DataError
        No member could be solved, or the file is damaged or belongs to another family.
    """
    title, config = "undeformed members", folder.config
    members = undeformed_members(config.cell)
    backend = (config.fem.backend, config.fem.options, config.cell)
    dataset = Dataset.create_or_open(
        folder.undeformed, inputs=members.inputs, identity=config.stages.cell, provenance=provenance
    )
    if retry_lost:
        dataset.drop(dataset.ended(Status.lost))
    with CellPool(
        prepare_undeformed,
        backend,
        **config.sampling.pool_options(),
        fields=False,
        on_warning=console.warn,
        known=solved_members(store, *backend),
    ) as workers:
        summary = _campaign(title, members, workers, dataset, folder, console, guessed_times(config, members))
    _tell(title, summary, folder, console, "members")
    if not dataset.responses().stable.any():
        raise DataError(
            f"{folder.undeformed}: no member of the family could be solved; narrow the ranges of the cell, refine its "
            f"mesh (cell.mesh.size), or see single members with porocore cell state --parameters"
        )


def _campaign(
    title: str,
    sampler: Sampler,
    pool: CellPool,
    dataset: Dataset,
    folder: RunFolder,
    console: Console,
    guess: Guess,
    starts: WarmStarts | None = None,
) -> CampaignSummary:
    """Solve the states of a sampler with progress; record the time, and tell what came from the store."""
    shown = folder.stage_of_cell(title)
    with (
        timed(folder.timings, title) as clock,
        told(pool.known, shown, console.note, clock.add, pool.workers),
        console.task(shown, "states") as task,
    ):

        def show(progress: CampaignProgress) -> None:
            detail = "stopping" if progress.stopping else progress.doing
            task.update(
                progress.done,
                progress.expected,
                failed=progress.failed,
                detail=detail,
                seconds=progress.seconds,
            )

        summary = run_campaign(sampler, pool, dataset, on_progress=show, guess=guess, starts=starts)
        clock.idle = not summary.solved
    return summary


def _tell(
    title: str, summary: CampaignSummary, folder: RunFolder, console: Console, what: str = "states"
) -> None:
    title = folder.stage_of_cell(title)
    counts = ", ".join(f"{n} {status.name.replace('_', ' ')}" for status, n in summary.counts.items())
    console.note(f"{title}: {sum(summary.counts.values())} {what}: {counts}")
    if lost := summary.counts.get(Status.lost, 0):
        console.warn(
            f"{title}: {lost} states were lost: on each, two workers died or exceeded the time limit. Lost states "
            f"count as failed. To try them again: porocore sample {folder.whole.path} --retry-lost"
        )
