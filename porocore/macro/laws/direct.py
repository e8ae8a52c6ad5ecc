"""Direct FE²: a cell law that solves the cell at every quadrature point (DirectCellLaw), and its work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from porocore.core.files.totals import Numbers
from porocore.interfaces.cell import CellField
from porocore.interfaces.law import CellLaw, UndeformedCells
from porocore.interfaces.records import failed_response
from porocore.macro.laws.direct_record import Work
from porocore.sampling.execution import CellPool
from porocore.states import Array, CellResponse, IntArray, MacroState, Status

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
    equilibrium keep their values and are flagged as ``outside_training_range``.

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
            response, outside_training_range=unstable, tangent=response.tangent if tangent else None
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
    tangent = response.tangent
    assert tangent is not None
    H = states.grad_u - solved[:, :9].reshape(-1, 3, 3)
    p = states.p - solved[:, 9]

    def moved(value: Array | None, by_H: Array | None, by_p: Array | None) -> Array | None:
        if value is None or by_H is None or by_p is None:
            return value
        change: Array = np.einsum("n...kl,nkl->n...", by_H, H) + np.einsum("n...,n->n...", by_p, p)
        return value + change

    fluid = response.fluid_volume
    mean_grad = moved(response.mean_grad, tangent.mean_grad_grad_u, tangent.mean_grad_p)
    assert mean_grad is not None
    return replace(
        response,
        mean_grad=mean_grad,
        potential=moved(response.potential, response.stress, None if fluid is None else -fluid),
        stress=moved(response.stress, tangent.stress_grad_u, tangent.stress_p),
        fluid_volume=moved(fluid, tangent.fluid_volume_grad_u, tangent.fluid_volume_p),
    )


def _lean(response: CellResponse) -> CellResponse:
    return replace(response, slopes=None, extrema=None, outside_training_range=None)
