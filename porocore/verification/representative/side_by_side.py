"""Sub-volumes solved in parallel processes, no more of them than the memory allows."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait

from porocore.core.files.store import ResultStore
from porocore.errors import PluginError
from porocore.sampling.execution.processes import ProcessBackend
from porocore.sampling.execution.worker_backend import Worker
from porocore.study.config.sections import FemSettings
from porocore.verification.representative.subvolume import LOST, Subvolume, SubvolumeJob, solve_subvolume

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
