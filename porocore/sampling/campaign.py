"""Loop of a sampling: a sampler asks for states, a pool solves them from near ones, a dataset keeps them."""

from __future__ import annotations

import math
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from porocore.errors import DataError, PluginError
from porocore.interfaces.cell import CellField
from porocore.interfaces.sampler import Request, Sampler
from porocore.plugins.border import CheckedSampler
from porocore.plugins.foreign_code import origin_of
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool, FinishedSolve
from porocore.sampling.execution.interrupts import GRACE, finishing
from porocore.sampling.forecast import Guess, StateForecast
from porocore.states import BoolArray, CellResponse, MacroState, Status

#: First words of a start that lies in the data set of the samples, before its key.
OF_SAMPLES = "samples: "
#: A sample is a start where its distance is at most this share of that of the undeformed cell. With two inputs most
#: held-out states have one, and those in contact take half the time; with seven one that is as far saved nothing.
NEAR = 0.5
#: Share of the wall in contact below which no state starts from a sample in contact: where walls begin to touch there
#: may be two equilibria, and which one is reached depends on the path. One of 120 held-out states of the benchmark has
#: two.
ONSET = 0.02


class WarmStarts:
    """Stable states of a data set that is complete, so that the start of a state hangs on nothing but these.

    Parameters
    ----------
    samples
        Data set that is not written any more.
    modulus
        Young's modulus of the solid, by which pressures are measured like displacement gradients.
    """

    def __init__(self, samples: Dataset, modulus: float) -> None:
        self._samples, self._modulus = samples, modulus
        stable = samples.responses().stable
        self._keys = [key for key, good in zip(samples.keys, stable, strict=True) if good]
        self._states = samples.states()[np.flatnonzero(stable)]
        self._sheared = _sheared(self._states)
        self._begins = _begins_to_touch(samples.responses()[np.flatnonzero(stable)])

    def near(self, state: MacroState) -> tuple[str, CellField] | None:
        """Return the name and the field of the nearest state; None where the undeformed cell is as good.

        The distance is that of the load path: of the components of H, and of p over Young's modulus. A state without
        shear has another domain than one with shear, and one with other parameters is that of another cell.
        """
        if not self._keys:
            return None
        change = np.abs(self._states.grad_u - state.grad_u).max(axis=(1, 2))
        distance = np.maximum(change, np.abs(self._states.p - state.p) / self._modulus)
        distance[self._sheared != _sheared(state)] = np.inf
        if self._states.parameters is not None:
            distance[(self._states.parameters != state.parameters).any(axis=1)] = np.inf
        nearest = int(distance.argmin())
        at_rest = max(np.abs(state.grad_u).max(), np.abs(state.p).max() / self._modulus)
        if distance[nearest] > NEAR * at_rest or self._begins[nearest]:
            return None
        field = self._samples.field(self._keys[nearest])
        return None if field is None else (OF_SAMPLES + self._keys[nearest], field)


def _begins_to_touch(responses: CellResponse) -> BoolArray:
    touches: BoolArray = responses.status == Status.contact
    if responses.extrema is not None:
        touches &= responses.extrema.contact_share < ONSET
    return touches


def _sheared(states: MacroState) -> BoolArray:
    return np.asarray((np.abs(states.grad_u) * (1 - np.eye(3))).max(axis=(1, 2)) > 0)


#: Done after Ctrl-C before a campaign ends.
FINISHED_FIRST = f"states that end within {GRACE:g} s"
#: Done until the first state is solved; workers may have to start before.
STARTING = "at work on the first ones"
#: Decisions on a further round that took longer [s] are followed by a report of their own.
TOLD = 0.5
#: Where the dataset held every state.
COMPLETE = "complete"


@dataclass(frozen=True)
class CampaignProgress:
    """Progress of a running campaign."""

    #: States that are known, earlier runs included.
    done: int
    #: Estimate of all states.
    expected: int
    #: Known states without values.
    failed: int
    #: Seconds that are left, as they are estimated; None: nothing is known about them.
    seconds: float | None
    #: Interrupted: running solves are finished and kept; a second interrupt stops at once.
    stopping: bool = False
    #: What goes on while no state ends for some time.
    doing: str = ""


