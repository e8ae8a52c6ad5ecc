"""Inputs that are sampled and their ranges (InputSpace); size up to which another component counts as zero."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.core.units.results import spoken
from porocore.errors import ConfigurationError
from porocore.states import Array, MacroState

NAMES = (*(f"H{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)), "p")

#: Share of the largest sampled component of H that others may move by unnoticed.
NEGLIGIBLE = 2e-3
#: Components of H below the diagonal.
BELOW = ("H21", "H31", "H32")


@dataclass(frozen=True)
class InputSpace:
    """An ordered choice of d of the ten inputs H11 … H33, p with a closed range for each; the others stay zero.

    Attributes
    ----------
    names
        From ``H11`` … ``H33`` and ``p``.
    lower, upper
        Bounds, one for each name.

    Examples
    --------
    >>> from porocore import InputSpace
    >>> inputs = InputSpace.from_ranges({"H22": (-0.4, 0.04), "p": (-0.1, 0.1)})
    >>> states = inputs.scatter([[-0.2, 0.05]])
    >>> states.grad_u[:, 1, 1], states.p
    (array([-0.2]), array([0.05]))
    >>> inputs.gather(states)
    array([[-0.2 ,  0.05]])
    """

    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in self.names:
            if name not in NAMES:
                raise ConfigurationError(f"unknown input '{name}'; the inputs are {', '.join(NAMES)}")
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            if not low < high:
                raise ConfigurationError(
                    f"the range of input '{name}' is empty: [{low:g}, {high:g}]; give [lower, upper] with lower < upper"
                )

    def __len__(self) -> int:
        return len(self.names)

    def range_text(self, name: str, digits: int = 6) -> str:
        """Return the range of an input, with the study's unit of p."""
        k = self.names.index(name)
        return f"[{value_text(name, self.lower[k], digits)}, {value_text(name, self.upper[k], digits)}]"

    @classmethod
    def from_ranges(cls, ranges: Mapping[str, tuple[float, float]]) -> InputSpace:
        """Return the space of ``{"H22": (-0.4, 0.04), ...}``."""
        low, high = zip(*ranges.values(), strict=True)
        return cls(tuple(ranges), tuple(low), tuple(high))

    @cached_property
    def columns(self) -> tuple[int, ...]:
        """Position of each input among the ten components (H row by row, then p)."""
        return tuple(NAMES.index(name) for name in self.names)

    def gather(self, states: MacroState) -> Array:
        """Return the inputs of n states, (n, d)."""
        return components(states)[list(self.columns)].T

    def without_rotation(self, states: MacroState) -> MacroState:
        """Return the states rotated so that F = I + H is upper triangular, with the same stretch.

        For an objective law they are the same, and inputs from the upper triangle of H reach all of them. Where a
        component below the diagonal is an input, and where det F is not positive, states stay as they are.
        """
        H = states.grad_u
        if any(name in self.names for name in BELOW) or not H[:, (1, 2, 2), (0, 0, 1)].any():
            return states
        F = np.eye(3) + H
        turned = np.linalg.det(F) > 0
        F = F[turned]
        # F = Q R has the stretch of R, and C = RᵀR is its Cholesky factorisation.
        back = H.copy()
        back[turned] = np.linalg.cholesky(F.swapaxes(1, 2) @ F).swapaxes(1, 2) - np.eye(3)
        return MacroState(back, states.p)

    def to_unit(self, x: Array) -> Array:
        """Return inputs (n, d) scaled by their ranges: the box becomes the unit box."""
        low, high = np.array(self.lower), np.array(self.upper)
        unit: Array = (x - low) / (high - low)
        return unit

    def scatter(self, x: npt.ArrayLike) -> MacroState:
        """Return n states from inputs (n, d), all other components zero."""
        rows: Array = np.atleast_2d(np.asarray(x, dtype=float))
        flat = np.zeros((len(rows), 10))
        flat[:, list(self.columns)] = rows
        return MacroState(flat[:, :9].reshape(-1, 3, 3), flat[:, 9].copy())

    @property
    def negligible(self) -> float:
        """Largest value of a component that is no input, small against the inputs, that is neglected.

        The symmetry of a body and its cell is broken as much by a mesh that does not have it.
        """
        bounds = [
            abs(b)
            for c, *both in zip(self.columns, self.lower, self.upper, strict=True)
            if c < 9
            for b in both
        ]
        return max(1e-6, NEGLIGIBLE * max(bounds, default=0.0))

    def moves_other(self, states: MacroState) -> npt.NDArray[np.bool_]:
        """Return the rows (n,) in which a component that is no input is not negligible."""
        return self.others_move(components(states))

    def others_move(self, rows: Array) -> npt.NDArray[np.bool_]:
        """Return the same for the ten ``components`` (10, n)."""
        rest = rows[[column for column in range(10) if column not in self.columns]]
        moves: npt.NDArray[np.bool_] = np.abs(rest, out=rest).max(axis=0, initial=0.0) > self.negligible
        return moves


def value_text(name: str, value: float, digits: int = 6) -> str:
    """Return the value of an input, with the study's unit if it is p."""
    return spoken().text(value, "pressure" if name == "p" else "", digits)


def components(states: MacroState) -> Array:
    """Return (10, n): H row by row, then p, each contiguous in memory."""
    rows, H = np.empty((10, len(states))), states.grad_u.reshape(-1, 9)
    for i in range(9):
        rows[i] = H[:, i]
    rows[9] = states.p
    return rows


def flatten(states: MacroState) -> Array:
    """Return (n, 10): H row by row, then p."""
    return np.concatenate([states.grad_u.reshape(-1, 9), states.p[:, None]], axis=1)
