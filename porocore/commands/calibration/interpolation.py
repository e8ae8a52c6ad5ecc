"""Interpolation in time between the steps of a run (HistoryInterpolation), with its derivatives and weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.states import Array, IntArray


@dataclass(frozen=True, eq=False)
class HistoryInterpolation:
    """Linear interpolation between the steps of a run.

    Before the first step a series has its first value, and behind the last step its last one.

    Attributes
    ----------
    before : (m,)
        Step before each time, or at it.
    share : (m,)
        Share of the step behind it that has passed.
    rate : (m,)
        Derivative of the share by the time; 0 outside the run.
    """

    before: IntArray
    share: Array
    rate: Array

    @classmethod
    def at(cls, steps: Array, times: Array) -> HistoryInterpolation:
        """Return the interpolation of series at ascending steps (n,) for times (m,)."""
        before = np.clip(np.searchsorted(steps, times, side="right") - 1, 0, len(steps) - 2)
        length = steps[before + 1] - steps[before]
        share = (times - steps[before]) / length
        inside = (share >= 0) & (share <= 1)
        return cls(before.astype(np.int64), np.clip(share, 0.0, 1.0), np.where(inside, 1 / length, 0.0))

    def values(self, series: Array) -> Array:
        """Return a series (n, ...) at the times, (m, ...); derivatives of a series by unknowns are series too."""
        share = self.share.reshape(-1, *[1] * (series.ndim - 1))
        return np.asarray((1 - share) * series[self.before] + share * series[self.before + 1])

    def weights(self, steps: int) -> Array:
        """Return the weights (steps, m) of the values of a series in those at the times."""
        found, column = np.zeros((steps, len(self.share))), np.arange(len(self.share))
        found[self.before, column] = 1 - self.share
        found[self.before + 1, column] += self.share
        return found

    def rates(self, series: Array) -> Array:
        """Return the derivative (m,) of the interpolated series (n,) by the time; at a step that behind it."""
        return np.asarray((series[self.before + 1] - series[self.before]) * self.rate)
