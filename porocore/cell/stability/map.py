"""Map of stability: lines of states, onsets of events by bisection; plan, HDF5 file and tables of the lines."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from porocore.cell.equilibrium.discrete import FactorError
from porocore.cell.equilibrium.solver import PreparedCell
from porocore.cell.stability.modes import WAVES, acoustic_minimum, lowest_eigenvalues, negative_pivots
from porocore.core.echo import echo
from porocore.core.field_check import known_statuses
from porocore.core.files.plain_data import write_csv
from porocore.core.hdf5 import Contents, Kind, atomic_hdf5, numbered, opened
from porocore.core.inputs import NAMES, input_meant
from porocore.core.models.bounds import MOST_LINES, MOST_POINTS, SMALLEST_INTERVAL
from porocore.core.units import units_now
from porocore.errors import ConfigurationError, DataError
from porocore.interfaces.cell import CellField, CellSolver
from porocore.plugins.border import solution_of
from porocore.states import Array, IntArray, MacroState, Status

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
    """Values of one state, as in a line, and its field; None where it has no values."""

    share: float
    status: int
    contact_share: float
    min_gap: float
    stress: Array
    pivots: IntArray
    eigenvalues: Array
    acoustic: float
    direction: Array
    field: CellField | None

    def shows(self, event: str) -> bool:
        if event == "crease":
            return self.status == Status.overlap or self.contact_share > 0 or self.min_gap <= 0
        if event == "acoustic":
            return self.acoustic <= 0
        return bool(self.pivots[WAVES.index(event)] > 0)


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
    names = [f.name for f in fields(_State) if f.name != "field"]
    columns = {name: np.array([getattr(state, name) for state in states]) for name in names}
    return StabilityLine(start=start, goal=goal, onsets=line.onsets(states), **columns)


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
            if middle is None or (event in WAVES and middle.pivots[WAVES.index(event)] < 0):
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
        pivots, values = np.full(len(WAVES), -1), np.full(len(WAVES), np.nan)
        if reached is not None:
            solid = self.prepared.eighth
            iterate = solid.iterate_at(reached.grad_u, reached.p, reached.u)
            with suppress(FactorError):
                counts = negative_pivots(solid, iterate, waves)
                lowest = lowest_eigenvalues(solid, iterate, waves) if eigenvalues else {}
                pivots[[WAVES.index(wave) for wave in counts]] = list(counts.values())
                values[[WAVES.index(wave) for wave in lowest]] = list(lowest.values())
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
            field=reached,
        )


FORMAT, VERSION = "porocore-stability", 1
#: Shapes of the fields of a line in a file.
LINE_SHAPES: dict[str, tuple[int | str, ...]] = {
    "start": (10,),
    "goal": (10,),
    "share": ("n",),
    "status": ("n",),
    "contact_share": ("n",),
    "min_gap": ("n",),
    "stress": ("n", 3, 3),
    "pivots": ("n", len(WAVES)),
    "eigenvalues": ("n", len(WAVES)),
    "acoustic": ("n",),
    "direction": ("n", 3),
    "onsets": (len(EVENTS), 2),
}


@dataclass(frozen=True)
class MapPlan:
    """Lines along some inputs, one for each value of another.

    Attributes
    ----------
    along
        Inputs that run together from zero to these values.
    across
        Input that is constant on each line.
    values
        Its values, one for each line.
    line
        Settings of each line.
    """

    along: Mapping[str, float]
    across: str
    values: tuple[float, ...]
    line: LineSettings = field(default_factory=LineSettings)

    def __post_init__(self) -> None:
        names = ("H11", "H22", "H33", "p")
        for name in (*self.along, self.across):
            if name not in names:
                meant = "" if name in NAMES else input_meant(name)
                raise ConfigurationError(
                    f"unknown input {echo(name)} of a stability map; expected one of {', '.join(names)}: its states "
                    f"keep the mirror planes of the cell{meant and f'; {meant}'}"
                )
        if self.across in self.along:
            raise ConfigurationError(
                f"input '{self.across}' runs both along the lines and across them; choose one"
            )
        if not any(self.along.values()):
            raise ConfigurationError(
                "the lines of a stability map go nowhere; give an input along them, not 0"
            )
        if len(self.values) > MOST_LINES:
            raise ConfigurationError(
                f"{len(self.values)} lines of a stability map; at most {MOST_LINES} are followed"
            )
        if not self.values or len(set(self.values)) < len(self.values):
            raise ConfigurationError(f"expected different values of {self.across}, got {list(self.values)}")

    def ends(self, value: float) -> tuple[Array, Array]:
        """Return start and goal (10,) of the line at one value."""
        start = np.zeros(10)
        start[NAMES.index(self.across)] = value
        goal = start.copy()
        for name, end in self.along.items():
            goal[NAMES.index(name)] = end
        return start, goal

    @property
    def leading(self) -> str:
        """Input along the lines that changes most."""
        return max(self.along, key=lambda name: abs(self.along[name]))

    def describe(self) -> dict[str, Any]:
        """Return the plan as plain data; the lines depend on nothing else."""
        return {
            "along": dict(self.along),
            "across": self.across,
            "values": list(self.values),
            **asdict(self.line),
        }


def save(path: Path, identity: str, lines: Sequence[StabilityLine], provenance: Mapping[str, str]) -> None:
    """Write finished lines to an HDF5 file, atomically."""
    with atomic_hdf5(path) as file:
        file.attrs.update(format=FORMAT, version=VERSION, identity=identity, **provenance)
        file.attrs["waves"], file.attrs["events"] = list(WAVES), list(EVENTS)
        for i, line in enumerate(lines):
            for f in fields(line):
                file[f"lines/{i}/{f.name}"] = getattr(line, f.name)


def load(path: Path, identity: str | None = None) -> list[StabilityLine]:
    """Read what :func:`save` wrote.

    Raises
    ------
    DataError
        The file is damaged, or belongs to another map.
    """
    with opened(path, "stability map", "map again") as file:
        if not file.is_of(FORMAT, VERSION):
            raise DataError(f"{path}: expected a stability map of version {VERSION}; choose another --out")
        found = file.attribute("identity", str)
        lines = [_read_line(file, group) for group in numbered(file, "lines")]
    if identity is not None and found != identity:
        raise DataError(
            f"{path}: holds the map of another cell, backend or plan; choose another --out, or move it elsewhere"
        )
    return lines


def _read_line(file: Contents, group: str) -> StabilityLine:
    arrays = {}
    for name, (length, *shape) in LINE_SHAPES.items():
        symbol = f"{group} {length}" if isinstance(length, str) else length
        kind: Kind = "int" if name in ("status", "pivots") else "float"
        finite = name in ("start", "goal", "share")
        arrays[name] = file.array(f"{group}/{name}", symbol, *shape, kind=kind, finite=finite)
    if not known_statuses(arrays["status"]).all():
        raise ValueError(f"'{group}/status' holds codes that are no status")
    return StabilityLine(**arrays)


def write_tables(folder: Path, plan: MapPlan, lines: Sequence[StabilityLine]) -> tuple[Path, Path]:
    """Write states.csv, a row for each state, and onsets.csv, a row for each line; return their paths.

    Values are in the units of the study, which stand in the names of the columns.
    """
    units = units_now()
    inputs = (*plan.along, plan.across)
    columns = [NAMES.index(name) for name in inputs]
    header = [*(input_titled(name) for name in inputs), "status", "contact_share", "min_gap"]
    header += [units.titled("acoustic", "stress"), *(f"negative_pivots_{wave}" for wave in WAVES)]
    header += [eigenvalue_titled(f"eigenvalue_{wave}") for wave in WAVES]
    factors, stress = np.array([input_factor(name) for name in inputs]), units.factor("stress")
    rows: list[list[Any]] = []
    for line in lines:
        for k, theta in enumerate(line.states()):
            row: list[Any] = [*theta[columns] * factors, Status(int(line.status[k])).name]
            row += [line.contact_share[k], line.min_gap[k], line.acoustic[k] * stress]
            rows.append([*row, *line.pivots[k], *line.eigenvalues[k] * stress])
    states = write_csv(folder / "states.csv", header, rows)
    leading, across = NAMES.index(plan.leading), NAMES.index(plan.across)
    header = [input_titled(plan.across)]
    header += [input_titled(plan.leading, f"_{event}_{side}") for event in EVENTS for side in ("from", "to")]
    of_line, factor = input_factor(plan.across), input_factor(plan.leading)
    rows = []
    for line in lines:
        span = line.goal[leading] - line.start[leading]
        onsets = (line.start[leading] + line.onsets * span) * factor
        rows.append([line.start[across] * of_line, *onsets.ravel()])
    return states, write_csv(folder / "onsets.csv", header, rows)


def input_titled(name: str, ending: str = "") -> str:
    """Return an input as the title of a column, with its unit."""
    return units_now().titled(name + ending, _quantity(name))


def input_factor(name: str) -> float:
    """Return the factor of the values of an input in the units of the study."""
    return units_now().factor(_quantity(name))


def eigenvalue_titled(name: str, edge: str = "d²") -> str:
    """Return an eigenvalue as a title, with scales in stress per squared edge d of the cell."""
    return f"{name} [{units_now().name('stress')}/{edge}]" if units_now().given else name


def _quantity(name: str) -> str:
    return "pressure" if name == "p" else ""