@dataclass(frozen=True)
class CampaignSummary:
    """Result of a campaign."""

    solved: int
    #: States taken from the dataset of an earlier run.
    reused: int
    #: Number of states by status, reused ones included.
    counts: dict[Status, int]
    #: Wall time of this run [s].
    seconds: float


def run_campaign(
    sampler: Sampler,
    pool: CellPool,
    dataset: Dataset,
    *,
    on_progress: Callable[[CampaignProgress], None] | None = None,
    guess: Guess | None = None,
    starts: WarmStarts | None = None,
) -> CampaignSummary:
    """Solve the states of ``sampler`` until it is done; each is kept before the sampler receives it.

    States that the dataset holds already are taken from there, so an interrupted campaign continues. A request names
    the state whose field it starts from, and that field comes from the dataset; so neither interruptions nor the number
    of workers change a result, if the solver's answer depends on nothing but the state and the start. A request without
    start takes the nearest of ``starts``, and begins anew at rest where that leads to no values. A state that
    workers died over or hung over twice is kept with the status ``lost``. Times are estimated from ``guess`` until
    they are measured.

    Raises
    ------
    PorocoreError
        The solver raised an exception, workers die whatever they are given, or their scheduler has gone. What ran
        beside it is finished and kept.
    RunFolderError
        Another process is writing the dataset, or the disk is full.
    KeyboardInterrupt
        After Ctrl-C. What ends within some seconds is kept; a second Ctrl-C does not wait.
    DataError
        The dataset holds a state of that key at other inputs.
    PluginError
        The sampler asks for nothing although it is not done.
    """
    with dataset.writing():
        if pool.losses.like is None and len(dataset):
            pool.losses.like = dataset.response(dataset.keys[0])
        campaign = _Campaign(sampler, pool, dataset, on_progress, guess, starts)
        with finishing(FINISHED_FIRST) as interrupt:
            try:
                campaign.run(interrupt)
            except Exception:
                campaign.finish_running()
                raise
            if interrupt.is_set():
                campaign.finish_running(GRACE)
                raise KeyboardInterrupt
        dataset.consolidate()
    return campaign.summary()


def is_complete(sampler: Sampler, dataset: Dataset) -> bool:
    """Return whether ``dataset`` holds every state that a fresh ``sampler`` asks for."""
    asked = CheckedSampler(sampler, dataset.inputs)
    while requests := asked.ask():
        for request in requests:
            if request.key not in dataset:
                return False
            asked.tell(request.key, dataset.response(request.key))
    return asked.done


