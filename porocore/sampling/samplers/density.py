"""Sampler ``density-sweep`` (DensitySweep): sweeps of one input whose step is halved where <∇u¹> bends."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from porocore.core.echo import echo, suggestion
from porocore.core.inputs import InputSpace, value_text
from porocore.core.models.bounds import MOST_STATES
from porocore.errors import ConfigurationError
from porocore.interfaces.sampler import Request, Sampler
from porocore.sampling.samplers.designs import check_waiting, positive, refuse_unknown
from porocore.states import Array, CellResponse, Status

#: A norm of <∇u¹>_s below this is round-off of the cell solver and counts as this.
SMALLEST_NORM = 1e-8


@dataclass(frozen=True, eq=False)
class LinePoint:
    """Solved point of a line."""

    value: float
    #: <∇u¹>_s (3, 3); None where the state has no values.
    mean_grad: Array | None


def density_residual(before: LinePoint, last: LinePoint, point: LinePoint, step: float) -> float:
    """Return the distance of ``point`` from the straight line through the two accepted points before it [-].

    max_ij |g − g_L| / ‖g‖_F with g = <∇u¹>_s and its linear extrapolation
    g_L = g_last + (g_last − g_before)/(I_last − I_before) · (I − I_last)
    (Dehghani & Zilian, eq. Res). The norm of g goes through zero where the effects of two inputs cancel, and
    the residual would then ask for small steps where nothing bends. So the norm counts as no smaller than
    the change of g over one default ``step`` along that line, nor as smaller than :data:`SMALLEST_NORM`.
    """
    assert before.mean_grad is not None
    assert last.mean_grad is not None
    assert point.mean_grad is not None
    slope = (last.mean_grad - before.mean_grad) / (last.value - before.value)
    extrapolated = last.mean_grad + slope * (point.value - last.value)
    norm = max(
        float(np.linalg.norm(point.mean_grad)), float(np.linalg.norm(slope)) * abs(step), SMALLEST_NORM
    )
    return float(np.abs(point.mean_grad - extrapolated).max()) / norm


@dataclass
class LineSweep:
    """Sweep of one input from zero to ``end``; those before it rest at ``prefix``, those after it at zero.

    A point ahead that is too far off the secant, or that has no values, moves the next point to the middle
    of the interval; the point ahead is kept and looked at again from there. An interval whose half would be
    below ``smallest`` default steps is accepted as it is. A point without values that is still ahead then is
    the edge of the computable region: from there on the line runs to ``end`` at the default step without
    checks, and every point with values counts as accepted.

    Attributes
    ----------
    prefix
        Values of the inputs before the moving one.
    origin
        The solved point at zero.
    end
        End of the line; its sign is the direction.
    step
        Default step, positive.
    tolerance
        Largest density residual that is accepted.
    smallest
        Smallest interval as a fraction of ``step``.
    """

    prefix: tuple[float, ...]
    origin: LinePoint
    end: float
    step: float
    tolerance: float
    smallest: float
    #: The last accepted point.
    last: LinePoint = field(init=False)
    #: Points of the default grid not yet asked for, next one last.
    grid: list[float] = field(init=False)
    #: Solved points that are not accepted yet, nearest last.
    ahead: list[LinePoint] = field(init=False, default_factory=list)
    _before: LinePoint | None = field(init=False, default=None)
    _beyond: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        self.last = self.origin
        self.grid = grid_values(self.end, self.step)[::-1]

    @property
    def position(self) -> int:
        """Index of the moving input among the inputs."""
        return len(self.prefix)

    def tell(self, point: LinePoint) -> list[LinePoint]:
        """Record the response at the point of :meth:`next_value`; return the points that it makes accepted."""
        self.ahead.append(point)
        accepted = []
        while self.ahead and (self._beyond or not self._wants_middle(self.ahead[-1])):
            nearest = self.ahead.pop()
            if nearest.mean_grad is None:
                self._beyond = True
            else:
                self._before, self.last = self.last, nearest
                accepted.append(nearest)
        return accepted

    def next_value(self) -> float | None:
        """Return the next value to solve; None at the end of the line."""
        if self.ahead:
            return (self.last.value + self.ahead[-1].value) / 2
        return self.grid.pop() if self.grid else None

    def _wants_middle(self, point: LinePoint) -> bool:
        half = abs(point.value - self.last.value) / 2
        if half < self.smallest * self.step * (1 - 1e-9):
            return False
        if point.mean_grad is None:
            return True
        if self._before is None:
            return False
        return density_residual(self._before, self.last, point, self.step) > self.tolerance


def grid_values(end: float, step: float) -> list[float]:
    """Return step, 2 step, … with the sign of ``end``, up to ``end`` itself, which is hit exactly."""
    return [float(np.copysign(i * step, end)) for i in range(1, grid_size(end, step))] + [end]


def grid_size(end: float, step: float) -> int:
    """Return the number of values of :func:`grid_values`."""
    return max(1, int(np.ceil(abs(end) / step - 1e-9)))


#: Values closer than this would share a key.
SMALLEST_INTERVAL = 1e-9


class DensitySweep(Sampler):
    """One-factor-at-a-time sampling with a check of the output density (Dehghani & Zilian, eq. Res).

    The first input is swept from zero to both ends of its range with the others at zero. Every accepted value
    starts sweeps of each later input from there, and so on, all independent of one another: whatever can be
    solved is asked for at once. Each sweep is a :class:`LineSweep`, which says
    how the step is halved, what happens near a zero of <∇u¹>, and how the edge of the computable region is resolved.
    The first step of a sweep has no two points behind it and is accepted unchecked.

    A state starts from the field of the last accepted state of its sweep. A state without values is data
    too, but starts no further sweeps. Keys are the inputs to ten decimals, such as
    ``p=+0.0800000000 H22=-0.1200000000``.

    Parameters
    ----------
    inputs
        Each range must include 0. Their order is that of the nesting: put first what is solvable alone.
    step
        Default step of each input, by name.
    tolerance
        Largest residual, a fraction of ‖<∇u¹>_s‖_F.
    smallest : float, above 0, at most 1
        Smallest interval as a fraction of the default step.

    Raises
    ------
    ConfigurationError
        An option is unknown, missing or of no use; the message begins with its key in a configuration.
    """

    samples_parameters = False

    def __init__(
        self,
        inputs: InputSpace,
        step: Mapping[str, float] | None = None,
        tolerance: float = 0.05,
        smallest: float = 0.125,
        **unknown: Any,
    ) -> None:
        refuse_unknown("density-sweep", ("smallest",), unknown)
        if inputs.parameters:
            raise ConfigurationError(
                "sampling.sampler: density-sweep sweeps from the undeformed cell, and varies no parameters of the cell "
                f"({', '.join(inputs.parameters)}); take another sampler such as sobol, or give each of them one value"
            )
        self.inputs = inputs
        self.tolerance = positive("sampling.tolerance", tolerance)
        self.smallest = positive("sampling.options.smallest", smallest)
        if self.smallest > 1:
            raise ConfigurationError(
                f"sampling.options.smallest: must be a fraction of the step in (0, 1], got {echo(smallest)}"
            )
        self.steps = _checked_steps(inputs, step or {}, self.smallest)
        for name, low, high in zip(inputs.names, inputs.lower, inputs.upper, strict=True):
            if not low <= 0 <= high:
                raise ConfigurationError(
                    f"sampling.inputs.{name}.range: must include 0, where every sweep of density-sweep starts, "
                    f"got {inputs.range_text(name)}; widen it"
                )
        sizes = [
            1 + sum(grid_size(end, step) for end in (low, high) if end != 0)
            for low, high, step in zip(inputs.lower, inputs.upper, self.steps, strict=True)
        ]
        if (states := math.prod(sizes)) > MOST_STATES:
            each = " × ".join(f"{size:.4g} of {name}" for name, size in zip(inputs.names, sizes, strict=True))
            raise ConfigurationError(
                f"sampling.inputs: the steps make a grid of {float(states):.3g} states ({each}); at most {MOST_STATES} "
                "are solved: enlarge the steps, or take another sampler such as sobol"
            )
        self._grid_sizes = sizes
        #: For each input, the number of grid states that one of its values begets, itself included.
        self._subtree = [math.prod(sizes[k + 1 :]) for k in range(len(inputs))]
        root = (0.0,) * len(inputs)
        key = state_key(inputs, root)
        self._waiting: dict[str, tuple[tuple[float, ...], LineSweep | None]] = {key: (root, None)}
        self._ready = [Request(key, root)]
        self._asked = 1

    def ask(self) -> list[Request]:
        """Return the next state of every sweep that waits for none."""
        ready, self._ready = self._ready, []
        return ready

    def tell(self, key: str, response: CellResponse) -> None:
        """Record the response of one state, move its sweep on and start those that branch off."""
        check_waiting(key, self._waiting)
        x, line = self._waiting.pop(key)
        has_values = Status(int(response.status[0])).has_values
        mean_grad = response.mean_grad[0].copy() if has_values else None
        if line is None:
            if mean_grad is not None:
                self._branch((), LinePoint(0.0, mean_grad))
            return
        for point in line.tell(LinePoint(x[line.position], mean_grad)):
            self._branch(line.prefix, point)
        self._move_on(line)

    @property
    def done(self) -> bool:
        """True when every sweep has reached its end."""
        return not self._waiting

    @property
    def expected(self) -> int:
        """Number of states asked for and still to come if no step is halved again."""
        foreseen = 0
        for _, line in self._waiting.values():
            if line is None:
                foreseen += self._subtree[0] * self._grid_sizes[0] - 1
            else:
                subtree = self._subtree[line.position]
                foreseen += len(line.grid) * subtree + (len(line.ahead) + 1) * (subtree - 1)
        return self._asked + foreseen

    def _branch(self, prefix: tuple[float, ...], point: LinePoint) -> None:
        """Start the sweeps of the inputs that follow ``prefix`` and the value of ``point``."""
        fixed = (*prefix, point.value) if prefix or point.value != 0 else ()
        for k in range(len(fixed), len(self.inputs)):
            resting = fixed + (0.0,) * (k - len(fixed))
            origin = LinePoint(0.0, point.mean_grad)
            for end in (self.inputs.upper[k], self.inputs.lower[k]):
                if end != 0:
                    self._move_on(
                        LineSweep(resting, origin, end, self.steps[k], self.tolerance, self.smallest)
                    )

    def _move_on(self, line: LineSweep) -> None:
        value = line.next_value()
        if value is None:
            return
        x = self._complete((*line.prefix, value))
        key = state_key(self.inputs, x)
        # A state belongs to the one sweep that moves its last non-zero input, so no two sweeps meet.
        assert key not in self._waiting
        self._waiting[key] = (x, line)
        start = state_key(self.inputs, self._complete((*line.prefix, line.last.value)))
        self._ready.append(Request(key, x, start))
        self._asked += 1

    def _complete(self, values: tuple[float, ...]) -> tuple[float, ...]:
        return values + (0.0,) * (len(self.inputs) - len(values))


def state_key(inputs: InputSpace, x: tuple[float, ...]) -> str:
    """Return the values of the inputs as text, such as ``p=+0.0800000000 H22=-0.1200000000``."""
    return " ".join(f"{name}={value:+.10f}" for name, value in zip(inputs.names, x, strict=True))


def _checked_steps(inputs: InputSpace, step: Mapping[str, float], smallest: float) -> tuple[float, ...]:
    for name in step:
        if name not in inputs.names:
            raise ConfigurationError(
                f"sampling.options.step.{name}: names no sampled input; "
                + suggestion(name, inputs.names, "these are")
            )
    steps = []
    for name in inputs.names:
        if name not in step:
            raise ConfigurationError(
                f"sampling.inputs.{name}.step: missing, and density-sweep needs it; give the default step of '{name}'"
            )
        size = positive(f"sampling.inputs.{name}.step", step[name])
        if size * smallest < SMALLEST_INTERVAL:
            raise ConfigurationError(
                f"sampling.inputs.{name}.step: {value_text(name, size)} with smallest = {smallest:g} allows intervals "
                f"below {value_text(name, SMALLEST_INTERVAL)}; enlarge one of them"
            )
        steps.append(size)
    return tuple(steps)
