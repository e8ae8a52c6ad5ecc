"""Error of a time step, from the change of the rate or from two half steps; share of the load reached."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.macro.boundary.conditions import BoundaryData
from porocore.macro.integration.discretisation import Discretisation
from porocore.macro.problem import MacroProblem
from porocore.states import Array

#: Times up to the first kink at which the loads are evaluated for their largest values.
SAMPLES = 100


@dataclass
class ErrorControl:
    """Error estimate from the rate of the last accepted step and the largest displacement and pressure so far.

    Attributes
    ----------
    rate : (local unknowns,)
        (x − x_old) / Δt; None at the start and after a kink of the loads.
    length
        Δt of that step.
    scales
        Largest |u| and |p| so far.
    """

    rate: Array | None = None
    length: float = 0.0
    scales: tuple[float, float] = (0.0, 0.0)
    _found: tuple[float, float] = (0.0, 0.0)

    def error(
        self,
        d: Discretisation,
        old: Array,
        new: Array,
        dt: float,
        finer: Array | None = None,
        reached: float = 1.0,
    ) -> float | None:
        """Return the largest Δt² ẍ / 2 of u and of p, each as a share of the largest so far.

        ẍ is the change of the rate over half of both steps (Milne's device for backward Euler). Where no rate is known
        it is told by two steps of half the length, whose error is half that of one [Hairer, Nørsett & Wanner, Solving
        Ordinary Differential Equations I, II.4].

        Parameters
        ----------
        finer
            Where two steps of half the length end; without and without a rate there is no estimate, None.
        reached
            Share that has acted of the load that first comes up, by which the largest values are divided: at its
            beginning they say nothing yet, and the first step would be in error by a quarter however short it is.
        """
        own = np.arange(len(new)) < d.owned
        blocks = (d.is_force & own, ~d.is_force & own)
        u, p = (d.communicator.max(float(np.abs(new[block]).max(initial=0.0))) for block in blocks)
        self._found = (max(self.scales[0], u), max(self.scales[1], p))
        if self.rate is not None:
            change = np.abs((new - old) / dt - self.rate) * dt**2 / (dt + self.length)
        elif finer is not None:
            change = 2 * np.abs(new - finer)
        else:
            return None
        errors = [
            reached * d.communicator.max(float(change[block].max(initial=0.0))) / scale if scale > 0 else 0.0
            for block, scale in zip(blocks, self._found, strict=True)
        ]
        return max(errors)

    def accept(self, old: Array, new: Array, dt: float) -> None:
        """Take the step whose error was estimated last."""
        self.scales = (max(self.scales[0], self._found[0]), max(self.scales[1], self._found[1]))
        self.rate, self.length = (new - old) / dt, dt

    def reset(self) -> None:
        """Drop the rate, which is not continuous where a load has a kink."""
        self.rate = None


class Reached:
    """Largest share that any load has reached of its maximum before the first kink of the loads."""

    def __init__(self, boundary: BoundaryData, problem: MacroProblem) -> None:
        self._boundary, self._problem = boundary, problem
        plan = problem.time
        self._end = min(plan.ramp_increments * plan.ramp_step, *problem.corners, plan.end)
        self._times = np.linspace(0, self._end, SAMPLES + 1)[1:]
        self._sizes = np.abs([boundary.amplitudes(problem, time) for time in self._times.tolist()])
        self._peaks = self._sizes.max(axis=0)
        begins = problem.initial.pressure != 0 or any(map(any, problem.initial.gradient))
        self._acts = boundary.acting & (self._peaks > 0) & (not begins)

    def __call__(self, time: float) -> float:
        """Return the share, at most 1; 1 from the kink on, where no load acts, or the body does not begin at rest."""
        if time >= self._end or not self._acts.any():
            return 1.0
        now = np.abs(self._boundary.amplitudes(self._problem, time))
        so_far = np.maximum(now, self._sizes[self._times <= time].max(axis=0, initial=0.0))
        return min(1.0, float((so_far[self._acts] / self._peaks[self._acts]).max()))
