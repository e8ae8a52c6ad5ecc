"""Direct FE² (DirectCellLaw); surrogate refitted where a run leaves its range; cost of their cells."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from porocore.core.fields import provided
from porocore.core.files.store import Numbers, added_up, read_totals
from porocore.interfaces.cell import CellField
from porocore.interfaces.law import CellLaw, UndeformedCells
from porocore.interfaces.records import failed_response
from porocore.interfaces.surrogate import Surrogate, TrainingSet
from porocore.sampling.datasets.dataset import Dataset
from porocore.sampling.execution import CellPool
from porocore.sampling.samplers.candidates import distances
from porocore.states import Array, CellResponse, Doubt, IntArray, MacroState, Status


@dataclass
class Work(ABC):
    """Work done so far.

    Attributes
    ----------
    counts
        Cells solved, by how their solution ended.
    """

    counts: Counter[Status] = field(default_factory=Counter)

    @property
    def solves(self) -> int:
        """Number of cells solved."""
        return self.counts.total()

    @property
    def failed(self) -> int:
        """Number of solved cells without values."""
        return sum(n for status, n in self.counts.items() if not status.has_values)

    @abstractmethod
    def numbers(self) -> Numbers:
        """Return counts and seconds by name, for the record of a solution; none ever falls."""

    @abstractmethod
    def in_words(self) -> str:
        """Return the work in a sentence."""


class SolvesCells(Protocol):
    """Solver of cells during a macro run.

    Attributes
    ----------
    on_work
        Called with what was done, in words.
    """

    on_work: Callable[[str], None]

    @property
    def work(self) -> Work:
        """Work since this process began."""


@contextmanager
def cost_recorded(path: Path, solution: str, work: Work) -> Iterator[None]:
    """Add to ``solution`` what ``work`` grows by during the block, also when the block is interrupted.

    Raises
    ------
    DataError
        The record at ``path`` is damaged; the block is not run.
    RunFolderError
        The disk is full or read-only.
    """
    before = work.numbers()

    def gained() -> Numbers:
        return {name: value - before.get(name, 0) for name, value in work.numbers().items()}

    with added_up(path, direct_records, solution, gained):
        yield


def direct_records(path: Path) -> dict[str, Numbers]:
    """Return points, solves, seconds and solves by status of each solution; empty before the first.

    Raises
    ------
    DataError
        The record is damaged.
    """
    return read_totals(path, "direct solves", _numbers)


def _numbers(record: Any) -> Numbers:
    for value in record.values():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise TypeError(f"expected a number, got {value!r}")
    return dict(record)


#: States that round to the same multiple of this are one: what differs by round-off is solved once. The way to
#: each of them is made up for by the exact tangent, which leaves an error of the order of the square.
GRID = 1e-10
#: Digits of a cell's averages below this share are left over from its Newton iteration.
NOISE = 1e-11
#: Components of H and p.
COMPONENTS = 10
#: No cell is asked for a displacement gradient or a pressure beyond this.
FARTHEST = 1e3


@dataclass
class DirectWork(Work):
    """Work of a direct law so far.

    Attributes
    ----------
    points
        Responses given to quadrature points.
    seconds
        Spent in the solves, added up over the processes [s].
    """

    points: int = 0
    seconds: float = 0.0

    def in_words(self) -> str:
        """Return the work in a sentence."""
        return (
            f"{self.solves} cells solved in this session ({self.failed} without solution), {self.seconds:.1f} s in all "
            f"processes together, for {self.points} responses"
        )

    def numbers(self) -> Numbers:
        """Return counts, seconds, and solves by status."""
        statuses = {status.name: self.counts[status] for status in Status if self.counts[status]}
        return {"points": self.points, "solves": self.solves, "seconds": self.seconds, **statuses}


@dataclass(frozen=True, eq=False)
class _Solved:
    """Response of one state, and its field unless the solve failed."""

    response: CellResponse
    field: CellField | None


class DirectCellLaw(CellLaw):
    """A cell law that solves the cell, in the processes of a pool.

    Points whose states agree to :data:`GRID` share one solve, which also has exact zeros where round-off has none, so
    that an eighth of the cell will do. Each solve starts from the micro field of the
    point's last accepted state, so that an answer depends on the two states only: not on the iterations between
    them, nor on failed steps, the order of the points or the number of processes. Fields are found by state; after a
    restart the first solves begin at the undeformed cell.

    With parameters each point has the cell of its own; those that have the same share it, and the cell at rest is
    solved like others.

    A cell without solution gives NaN, so that the macro step is refused and halved. Cells in an unstable
    equilibrium keep their values and are flagged (``Doubt.unstable``).

    Parameters
    ----------
    pool
        Solves with tangents and fields.
    reference
        Response of the undeformed cell with its tangent (one row), which is not solved again.
    identity
        Hash of the cell and of its solver's settings.
    parameters
        Names of the cell's parameters; empty if it has none.
    at_rest
        Gives porosity and conductivity of the undeformed cells with parameters (n, m); needed where there are some.

    Attributes
    ----------
    work
        Counts and seconds.
    on_work
        Called after every solve, with where the present iteration is.
    """

    noise = NOISE

    def __init__(
        self,
        pool: CellPool,
        reference: CellResponse,
        identity: str,
        parameters: tuple[str, ...] = (),
        at_rest: Callable[[Array], UndeformedCells] | None = None,
    ) -> None:
        self.pool, self.identity = pool, f"direct-{identity}"
        self.parameters, self._at_rest = parameters, at_rest
        self.work = DirectWork()
        self.on_work: Callable[[str], None] = lambda text: None
        self._rest = _Solved(_lean(reference), None)
        self._known: dict[bytes, _Solved] = {}
        self._accepted: set[bytes] = set()

    def predict(self, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses of n states, reached from the undeformed cell."""
        before = MacroState.zeros(len(states)).with_parameters(states.parameters)
        return self.predict_from(before, states, tangent=tangent)

    def predict_from(self, before: MacroState, states: MacroState, *, tangent: bool = True) -> CellResponse:
        """Return the responses of n points whose last accepted states were ``before``.

        Raises
        ------
        PorocoreError
            The cell solver raised an exception, or a worker process died.
        """
        places, inverse = np.unique(_place(states), axis=0, return_inverse=True)
        inverse = inverse.reshape(-1)
        first = np.zeros(len(places), dtype=np.int64)
        first[inverse[::-1]] = np.arange(len(states))[::-1]
        starts = [place.tobytes() for place in _place(before[first])]
        accepted = {place.tobytes() for place in np.unique(_place(before), axis=0)}
        # Earlier iterations and failed steps can no longer be a start; a next step begins where the last call ended.
        # Those of this iteration may be, where only the tangent is asked for.
        same, self._accepted = accepted == self._accepted, accepted
        wanted = {place.tobytes(): (place, start) for place, start in zip(places, starts, strict=True)}
        kept = accepted | wanted.keys() if same else accepted
        self._known = {key: solved for key, solved in self._known.items() if key in kept}
        answers = self._answers(wanted)
        self._known |= answers
        self.work.points += len(states)
        response = CellResponse.concatenate([answers[key].response for key in wanted])[inverse]
        response = _moved(response, states, places[inverse, :COMPONENTS] * GRID)
        unstable = response.status == int(Status.unstable)
        return replace(
            response, doubt=Doubt.where(unstable=unstable), tangent=response.tangent if tangent else None
        )

    def undeformed(self, parameters: Array) -> UndeformedCells | None:
        """Return porosity and conductivity of the undeformed cells with ``parameters`` (n, m)."""
        return None if self._at_rest is None else self._at_rest(parameters)

    def _answers(self, wanted: dict[bytes, tuple[IntArray, bytes]]) -> dict[bytes, _Solved]:
        """Return the responses in the order of ``wanted``; known ones are not solved again."""
        found: dict[bytes, _Solved] = {}
        ahead: list[tuple[bytes, IntArray, bytes]] = []
        for key, (place, start) in wanted.items():
            if key in self._known:
                found[key] = self._known[key]
            elif len(place) == COMPONENTS and not place.any():
                found[key] = self._rest
            elif np.abs(place[:COMPONENTS]).max() > FARTHEST / GRID:
                found[key] = _Solved(failed_response(Status.inverted, like=self._rest.response), None)
            else:
                ahead.append((key, place, start))
        self._solve(ahead, found)
        return {key: found[key] for key in wanted}

    def _solve(self, ahead: list[tuple[bytes, IntArray, bytes]], found: dict[bytes, _Solved]) -> None:
        # Members one after the other: a worker keeps a few of them.
        ahead = sorted(ahead, key=lambda each: each[1][COMPONENTS:].tobytes())
        total, queue = len(ahead), ahead[::-1]
        for done in range(total):
            while queue and self.pool.has_room:
                key, place, start = queue.pop()
                field = self._known[start].field if start in self._known else None
                self.pool.submit(key.hex(), _state(place), field)
            outcome = self.pool.wait()
            found[bytes.fromhex(outcome.key)] = _Solved(_lean(outcome.response), outcome.field)
            self.work.counts[Status(int(outcome.response.status[0]))] += 1
            self.work.seconds += outcome.seconds
            self.on_work(f"cell {done + 1} of {total} of this iteration")


