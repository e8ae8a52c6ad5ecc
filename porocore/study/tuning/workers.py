"""Independent tasks in processes of one thread each."""

from __future__ import annotations

from collections.abc import Callable, Generator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, get_context
from typing import Any

from porocore.core.parallel.children import begin_child, require_children, starting_children
from porocore.errors import PorocoreError

#: Key, and a function at the top level of a module with its first arguments.
Task = tuple[str, tuple[Callable[..., Any], tuple[Any, ...]]]

_shared: tuple[Any, ...] = ()


def run_tasks(
    tasks: list[Task], shared: tuple[Any, ...], workers: int
) -> Generator[tuple[str, Any], None, None]:
    """Yield (key, result) of each task, called with its arguments followed by ``shared``, in the order of completion.

    With one worker, or one task, they run in this process. Workers ignore Ctrl-C and end when this generator is
    left or this process ends.

    Raises
    ------
    PorocoreError
        A worker died, or this process may not have workers; an exception of a task is raised as it is.
    """
    workers = min(workers, len(tasks))
    if workers <= 1:
        for key, (function, arguments) in tasks:
            yield key, function(*arguments, *shared)
        return
    require_children()
    others = set(active_children())
    executor = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_start, initargs=(shared,))
    try:
        with starting_children():  # a worker starts as its task is submitted
            futures = {
                executor.submit(_call, function, arguments): key for key, (function, arguments) in tasks
            }
        for future in as_completed(futures):
            yield futures[future], future.result()
    except BrokenProcessPool as error:
        raise PorocoreError(
            "a worker process ended without a message; if memory ran out, use fewer with --workers"
        ) from error
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
        for process in set(active_children()) - others:
            process.terminate()
            process.join()


def _start(shared: tuple[Any, ...]) -> None:
    global _shared
    _shared = shared
    begin_child()


def _call(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    return function(*arguments, *_shared)
