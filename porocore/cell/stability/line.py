"""One line of a stability map: states solved one after another, onsets of events by bisection."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeVar

import numpy as np

from porocore.cell.equilibrium.discrete import FactorError
from porocore.cell.equilibrium.solver import PreparedCell
from porocore.cell.stability.modes import WAVES, acoustic_minimum, lowest_eigenvalues, negative_pivots
from porocore.core.echo import echo
from porocore.core.models.bounds import MOST_POINTS, SMALLEST_INTERVAL
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import CellField, CellSolver
from porocore.plugins.border import solution_of
from porocore.states import Array, CellResponse, IntArray, MacroState, Status

#: Events of a line: contact of the wall with a mirror plane, a mode of a wave vector, loss of rank-one convexity.
EVENTS = ("crease", *WAVES, "acoustic")


@dataclass(frozen=True)
class LineSettings:
    """Steps of a line and accuracy of its onsets.

    Attributes
    ----------
    steps
        Equal steps from start to goal.
    tolerance
        Width to which the interval of an onset is bisected, in the component of (H, p) that changes most.
    eigenvalues
        Compute the lowest eigenvalue of every wave vector at every state.
    """

    steps: int = 12
    tolerance: float = 0.005
    eigenvalues: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.steps <= MOST_POINTS:
            raise ConfigurationError(f"steps: expected 1 to {MOST_POINTS}, got {echo(self.steps)}")
        if not SMALLEST_INTERVAL <= self.tolerance < math.inf:
            raise ConfigurationError(
                f"tolerance: expected at least {SMALLEST_INTERVAL:g}, got {self.tolerance:g}"
            )


@dataclass(frozen=True, eq=False)
class StabilityLine:
    """n states along a line, of which the last may have failed, and the onsets of the events.

    Attributes
    ----------
    start, goal : (10,)
        H row by row, then p.
    share : (n,)
        Share of the way from start to goal.
    status, contact_share, min_gap : (n,)
        See :class:`~porocore.states.CellExtrema`.
    stress : (n, 3, 3)
        Total stress P_E.
    pivots : (n, 8)
        Number of negative pivots for each of :data:`WAVES`; −1 where unknown.
    eigenvalues : (n, 8)
        Lowest eigenvalue for each of :data:`WAVES`; NaN where not computed.
    acoustic : (n,)
        Smallest eigenvalue of the acoustic tensor [E].
    direction : (n, 3)
        Normal of that eigenvalue.
    onsets : (events, 2)
        Interval of ``share`` in which each of :data:`EVENTS` begins; NaN for none, 0 and 0 if present at the start.
    """

    start: Array
    goal: Array
    share: Array
    status: IntArray
    contact_share: Array
    min_gap: Array
    stress: Array
    pivots: IntArray
    eigenvalues: Array
    acoustic: Array
    direction: Array
    onsets: Array

    def __len__(self) -> int:
        return len(self.share)

    def states(self) -> Array:
        """Return the states (n, 10), H row by row, then p."""
        return self.start + self.share[:, None] * (self.goal - self.start)

    def onset(self, *events: str) -> Array:
        """Return the state (10,) in the middle of the first onset interval of some events; NaN if none begins."""
        middles = [self.onsets[EVENTS.index(event)].mean() for event in events]
        if np.isnan(middles).all():
            return np.full(10, np.nan)
        return np.asarray(self.start + np.nanmin(middles) * (self.goal - self.start))


@dataclass(frozen=True, eq=False)
class _State:
    share: float
    status: int
    contact_share: float
    min_gap: float
    stress: Array
    pivots: dict[str, int]
    eigenvalues: dict[str, float]
    acoustic: float
    direction: Array
    field: CellField | None

    def shows(self, event: str) -> bool:
        if event == "crease":
            return self.status == Status.overlap or self.contact_share > 0 or self.min_gap <= 0
        if event == "acoustic":
            return self.acoustic <= 0
        return self.pivots.get(event, 0) > 0


T = TypeVar("T")


def walk(
    values: Iterable[float],
    solve: Callable[[float, T | None], T],
    has_values: Callable[[T], bool],
    resolution: float,
    first: tuple[float, T] | None = None,
) -> Iterator[tuple[float, T]]:
    """Yield values with their states up to the end of what can be solved, and at most one state beyond it.

    Behind the first value that cannot be solved the interval between it and the last one that could is halved until it
    is not wider than the resolution.

    Parameters
    ----------
    values
        Values to be solved one after another.
    solve
        Returns the state at a value; takes the last state that could be solved, too.
    has_values
        Tells whether a state could be solved.
    first
        A value with its state that is known, not yielded.
    """
    last = first
    for value in values:
        state = solve(value, last and last[1])
        # The guard is for widths that are the resolution up to round-off.
        while last and not has_values(state) and abs(value - last[0]) > resolution * (1 + 1e-9):
            middle = (last[0] + value) / 2
            between = solve(middle, last[1])
            if has_values(between):
                last = middle, between
                yield last
            else:
                value, state = middle, between
        yield value, state
        if not has_values(state):
            return
        last = value, state


def follow_line(
    solver: CellSolver,
    prepared: PreparedCell,
    start: Array,
    goal: Array,
    settings: LineSettings,
    on_state: Callable[[str], None] = lambda text: None,
) -> StabilityLine:
    """Solve the states of a line one after another and bisect every onset.

    The line ends at the first state without values, within the tolerance of the last one with values. An onset lies
    between a state without the event and the next one with it; a state without values shows the crease only, by its
    status.

    Raises
    ------
    ConfigurationError
        H is not diagonal, or the configuration excludes the eighth.
    """
    _check_symmetric(prepared, start, goal)
    line = _LineSolver(solver, prepared, start, goal, settings, on_state)
    states = list(line.states())
    return StabilityLine(
        start=start,
        goal=goal,
        share=np.array([s.share for s in states]),
        status=np.array([s.status for s in states], dtype=np.int64),
        contact_share=np.array([s.contact_share for s in states]),
        min_gap=np.array([s.min_gap for s in states]),
        stress=np.array([s.stress for s in states]),
        pivots=np.array([[s.pivots.get(wave, -1) for wave in WAVES] for s in states], dtype=np.int64),
        eigenvalues=np.array([[s.eigenvalues.get(wave, np.nan) for wave in WAVES] for s in states]),
        acoustic=np.array([s.acoustic for s in states]),
        direction=np.array([s.direction for s in states]),
        onsets=line.onsets(states),
    )


def _check_symmetric(prepared: PreparedCell, start: Array, goal: Array) -> None:
    off = ~np.eye(3, dtype=bool)
    if any(np.abs(end[:9].reshape(3, 3)[off]).max() > 0 for end in (start, goal)):
        raise ConfigurationError(
            "stability is examined on the eighth of the cell, so H must be diagonal; expected only H11, H22, H33 and p"
        )
    if prepared.cell.geometry.unfolding == "whole":
        raise ConfigurationError(
            f"stability is examined on the eighth of a cell with mirrors, which {prepared.cell.geometry.description} "
            "does not have"
        )
    if not prepared.cell.solid.mirrored:
        raise ConfigurationError(
            "stability is examined on the eighth of a cell with mirrors, which the fibres of "
            f"{prepared.cell.solid.description} do not have; expected fibres along the axes"
        )
    if not prepared.cell.mirrored:
        raise ConfigurationError(
            "stability is examined on the eighth of the cell; expected cell.symmetry: auto and no cell.supercell, got "
            f"'{prepared.cell.symmetry}' and {list(prepared.cell.supercell)}"
        )


@dataclass(eq=False)
class _LineSolver:
    """Solver of the states of one line, each from the field of the one before."""

    solver: CellSolver
    prepared: PreparedCell
    start: Array
    goal: Array
    settings: LineSettings
    on_state: Callable[[str], None]
    _between: dict[float, _State] = field(default_factory=dict)

    @cached_property
    def resolution(self) -> float:
        return self.settings.tolerance / max(float(np.abs(self.goal - self.start).max()), 1e-300)

    def states(self) -> Iterator[_State]:
        """Yield the states from the start on, and at most one without values, within the tolerance of the last one."""
        shares = map(float, np.linspace(0.0, 1.0, self.settings.steps + 1))
        for _, state in walk(shares, self.examined, lambda state: state.field is not None, self.resolution):
            yield state

    def examined(self, share: float, last: _State | None) -> _State:
        state = self.solve(share, last.field if last else None, WAVES, eigenvalues=self.settings.eigenvalues)
        self.on_state(Status(state.status).name)
        return state

    def onsets(self, states: Sequence[_State]) -> Array:
        found = np.full((len(EVENTS), 2), np.nan)
        for i, event in enumerate(EVENTS):
            first = next((k for k, state in enumerate(states) if state.shows(event)), None)
            if first == 0:
                found[i] = 0.0
            elif first is not None:
                found[i] = self.bisect(states[first - 1], states[first], event)
        return found

    def bisect(self, low: _State, high: _State, event: str) -> tuple[float, float]:
        while high.share - low.share > self.resolution * (1 + 1e-9):
            share = (low.share + high.share) / 2
            middle = self._between.get(share)
            if middle is None or (event in WAVES and event not in middle.pivots):
                waves = (event,) if event in WAVES else ()
                middle = self.solve(share, low.field, waves)
                self._between[share] = middle
                self.on_state(f"onset of {event}")
            if middle.field is None and not middle.shows(event):
                break  # without a state the interval cannot be bisected further
            low, high = (low, middle) if middle.shows(event) else (middle, high)
        return low.share, high.share

    def solve(
        self, share: float, start: CellField | None, waves: Sequence[str], *, eigenvalues: bool = False
    ) -> _State:
        theta = self.start + share * (self.goal - self.start)
        state = MacroState.single(theta[:9], float(theta[9]))
        solution = solution_of(self.solver, self.prepared, state, start=[start], fields=True)
        response = solution.response
        reached = solution.fields[0] if solution.fields else None
        pivots: dict[str, int] = {}
        values: dict[str, float] = {}
        if reached is not None:
            solid = self.prepared.eighth
            iterate = solid.iterate_at(reached.grad_u, reached.p, reached.u)
            try:
                pivots = negative_pivots(solid, iterate, waves)
                values = lowest_eigenvalues(solid, iterate, waves) if eigenvalues else {}
            except FactorError:
                pivots = {}
        return _state(share, response, reached, pivots, values)


def _state(
    share: float,
    response: CellResponse,
    field: CellField | None,
    pivots: dict[str, int],
    values: dict[str, float],
) -> _State:
    extrema, tangent = response.extrema, response.tangent
    assert extrema is not None
    assert tangent is not None
    assert tangent.stress_grad_u is not None
    assert response.stress is not None
    least = acoustic_minimum(tangent.stress_grad_u[0])
    return _State(
        share=share,
        status=int(response.status[0]),
        contact_share=float(extrema.contact_share[0]),
        min_gap=float(extrema.min_gap[0]),
        stress=response.stress[0],
        pivots=pivots,
        eigenvalues=values,
        acoustic=least.value,
        direction=least.direction,
        field=field,
    )