def _place(states: MacroState) -> IntArray:
    """Return the states as multiples of the grid (n, 10), clipped to a place beyond :data:`FARTHEST`.

    The bits of the parameters follow in further columns: they take no error, so that a cell is the one of its numbers.
    """
    values = np.concatenate([states.grad_u.reshape(-1, 9), states.p[:, None]], axis=1)
    beyond = 2 * FARTHEST
    inside = np.clip(np.nan_to_num(values, nan=beyond, posinf=beyond, neginf=-beyond), -beyond, beyond)
    place: IntArray = np.rint(inside / GRID).astype(np.int64)
    if states.parameters is None:
        return place
    bits = np.ascontiguousarray(states.parameters, dtype=np.float64).view(np.int64)
    return np.concatenate([place, bits], axis=1)


def _state(place: IntArray) -> MacroState:
    values: Array = place[:COMPONENTS] * GRID
    theta = place[COMPONENTS:].view(np.float64)
    return MacroState(values[:9].reshape(1, 3, 3), values[9:], theta.reshape(1, -1) if len(theta) else None)


def _moved(response: CellResponse, states: MacroState, solved: Array) -> CellResponse:
    """Return the response moved from the ``solved`` states (n, 10) to ``states``, to first order."""
    tangent = provided(response.tangent)
    H = states.grad_u - solved[:, :9].reshape(-1, 3, 3)
    p = states.p - solved[:, 9]

    def moved(value: Array | None, by_H: Array | None, by_p: Array | None) -> Array | None:
        if value is None or by_H is None or by_p is None:
            return value
        change: Array = np.einsum("n...kl,nkl->n...", by_H, H) + np.einsum("n...,n->n...", by_p, p)
        return value + change

    fluid = response.fluid_volume
    return replace(
        response,
        mean_grad=provided(moved(response.mean_grad, tangent.mean_grad_grad_u, tangent.mean_grad_p)),
        potential=moved(response.potential, response.stress, None if fluid is None else -fluid),
        stress=moved(response.stress, tangent.stress_grad_u, tangent.stress_p),
        fluid_volume=moved(fluid, tangent.fluid_volume_grad_u, tangent.fluid_volume_p),
    )


def _lean(response: CellResponse) -> CellResponse:
    return replace(response, slopes=None, extrema=None, doubt=None)


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