class _Campaign:
    def __init__(
        self,
        sampler: Sampler,
        pool: CellPool,
        dataset: Dataset,
        on_progress: Callable[[CampaignProgress], None] | None,
        guess: Guess | None,
        starts: WarmStarts | None,
    ) -> None:
        self.sampler = CheckedSampler(sampler, dataset.inputs)
        self.pool, self.dataset, self.on_progress = pool, dataset, on_progress
        self.began = time.perf_counter()
        self.queue: deque[Request] = deque()
        self.running: dict[str, Request] = {}
        self.starts = starts
        #: Names of the starts of running states that did not name one, and keys of those that begin at rest.
        self.warm: dict[str, str] = {}
        self.cold: set[str] = set()
        self.counts: Counter[Status] = Counter()
        self.solved = self.reused = 0
        self.forecast = StateForecast(dataset.inputs, guess or Guess(workers=pool.workers))
        #: States known at the last report, and what went on.
        self.reported = (0, "")
        #: A state was solved, not taken from a store.
        self.measured = False

    def run(self, interrupt: threading.Event) -> None:
        self.report()
        self.ask()
        while self.queue or self.running:
            while self.queue and self.pool.has_room and not interrupt.is_set():
                self.submit(self.queue.popleft())
            if interrupt.is_set():
                self.report(stopping=True)
                return
            if not self.measured:
                self.report(doing=STARTING)
            outcome = self.pool.wait_unless(interrupt.is_set)
            if outcome is None:
                continue
            if self.in_vain(outcome):
                continue
            self.measured |= not outcome.stored
            seconds = None if outcome.stored else outcome.seconds
            self.tell(self.keep(outcome), outcome.response, seconds)
            self.report(stopping=interrupt.is_set())
            self.ask()
        if self.reported != (self.counts.total(), ""):
            self.report(doing="" if self.solved else COMPLETE)
        if not self.sampler.done:
            raise PluginError(
                f"{origin_of(self.sampler.sampler)} asks for no more states, but says that it is not done; report this "
                "to its authors"
            )

    def ask(self) -> None:
        while requests := self.decide():
            for request in requests:
                if request.key not in self.dataset:
                    self.queue.append(request)
                    continue
                known = self.dataset.inputs_of(request.key)
                if known != request.x:
                    raise DataError(
                        f"{self.dataset.path}: holds state '{request.key}' at {known}, but {request.x} is "
                        "asked for: it was sampled with other settings; choose another --out"
                    )
                self.reused += 1
                self.tell(request, self.dataset.response(request.key))

    def decide(self) -> list[Request]:
        ready = bool(self.counts) and not self.queue and not self.running
        if ready and not self.sampler.done:
            self.report(doing=self.sampler.choosing)
        began = time.perf_counter()
        requests = self.sampler.ask()
        if ready:
            seconds = time.perf_counter() - began
            self.forecast.decided(seconds)
            if seconds > TOLD:
                self.report()
        return requests

    def submit(self, request: Request) -> None:
        if request.start is not None and request.start not in self.dataset:
            raise PluginError(
                f"{origin_of(self.sampler.sampler)} asks for state '{request.key}' to start from '{request.start}', "
                "which is not solved; report this to its authors"
            )
        state = self.dataset.inputs.scatter(request.x)
        start = None if request.start is None else self.dataset.field(request.start)
        elsewhere = None if request.start or request.key in self.cold else self.starts
        if elsewhere is not None and (found := elsewhere.near(state)):
            self.warm[request.key], start = found
        self.running[request.key] = request
        self.pool.submit(request.key, state, start)

    def in_vain(self, outcome: FinishedSolve) -> bool:
        """Return whether a warm start has led to no values; the state is then solved from rest."""
        status = Status(int(outcome.response.status[0]))
        if outcome.key not in self.warm or status.has_values or status is Status.lost:
            return False
        del self.warm[outcome.key]
        self.cold.add(outcome.key)
        self.queue.appendleft(self.running.pop(outcome.key))
        return True

    def keep(self, outcome: FinishedSolve) -> Request:
        request = self.running.pop(outcome.key)
        start = self.warm.pop(outcome.key, request.start)
        self.dataset.append(outcome.record(self.dataset.inputs, request.x, start))
        self.solved += 1
        return request

    def tell(self, request: Request, response: CellResponse, seconds: float | None = None) -> None:
        self.counts[Status(int(response.status[0]))] += 1
        self.sampler.tell(request.key, response)
        now, outward = time.perf_counter() - self.began, request.start is not None
        self.forecast.add(request.x, self.sampler.expected, outward=outward, seconds=seconds, now=now)

    def finish_running(self, within: float = math.inf) -> None:
        for outcome in self.pool.finish_running(time.monotonic() + within):
            if not self.in_vain(outcome):
                self.keep(outcome)

    def report(self, *, stopping: bool = False, doing: str = "") -> None:
        if self.on_progress is None:
            return
        done = self.counts.total()
        expected, self.reported = max(self.sampler.expected, done), (done, doing)
        self.forecast.look(self.sampler.outlook)
        failed = sum(n for status, n in self.counts.items() if not status.has_values)
        self.on_progress(CampaignProgress(done, expected, failed, self.forecast.seconds(), stopping, doing))

    def summary(self) -> CampaignSummary:
        counts = {status: self.counts[status] for status in Status if self.counts[status]}
        return CampaignSummary(self.solved, self.reused, counts, time.perf_counter() - self.began)
