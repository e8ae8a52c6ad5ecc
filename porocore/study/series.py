"""Series of runs (RunSeries): cases solved side by side, each recorded as it ends; interrupted ones go on."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, wait
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from porocore.core.console import Console, Task, duration
from porocore.core.files.atomic import new_folder
from porocore.core.parallel.calls import Call, CallProcesses, ProcessEnded, Tell
from porocore.errors import DataError, RunFolderError

T = TypeVar("T")
Setup = tuple[Callable[..., tuple[Any, ...]], tuple[Any, ...]]
#: Seconds between two looks at processes and interrupts while nothing ends.
PATIENCE = 0.2
#: Times that a case is tried whose process ends.
TRIES = 2


@dataclass(frozen=True, eq=False)
class Case:
    """One run of a series.

    Attributes
    ----------
    key
        Its name in the record.
    arguments
        Arguments of the function that solves it, behind ``tell`` and what the series has set up.
    words
        The case in a message: ``while it solved …``.
    size
        Number of units of the series in it, such as states.
    work
        Expected time, in a unit that all cases share.
    side_by_side
        Number of cases that the memory allows at a time while this one runs.
    """

    key: str
    arguments: tuple[Any, ...]
    words: str
    size: int = 1
    work: float = 1.0
    side_by_side: int = 2**31


@dataclass(frozen=True)
class CaseProgress:
    """Progress of one case, which its function reports: a text, and the share that is done.

    ``words`` may be anything; it becomes a text where the series is shown, in the units of the study.
    """

    words: object
    share: float


@dataclass(frozen=True)
class FromStore:
    """Units of a series that came from the store that studies share, and the seconds that this saved."""

    count: int
    seconds: float


class RunSeries(ABC, Generic[T]):
    """Cases of one kind, their record and the function that solves one.

    Cases that the record holds are not solved again. The others are solved in processes, or one after another in this
    one, and recorded in the order in which they end, on which no result depends. Where the process of a case ends
    without a message, the case is tried once more in another.

    Attributes
    ----------
    title, unit
        Name of the series and of its units where its progress is shown.
    function
        Function at the top level of a module: ``function(tell, *made, *arguments)`` returns the result of a case.
        ``tell`` takes a :class:`CaseProgress` or a :class:`FromStore`.
    known
        Results of the record by the keys of their cases.
    setup
        Function and arguments of what each process makes once for all of its cases (``made``); None: nothing.
    """

    title: ClassVar[str]
    unit: ClassVar[str]
    function: ClassVar[Callable[..., Any]]

    def __init__(self, known: dict[str, T], setup: Setup | None = None) -> None:
        self.known, self.setup = known, setup

    @abstractmethod
    def save(self, case: Case, result: T) -> None:
        """Write the record with a result that has come, before the next one is waited for."""

    def find(self, case: Case) -> T | None:
        """Return the result of a case from the record, or None where it is not finished."""
        return self.known.get(case.key)

    def stored(self, case: Case) -> tuple[T, float] | None:
        """Return the result of a case from the store and the seconds that it had taken; None where it has none."""
        return None

    def lost(self, case: Case, error: Exception) -> T:
        """Return the result of a case that raised an error; by default the error ends the series."""
        raise error

    def failed(self, result: T) -> bool:
        """Return whether a result counts as failed in the progress."""
        return False

    def describe(self, case: Case, result: T) -> str:
        """Return a result in words for the progress."""
        return case.words

    def run(self, cases: Sequence[Case], console: Console, workers: int = 1) -> list[T]:
        """Solve the cases that are not finished, and return the results of all, in their order.

        Parameters
        ----------
        cases
            Cases with keys that differ, those first that are to be solved first.
        console
            Display of the progress.
        workers
            Number of processes; with one, or one case to solve, this process solves them.

        Raises
        ------
        PorocoreError
            A case raised it, and :meth:`lost` did not take it.
        """
        results = {case.key: known for case in cases if (known := self.find(case)) is not None}
        if results:
            count, whole = sum(case.size for case in cases if case.key in results), sum(c.size for c in cases)
            console.note(f"{self.title}: {count} of {whole} {self.unit} are there already")
        left = [case for case in cases if case.key not in results]
        if left:
            with console.task(self.title, self.unit) as task:
                shown = _Progress(task, cases)
                for case in cases:
                    if case.key in results:
                        shown.ended(case, self.failed(results[case.key]))
                try:
                    with closing(self._results(left, workers, shown)) as found:
                        for case, result in found:
                            results[case.key] = self.known[case.key] = result
                            self.save(case, result)
                            shown.ended(case, self.failed(result), self.describe(case, result))
                finally:
                    shown.tell_store(console)
        return [results[case.key] for case in cases]

    def _results(
        self, cases: Sequence[Case], workers: int, shown: _Progress
    ) -> Generator[tuple[Case, T], None, None]:
        """Yield cases with their results: those of the store, then the others as they end."""
        left = []
        for case in cases:
            if found := self.stored(case):
                shown.take(case, FromStore(case.size, found[1]))
                yield case, found[0]
            else:
                left.append(case)
        if min(workers, len(left)) > 1:
            yield from self._in_processes(left, min(workers, len(left)), shown)
            return
        made: tuple[Any, ...] | None = None
        for case in left:
            try:
                made = _made(self.setup) if made is None else made
                result = type(self).function(partial(shown.take, case), *made, *case.arguments)
            except Exception as error:  # noqa: BLE001 - one case does not end the others
                result = self.lost(case, error)
            yield case, result

    def _in_processes(
        self, cases: Sequence[Case], workers: int, shown: _Progress
    ) -> Generator[tuple[Case, T], None, None]:
        waiting, tries = deque(cases), Counter[str]()
        running: dict[str, tuple[Case, CallProcesses, Call]] = {}
        with ExitStack() as stack:
            # One call at a time for each, so that one that ends is blamed for its case alone.
            idle = [stack.enter_context(CallProcesses(1)) for _ in range(workers)]
            while waiting or running:
                while waiting and idle and len(running) < max(1, waiting[0].side_by_side):
                    case, process = waiting[0], idle.pop()
                    what = f"while it solved {case.words}"
                    try:
                        call = process.submit(what, _solve, type(self).function, self.setup, case.arguments)
                    except BrokenExecutor:  # it ended while it had nothing to do
                        idle.append(stack.enter_context(CallProcesses(1)))
                        continue
                    running[waiting.popleft().key] = case, process, call
                wait([call.future for _, _, call in running.values()], PATIENCE, FIRST_COMPLETED)
                for case, process, call in list(running.values()):
                    if not call.future.done():
                        for told in call.told():
                            shown.take(case, told)
                        continue
                    del running[case.key]
                    try:
                        for told in call.reports():
                            shown.take(case, told)
                        result = call.result()
                    except ProcessEnded as error:
                        process = stack.enter_context(CallProcesses(1))
                        tries[case.key] += 1
                        if tries[case.key] < TRIES:
                            idle.append(process)
                            waiting.appendleft(case)
                            continue
                        result = self.lost(case, error)
                    except Exception as error:  # noqa: BLE001 - as above
                        result = self.lost(case, error)
                    idle.append(process)
                    yield case, result


class _Progress:
    """Progress of a series: its units and the time that is left, of cases that run and of those that ended."""

    def __init__(self, task: Task, cases: Sequence[Case]) -> None:
        self._task = task
        self._size, self._work = sum(case.size for case in cases), sum(case.work for case in cases)
        self._shares: dict[str, tuple[Case, float]] = {}
        self._failed, self._store = 0, FromStore(0, 0.0)

    def take(self, case: Case, told: CaseProgress | FromStore) -> None:
        """Show what a case reports while it runs."""
        if isinstance(told, FromStore):
            self._store = FromStore(self._store.count + told.count, self._store.seconds + told.seconds)
        else:
            self._show(case, told.share, f"{case.words}: {told.words}")

    def ended(self, case: Case, failed: bool, words: str = "") -> None:
        """Show that a case has ended."""
        self._failed += failed
        self._show(case, 1.0, words)

    def tell_store(self, console: Console) -> None:
        """Tell what came from the store."""
        if count := self._store.count:
            what = self._task.unit if count > 1 else self._task.unit.removesuffix("s")
            saved = duration(self._store.seconds)
            console.note(f"{self._task.title}: {count} {what} came from the store, which saved about {saved}")

    def _show(self, case: Case, share: float, words: str) -> None:
        self._shares[case.key] = case, share
        done = sum(int(case.size * share + 1e-9) for case, share in self._shares.values())
        work = sum(case.work * share for case, share in self._shares.values())
        detail = words if done < self._size else ""
        self._task.update(
            done, self._size, failed=self._failed, detail=detail, work=(work, self._work - work)
        )


#: What this process has made for its cases; a process of a series works for no other.
_here: tuple[Any, ...] | None = None


def _made(setup: Setup | None) -> tuple[Any, ...]:
    return () if setup is None else setup[0](*setup[1])


def _solve(tell: Tell, function: Callable[..., T], setup: Setup | None, arguments: tuple[Any, ...]) -> T:
    global _here
    _here = _made(setup) if _here is None else _here
    return function(tell, *_here, *arguments)


def claim_record(path: Path, what: str, *, resume: bool) -> None:
    """Make the folder of the record of a series, which the user calls ``what``, before its cases are solved.

    Raises
    ------
    RunFolderError
        The record is there and ``resume`` is not set, or the folder cannot be written or belongs to a run.
    """
    if path.exists() and not resume:
        raise RunFolderError(
            f"{path.parent} already holds a {what}; add --resume to continue it, or choose another --out"
        )
    new_folder(path.parent)


def require_own(path: Path, found: str, identity: str, what: str) -> None:
    """Refuse a record of other settings.

    Raises
    ------
    DataError
        The identity in the record is another one; ``what`` says what it holds then.
    """
    if found != identity:
        raise DataError(f"{path}: holds {what}; choose another --out, or move it elsewhere")
