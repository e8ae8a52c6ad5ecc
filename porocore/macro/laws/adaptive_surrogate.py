"""Surrogate refitted to cells solved where a macro run leaves the sampled range (AdaptiveSurrogate)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from porocore.core.files.totals import Numbers
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.macro.laws.direct_record import Work
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.samplers.candidates import distances
from porocore.states import Array, CellResponse, MacroState, Status

#: States outside that are solved at a time, the farthest apart.
BATCH = 4
#: How much farther out than they lie a second state is solved, by the distance to what is known; and the least of
#: these distances, as a share of the inputs' ranges. So a path that leaves the range is not followed inch by inch.
AHEAD, LEAST = 1.0, 0.04
#: So close to a known cell, by the same measure and within the ranges, another would tell nothing new: what is flagged
#: there is what the surrogate cannot follow.
CLOSE = 0.02
#: So close to a cell that was not stable, by the same measure, none is solved any more.
HOPELESS = 0.15


@dataclass
class AdaptiveSurrogateWork(Work):
    """Work of an adaptive surrogate.

    Attributes
    ----------
    reused
        Cells that an earlier process had solved.
    refits
        How often the surrogate was fitted again.
    solve_seconds, fit_seconds
        Spent in the solves (added up over the processes) and in the fits [s].
    """

    reused: int = 0
    refits: int = 0
    solve_seconds: float = 0.0
    fit_seconds: float = 0.0

    @property
    def learned(self) -> int:
        """Number of solved cells that were learned from."""
        return sum(n for status, n in self.counts.items() if status.stable)

    def in_words(self) -> str:
        """Return the work in a sentence."""
        return (
            f"{self.solves} cells outside the sampled range solved ({self.failed} without solution, "
            f"{self.learned} learned from), {self.reused} known from before, {self.refits} fits"
        )

    def numbers(self) -> Numbers:
        """Return the counts and seconds of this process."""
        names = ("solves", "failed", "learned", "refits", "solve_seconds", "fit_seconds")
        return {name: getattr(self, name) for name in names}


class AdaptiveSurrogate:
    """Surrogate that is refitted to cells solved where a macro run leaves its training range.

    It is a :class:`~porocore.macro.laws.macro_law.SurrogateRefinement`.

    Parameters
    ----------
    pool
        Solves cells with tangents.
    dataset
        Takes in what is solved; its states are learned from at once.
    base
        What the surrogate was trained on.
    make
        A fresh surrogate of the same settings.
    seed
        Of its training.
    objective
        Whether the surrogate does not change when a state is turned, so that a turned one may be solved instead.
    on_work
        Called after every solve and fit.
    """

    def __init__(
        self,
        pool: CellPool,
        dataset: Dataset,
        base: TrainingSet,
        make: Callable[[], Surrogate],
        seed: int,
        objective: bool = False,
        on_work: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.pool, self.dataset, self.base, self.make, self.seed = pool, dataset, base, make, seed
        self.objective, self.on_work = objective, on_work
        self.work = AdaptiveSurrogateWork(reused=len(dataset))
        self._asked: dict[str, tuple[float, ...]] = {}

    def known(self, surrogate: Surrogate) -> Surrogate:
        """Return the surrogate, fitted again if the dataset holds states already."""
        return self.fitted() if len(self.dataset) else surrogate

    def __call__(self, states: MacroState) -> Surrogate | None:
        """Solve cells at some of the states outside and beyond them, and fit again.

        None where no component that was sampled takes them outside, or where no cell there has a stable equilibrium.
        """
        inputs = self.base.inputs
        if self.objective:
            states = inputs.without_rotation(states)
        states = states[np.flatnonzero(~inputs.moves_other(states))]
        if not len(states):
            return None
        wanted = self._chosen(inputs.gather(states))
        before = self._learned()
        for x in wanted:
            self._submit(x)
        while self.pool.pending:
            self._take()
        return self.fitted() if self._learned() > before else None

    def fitted(self) -> Surrogate:
        """Return a surrogate fitted to all known states."""
        began = time.perf_counter()
        data = self._training_set()
        surrogate = self.make().fit(data, seed=self.seed)
        self.work.refits += 1
        self.work.fit_seconds += time.perf_counter() - began
        self.on_work(f"fitted again to {len(data.states)} states")
        return surrogate

    def _chosen(self, x: Array) -> list[Array]:
        """Return inputs (d,) of the cells to solve: :data:`BATCH` of ``x`` (n, d), and as many beyond them.

        None close to one that was not stable, nor within the ranges close to one that is known: the next step would ask
        for it again, and so on.
        """
        inputs = self.base.inputs
        own = len(inputs) - len(inputs.parameters)
        low, span = np.array(inputs.lower), np.array(inputs.upper) - np.array(inputs.lower)
        here, solved = inputs.to_unit(x), inputs.to_unit(self.dataset.x())
        known = np.concatenate([inputs.to_unit(inputs.gather(self.base.states)), solved])
        within = ((here >= 0) & (here <= 1)).all(axis=1)
        here = here[~within | (distances(here, known)[0] > CLOSE)]
        useless = solved[~self.dataset.responses().stable] if len(solved) else solved
        if len(useless) and len(here):
            here = here[distances(here, useless)[0] > HOPELESS]
        chosen: list[Array] = []
        for _ in range(min(BATCH, len(here))):
            distance, nearest = distances(here, known)
            k = int(np.argmax(distance))
            if distance[k] < 1e-6:
                break
            way = here[k] - known[nearest[k]]
            beyond = here[k] + max(AHEAD, LEAST / distance[k]) * way
            # No cell has parameters outside their ranges.
            beyond[own:] = beyond[own:].clip(0, 1)
            chosen += [here[k], beyond]
            known = np.concatenate([known, [here[k], beyond]])
        return [low + span * point for point in chosen]

    def _submit(self, x: Array) -> None:
        while not self.pool.has_room:
            self._take()
        key = "fallback " + " ".join(float(value).hex() for value in x)
        if key not in self.dataset:
            self._asked[key] = tuple(map(float, x))
            self.pool.submit(key, self.base.inputs.scatter(x))

    def _take(self) -> None:
        outcome = self.pool.wait()
        self.dataset.append(outcome.record(self.dataset.inputs, self._asked.pop(outcome.key)))
        status = Status(int(outcome.response.status[0]))
        self.work.counts[status] += 1
        self.work.solve_seconds += outcome.seconds
        self.on_work(f"{self.work.solves} cells outside the sampled range solved")

    def _learned(self) -> int:
        return int(self.dataset.responses().stable.sum()) if len(self.dataset) else 0

    def _training_set(self) -> TrainingSet:
        if not len(self.dataset):
            return self.base
        responses = self.dataset.responses()
        good = np.flatnonzero(responses.stable)
        return replace(
            self.base,
            states=MacroState.concatenate([self.base.states, self.dataset.states()[good]]),
            responses=CellResponse.concatenate([self.base.responses, responses[good]]),
        )
