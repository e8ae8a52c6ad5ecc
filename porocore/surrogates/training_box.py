"""Box of the training states (TrainingBox): states outside it, and the saturation of the variables there."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.core.tensors import PointGroup
from porocore.states import Array, IntArray
from porocore.surrogates.symmetry import on_variables, stabiliser

#: Width of the saturation beyond the box, as a share of its size.
MARGIN = 0.1
#: The box is enlarged by this share at each end in many variables, where the sampled states leave the corners empty.
EXTENSION, MANY = 0.1, 4


@dataclass(frozen=True, eq=False)
class TrainingBox:
    """Box of the training states in the variables y.

    Attributes
    ----------
    active
        Variables that were sampled; the others are left as they are.
    low, high : (d,)
        Bounds of the active variables; rest, y = 0, lies inside.
    """

    active: tuple[int, ...]
    low: Array
    high: Array

    @classmethod
    def from_states(cls, y: Array, active: tuple[int, ...], group: PointGroup) -> TrainingBox:
        """Return the box around the states y (7, n), with the symmetry of a group as far as it leads to no other."""
        low, high = np.minimum(y.min(axis=1), 0.0), np.maximum(y.max(axis=1), 0.0)
        action, ends = on_variables(stabiliser(group, active)), np.stack([low, high])
        for to, sign in zip(action.to, action.sign, strict=True):
            image = np.sort(ends * sign, axis=0)
            low[to], high[to] = np.minimum(low[to], image[0]), np.maximum(high[to], image[1])
        more = EXTENSION * (high - low) if len(active) >= MANY else 0.0 * low
        return cls(active, (low - more)[list(active)], (high + more)[list(active)])

    def beyond(self, y: Array) -> IntArray:
        """Return which of the states y (7, n) lie outside the box."""
        return self.beyond_active(y[list(self.active)])

    def beyond_active(self, inner: Array) -> IntArray:
        """Return the same for the active variables alone, (d, n)."""
        outside = (inner < self.low[:, None]) | (inner > self.high[:, None])
        return np.flatnonzero(outside.any(axis=0))

    def saturated(self, y: Array) -> tuple[Array, Array, Array]:
        """Return z(y) (7, n) with its first and second derivatives, (7, n) each.

        z = y inside the box, and c + δ tanh((y − c)/δ) beyond an end c of it, which is twice continuously
        differentiable.
        """
        active = list(self.active)
        z, first, second = y.copy(), np.ones_like(y), np.zeros_like(y)
        z[active], first[active], s = self.saturated_active(y[active])
        second[active] = -2 / self._margin * s * first[active]
        return z, first, second

    def saturated_active(self, inner: Array) -> tuple[Array, Array, Array]:
        """Return z (d, n) of the active variables ``inner`` (d, n), its first derivative, and tanh((y − c)/δ)."""
        ends = np.minimum(np.maximum(inner, self.low[:, None]), self.high[:, None])
        s = np.tanh((inner - ends) / self._margin)
        return ends + self._margin * s, 1 - s * s, s

    @cached_property
    def _margin(self) -> Array:
        """Width δ (d, 1) of the saturation."""
        return MARGIN * np.maximum(self.high - self.low, 1e-12)[:, None]
