"""The study of sub-volumes as a whole, solved in parallel processes as the memory allows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from porocore.commands.representative.outlook import SizeOutlook, foresee
from porocore.commands.representative.plan import SubvolumePlan
from porocore.commands.representative.results import (
    FILE,
    RepresentativeVolume,
    holds_results,
    identity_of,
    judge,
    load,
    save,
)
from porocore.commands.representative.scan import (
    LOOSE,
    LOST,
    SOLVED,
    Corner,
    Scan,
    Subvolume,
    SubvolumeJob,
    solve_subvolume,
)
from porocore.commands.representative.tables import summary, write_tables
from porocore.core.console import Console
from porocore.core.files.store import ResultStore
from porocore.core.units import speaking
from porocore.errors import PluginError, PorocoreError
from porocore.study.config.config import RunConfig, cell_identity
from porocore.study.notes.checks import find_backends
from porocore.study.series import Case, RunSeries, claim_record
from porocore.study.store import cell_key, chosen_store


class SubvolumeSeries(RunSeries[Subvolume]):
    """Sub-volumes of an image, in a record by the identities of their cells.

    Parameters
    ----------
    config, scan
        The study, and its image.
    record
        ``rev.json``.
    store
        Results that studies share.
    resume
        Take what the record holds.
    """

    title, unit = "rev", "cells"
    function = solve_subvolume

    def __init__(
        self, config: RunConfig, scan: Scan, record: Path, store: ResultStore | None, *, resume: bool
    ) -> None:
        self._fem, self._scan, self._record, self._store = config.fem, scan, record, store
        self.identity = identity_of(config, scan)
        # Further ones that the record holds stay in it.
        super().__init__(load(record, self.identity) if resume and record.exists() else {})

    def cases(self, outlooks: Iterable[SizeOutlook]) -> list[Case]:
        """Return the sub-volumes that are solved, in the order of their memory."""
        return [
            Case(
                job.identity,
                (job, self._fem, self._store),
                f"{list(corner)} of {job.size} voxels",
                work=outlook.seconds,
                side_by_side=outlook.side_by_side,
            )
            for outlook in outlooks
            for corner in outlook.corners
            for job in (self._job(outlook.size, corner),)
        ]

    def _job(self, size: int, corner: Corner) -> SubvolumeJob:
        cell = self._scan.subvolume(corner, size)
        return SubvolumeJob(cell, cell_identity(cell, self._fem), size, corner, self._scan.edge(size))

    def save(self, case: Case, result: Subvolume) -> None:
        """Write the record."""
        save(self._record, self.identity, self.known.values())

    def stored(self, case: Case) -> tuple[Subvolume, float] | None:
        """Return a sub-volume whose cell the store holds."""
        job, fem, store = case.arguments
        key = cell_key(fem.backend, fem.options, job.cell, "piola")
        kept = None if store is None else store.find("cells", key)
        if kept is None:
            return None
        took = float(kept.facts["seconds"])
        return solve_subvolume(lambda told: None, job, fem, store, took), took

    def lost(self, case: Case, error: Exception) -> Subvolume:
        """Return a sub-volume without results; only a plugin that cannot be used ends the others."""
        if isinstance(error, PluginError):
            raise error
        kind = "" if isinstance(error, PorocoreError) else f"{type(error).__name__}: "
        unsolved: Subvolume = case.arguments[0].unsolved(LOST, f"{kind}{error}")
        return unsolved

    def failed(self, result: Subvolume) -> bool:
        """Return whether results are missing."""
        return result.status != SOLVED

    def describe(self, case: Case, result: Subvolume) -> str:
        """Return size and status."""
        return f"{result.size} voxels {result.status}"


def study_representative_volume(
    config: RunConfig,
    folder: Path | str,
    plan: SubvolumePlan | None = None,
    *,
    workers: int | None = None,
    resume: bool = False,
    store: ResultStore | str | Path | bool = True,
    progress: bool = False,
) -> RepresentativeVolume:
    """Solve sub-volumes of growing size of an image, and judge from which size their results stay.

    Parameters
    ----------
    config
        The study; only its cell, finite elements, scales and workers count. The geometry is an image.
    folder
        Place of ``rev.json``, the tables and the picture.
    plan
        Sizes, numbers and places of the sub-volumes.
    workers
        Processes; by default as configured for sampling.
    resume
        Take the sub-volumes that the folder holds; the plan may be another one.
    store
        Folder of results that studies share; True: that of the user, False: none. A cell that it holds is not solved.
    progress
        Show the outlook of each size and the progress on standard error.

    Raises
    ------
    ConfigurationError
        The cell is no image, or its sub-volumes are too large for it or too small for a cell.
    RunFolderError, DataError
        The folder cannot be written, holds a study and ``resume`` is not given, or one of another image or backend.
    PluginError, PorocoreError
        The backend is missing, or all sub-volumes failed.
    """
    folder, plan = Path(folder), SubvolumePlan() if plan is None else plan
    if plan.solve:
        find_backends(config, ["cell solver"])
    scan = Scan.open(config, plan)
    sizes = scan.sizes(plan)
    record, console = folder / FILE, Console.shown(progress)
    # A record of the porosity alone may be replaced.
    claim_record(record, "study", resume=resume or not holds_results(record))
    series = SubvolumeSeries(config, scan, record, chosen_store(store), resume=resume)
    workers = config.sampling.worker_count() if workers is None else workers
    for line in scan.lines():
        console.note(line)
    outlooks = []
    for size in sizes:
        outlooks.append(foresee(scan, plan, size, workers))
        console.note(outlooks[-1].line(workers))
    solved = series.run(series.cases(outlooks), console, workers)
    settling = judge(solved, plan.tolerance)
    found = RepresentativeVolume(plan, scan, tuple(outlooks), tuple(solved), settling, record)
    save(record, series.identity, series.known.values(), **summary(found))
    return _shown(found, config)


def _shown(found: RepresentativeVolume, config: RunConfig) -> RepresentativeVolume:
    """Write tables and picture, and refuse results of nothing."""
    from porocore.commands.representative.figure import write_figure

    folder, solved = found.record.parent, found.subvolumes
    with speaking(config.result_units):
        tables = write_tables(folder, found)
        pictures = write_figure(folder, found)
    if solved and not any(each.status in (SOLVED, LOOSE) for each in solved):
        raise PorocoreError(
            f"none of {len(solved)} sub-volumes could be solved, the first one because: {solved[0].message}"
        )
    return replace(found, tables=tables, pictures=pictures)
