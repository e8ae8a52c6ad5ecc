"""The error of a backward Euler step, from how the rate of change has changed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.macro.discretisation import Discretisation
from porocore.states import Array


@dataclass
class ErrorControl:
    """Remembers the rate of the last accepted step, and the largest displacement and pressure so far.

    Attributes
    ----------
    rate : (local unknowns,)
        (x − x_old) / Δt; None at the start and where the load bends.
    length
        Δt of that step.
    scales
        Largest |u| and |p| so far.
    """

    rate: Array | None = None
    length: float = 0.0
    scales: tuple[float, float] = (0.0, 0.0)

    def error(self, d: Discretisation, old: Array, new: Array, dt: float) -> float | None:
        """Largest Δt² ẍ / 2 of u and of p, each as a share of the largest so far; None where no rate is known.

        ẍ is the change of the rate over half of both steps (Milne's device for backward Euler).
        """
        own = np.arange(len(new)) < d.owned
        blocks = (d.is_force & own, ~d.is_force & own)
        u, p = (d.world.largest(float(np.abs(new[block]).max(initial=0.0))) for block in blocks)
        self.scales = (max(self.scales[0], u), max(self.scales[1], p))
        if self.rate is None:
            return None
        change = np.abs((new - old) / dt - self.rate) * dt**2 / (dt + self.length)
        errors = [
            d.world.largest(float(change[block].max(initial=0.0))) / scale if scale > 0 else 0.0
            for block, scale in zip(blocks, self.scales, strict=True)
        ]
        return max(errors)

    def accept(self, old: Array, new: Array, dt: float) -> None:
        """The step is taken."""
        self.rate, self.length = (new - old) / dt, dt

    def forget(self) -> None:
        """The load bends, and the rate does not go on."""
        self.rate = None
