"""One sweep of one input in one direction: next value, check of the output density."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from porocore.states import Array

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
