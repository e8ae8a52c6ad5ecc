"""The study of sub-volumes as a whole, solved in parallel processes as the memory allows."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass, replace
from pathlib import Path

from porocore.core.console import duration
from porocore.core.files.atomic import new_folder
from porocore.core.files.store import ResultStore
from porocore.core.units import speaking
from porocore.errors import PluginError, PorocoreError, RunFolderError
from porocore.sampling.execution.pool import ProcessBackend
from porocore.sampling.execution.tasks import Worker
from porocore.study.config.config import FemSettings, RunConfig, cell_identity
from porocore.study.notes.checks import find_backends
from porocore.study.store import cell_key, chosen_store
from porocore.verification.representative.outlook import SizeOutlook, foresee
from porocore.verification.representative.plan import SubvolumePlan
from porocore.verification.representative.results import (
    FILE,
    RepresentativeVolume,
    holds_results,
    identity_of,
    judge,
    load,
    save,
)
from porocore.verification.representative.scan import (
    LOOSE,
    LOST,
    SOLVED,
    Corner,
    Scan,
    Subvolume,
    SubvolumeJob,
    solve_subvolume,
)
from porocore.verification.representative.tables import summary, write_tables

#: Seconds between two looks at interrupts while nothing is finished.
PATIENCE = 0.2
#: Times that a sub-volume is tried whose process ends.
TRIES = 2
_ENDED = "its process ended without a message, as where memory runs out; give fewer --workers"


def solve_all(
    jobs: Iterable[SubvolumeJob], fem: FemSettings, store: ResultStore | None, workers: int
) -> Generator[tuple[SubvolumeJob, Subvolume], None, None]:
    """Yield each job with its results, as they finish; the jobs come in the order of their memory.

    With one worker they run in this process. A process that ends over a sub-volume is replaced and the sub-volume tried
    once more; then its status is ``lost``.

    Raises
    ------
    PluginError
        The backend is missing or returns what it may not.
    """
    waiting = deque(jobs)
    workers = min(workers, len(waiting))
    if workers <= 1:
        for job in waiting:
            yield job, _tried(solve_subvolume, job, fem, store)
        return
    backend = ProcessBackend(workers)
    try:
        yield from _in_processes(backend, waiting, fem, store)
    except BaseException:
        backend.abort()
        raise
    backend.close()


def _in_processes(
    backend: ProcessBackend, waiting: deque[SubvolumeJob], fem: FemSettings, store: ResultStore | None
) -> Generator[tuple[SubvolumeJob, Subvolume], None, None]:
    tries = Counter[str]()
    running: dict[Future[Subvolume], tuple[Worker, SubvolumeJob]] = {}
    while waiting or running:
        busy = {id(worker) for worker, _ in running.values()}
        for worker in backend.workers():
            if waiting and id(worker) not in busy and len(running) < max(1, waiting[0].side_by_side):
                job = waiting.popleft()
                try:
                    running[worker.submit(solve_subvolume, job, fem, store)] = worker, job
                except BrokenExecutor:  # it ended while it had nothing to do
                    backend.lost(worker)
                    waiting.appendleft(job)
        done, _ = wait(running, PATIENCE, return_when=FIRST_COMPLETED)
        for future in done:
            worker, job = running.pop(future)
            if not isinstance(future.exception(), BrokenExecutor):
                yield job, _tried(lambda *_, future=future: future.result(), job, fem, store)
                continue
            backend.lost(worker)
            tries[job.identity] += 1
            if tries[job.identity] < TRIES:
                waiting.appendleft(job)
            else:
                yield job, job.unsolved(LOST, _ENDED)


def _tried(
    call: Callable[..., Subvolume], job: SubvolumeJob, fem: FemSettings, store: ResultStore | None
) -> Subvolume:
    """Return the results of a job; of an exception that nobody meant, what it says."""
    try:
        return call(job, fem, store)
    except PluginError:
        raise
    except Exception as error:  # noqa: BLE001 - one sub-volume does not end the others
        return job.unsolved(LOST, f"{type(error).__name__}: {error}")


@dataclass(frozen=True)
class SubvolumeProgress:
    """Progress of a study after one sub-volume.

    Attributes
    ----------
    size, status
        Edge [voxels] and status of the sub-volume.
    done, expected, failed
        Sub-volumes that are done, all, and those of the done ones without results.
    work
        Expected time of those that are done and of those that are left [s].
    """

    size: int
    status: str
    done: int
    expected: int
    failed: int
    work: tuple[float, float]

    def __str__(self) -> str:
        return f"{self.size} voxels {self.status}"


def study_representative_volume(
    config: RunConfig,
    folder: Path | str,
    plan: SubvolumePlan | None = None,
    *,
    workers: int | None = None,
    resume: bool = False,
    on_subvolume: Callable[[SubvolumeProgress], None] = lambda progress: None,
    store: ResultStore | str | Path | bool = True,
    tell: Callable[[str], None] = lambda text: None,
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
    on_subvolume, tell
        Called after every sub-volume; called with the outlook of each size, and with what came from the store.

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
    if not resume and holds_results(folder / FILE):
        raise RunFolderError(
            f"{folder} already holds a study; add --resume to continue it, or choose another --out"
        )
    identity = identity_of(config, scan)
    known = load(folder / FILE, identity) if resume and (folder / FILE).exists() else {}
    new_folder(folder)
    workers = config.sampling.worker_count() if workers is None else workers
    outlooks, record = _foreseen(scan, plan, sizes, workers, tell), folder / FILE
    campaign = _Solves(config, scan, record, identity, known, chosen_store(store), on_subvolume, tell)
    solved = campaign.run(outlooks, workers)
    settling = judge(solved, plan.tolerance)
    found = RepresentativeVolume(plan, scan, tuple(outlooks), tuple(solved), settling, record)
    save(record, identity, campaign.known.values(), **summary(found))
    return _shown(found, config)


def _foreseen(
    scan: Scan, plan: SubvolumePlan, sizes: tuple[int, ...], workers: int, tell: Callable[[str], None]
) -> list[SizeOutlook]:
    """Tell and return the outlook of each size."""
    for line in scan.lines():
        tell(line)
    outlooks = []
    for size in sizes:
        outlooks.append(foresee(scan, plan, size, workers))
        tell(outlooks[-1].line(workers))
    return outlooks


def _shown(found: RepresentativeVolume, config: RunConfig) -> RepresentativeVolume:
    """Write tables and picture, and refuse results of nothing."""
    from porocore.verification.representative.figure import write_figure

    folder, solved = found.record.parent, found.subvolumes
    with speaking(config.result_units):
        tables = write_tables(folder, found)
        pictures = write_figure(folder, found)
    if solved and not any(each.status in (SOLVED, LOOSE) for each in solved):
        raise PorocoreError(
            f"none of {len(solved)} sub-volumes could be solved, the first one because: {solved[0].message}"
        )
    return replace(found, tables=tables, pictures=pictures)


class _Solves:
    """Sub-volumes that are solved and recorded one by one."""

    def __init__(
        self,
        config: RunConfig,
        scan: Scan,
        path: Path,
        identity: str,
        known: dict[str, Subvolume],
        store: ResultStore | None,
        on_subvolume: Callable[[SubvolumeProgress], None],
        tell: Callable[[str], None],
    ) -> None:
        self.config, self.scan, self.path, self.identity = config, scan, path, identity
        #: By the identities of their cells; further ones that the record holds stay in it.
        self.known = known
        self.store, self.on_subvolume, self.tell = store, on_subvolume, tell

    def run(self, outlooks: list[SizeOutlook], workers: int) -> list[Subvolume]:
        """Solve what is not known and return the sub-volumes of the outlooks, in their order."""
        jobs = [self._job(outlook, corner) for outlook in outlooks for corner in outlook.corners]
        self._expected, self._work = len(jobs), sum(job.seconds for job in jobs)
        self._done = self._failed = 0
        self._behind = 0.0
        left = []
        for job in jobs:
            if job.identity in self.known:
                self._count(job)
            else:
                left.append(job)
        left = self._from_store(left)
        for job, found in solve_all(left, self.config.fem, self.store, workers):
            self._take(job, found)
        return [self.known[job.identity] for job in jobs]

    def _job(self, outlook: SizeOutlook, corner: Corner) -> SubvolumeJob:
        size, cell = outlook.size, self.scan.subvolume(corner, outlook.size)
        identity = cell_identity(cell, self.config.fem)
        return SubvolumeJob(
            cell, identity, size, corner, self.scan.edge(size), outlook.seconds, outlook.side_by_side
        )

    def _from_store(self, jobs: list[SubvolumeJob]) -> list[SubvolumeJob]:
        """Take what the store holds, and return the others."""
        if self.store is None:
            return jobs
        left, saved, fem = [], list[float](), self.config.fem
        for job in jobs:
            kept = self.store.find("cells", cell_key(fem.backend, fem.options, job.cell, "piola"))
            if kept is None:
                left.append(job)
                continue
            saved.append(float(kept.facts["seconds"]))
            self._take(job, solve_subvolume(job, fem, self.store, saved[-1]))
        if saved:
            cells = f"{len(saved)} {'cell' if len(saved) == 1 else 'cells'}"
            self.tell(f"rev: {cells} came from the store, which saved about {duration(sum(saved))}")
        return left

    def _take(self, job: SubvolumeJob, found: Subvolume) -> None:
        self.known[job.identity] = found
        save(self.path, self.identity, self.known.values())
        self._count(job)

    def _count(self, job: SubvolumeJob) -> None:
        found = self.known[job.identity]
        self._done, self._behind = self._done + 1, self._behind + job.seconds
        self._failed += found.status != SOLVED
        work = (self._behind, max(0.0, self._work - self._behind))
        self.on_subvolume(
            SubvolumeProgress(job.size, found.status, self._done, self._expected, self._failed, work)
        )
