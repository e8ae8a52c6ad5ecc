"""Inputs that are sampled and their ranges (InputSpace); size up to which another component counts as zero."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from porocore.core.echo import joined
from porocore.core.inputs.used_values import UsedValues
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
    """An ordered choice of d inputs with a closed range for each; the others stay zero.

    They are some of the ten components H11 … H33 and p of a state, then all parameters of the cell.

    Attributes
    ----------
    names
        From ``H11`` … ``H33`` and ``p``, then the ``parameters``.
    lower, upper
        Bounds, one for each name.
    parameters
        Names of the cell's parameters in their order, the last of ``names``; empty for a cell without.
    used
        Values of all parameters, k rows of them, that a body uses: states are sampled at such values alone. Empty: over
        the whole ranges.

    Examples
    --------
    >>> from porocore import InputSpace
    >>> inputs = InputSpace.from_ranges({"H22": (-0.4, 0.04), "p": (-0.1, 0.1)})
    >>> states = inputs.scatter([[-0.2, 0.05]])
    >>> states.grad_u[:, 1, 1], states.p
    (array([-0.2]), array([0.05]))
    >>> inputs.gather(states)
    array([[-0.2 ,  0.05]])
    >>> family = InputSpace.from_ranges({"H22": (-0.4, 0.04)}, {"radius": (0.15, 0.3)})
    >>> family.scatter([[-0.2, 0.25]]).parameters
    array([[0.25]])
    """

    names: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    parameters: tuple[str, ...] = ()
    used: tuple[tuple[float, ...], ...] = ()

    def __post_init__(self) -> None:
        own = len(self.names) - len(self.parameters)
        if any(len(row) != len(self.parameters) for row in self.used):
            raise ConfigurationError(
                f"expected {len(self.parameters)} values in each row of used, one for each parameter"
            )
        if own < 0 or self.names[own:] != self.parameters:
            raise ConfigurationError(
                f"expected the parameters {', '.join(self.parameters)} as the last inputs, got {joined(self.names)}"
            )
        for name in self.names[:own]:
            if name not in NAMES:
                raise ConfigurationError(f"unknown input '{name}'; the inputs are {', '.join(NAMES)}")
        for name in self.parameters:
            if name in NAMES:
                raise ConfigurationError(f"'{name}' is a component of the state and cannot name a parameter")
        if twice := next((name for name in self.names if self.names.count(name) > 1), ""):
            raise ConfigurationError(f"input '{twice}' is given twice; give each one range")
        for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
            if not low < high:
                raise ConfigurationError(
                    f"the range of input '{name}' is empty: [{low:g}, {high:g}]; give [lower, upper] with lower < upper"
                )

    def __repr__(self) -> str:
        # Hashes hang on this text: that of a space without parameters has to stay as it was.
        more = f", parameters={self.parameters!r}" if self.parameters else ""
        more += f", used={self.used!r}" if self.used else ""
        return f"InputSpace(names={self.names!r}, lower={self.lower!r}, upper={self.upper!r}{more})"

    def __len__(self) -> int:
        return len(self.names)

    def range_text(self, name: str, digits: int = 6) -> str:
        """Return the range of an input, with the study's unit of p."""
        k = self.names.index(name)
        return f"[{value_text(name, self.lower[k], digits)}, {value_text(name, self.upper[k], digits)}]"

    @classmethod
    def from_ranges(
        cls,
        ranges: Mapping[str, tuple[float, float]],
        parameters: Mapping[str, tuple[float, float]] | None = None,
        used: tuple[tuple[float, ...], ...] = (),
    ) -> InputSpace:
        """Return the space of ``{"H22": (-0.4, 0.04), ...}`` and of parameters ``{"radius": (0.15, 0.3), ...}``."""
        more = dict(parameters or {})
        low, high = zip(*ranges.values(), *more.values(), strict=True)
        return cls((*ranges, *more), tuple(low), tuple(high), tuple(more), used)

    @cached_property
    def columns(self) -> tuple[int, ...]:
        """Position of each input among the ten components (H row by row, then p) and the parameters behind them."""
        own = len(self.names) - len(self.parameters)
        return (*(NAMES.index(name) for name in self.names[:own]), *range(10, 10 + len(self.parameters)))

    @cached_property
    def parameter_ranges(self) -> Array:
        """Ranges of the parameters, (m, 2)."""
        ends: Array = np.array([self.lower, self.upper]).T[len(self) - len(self.parameters) :]
        return ends

    @cached_property
    def used_values(self) -> UsedValues | None:
        """Values of the parameters that are used, scaled by their ranges; None where the whole ranges are sampled."""
        return UsedValues(self._unit_parameters(np.array(self.used))) if self.used else None

    def not_used(self, parameters: Array) -> npt.NDArray[np.bool_]:
        """Return which values (n, m) of the parameters are away from those that are used."""
        if self.used_values is None:
            return np.zeros(len(parameters), dtype=bool)
        return self.used_values.away(self._unit_parameters(parameters))

    def _unit_parameters(self, parameters: Array) -> Array:
        low, high = self.parameter_ranges.T
        unit: Array = (parameters - low) / (high - low)
        return unit

    def require_parameters(self, states: MacroState) -> None:
        """Refuse states that have not the parameters of this space.

        Raises
        ------
        ConfigurationError
            They lack some, or have more.
        """
        if states.parameter_count == len(self.parameters):
            return
        if not self.parameters:
            raise ConfigurationError(
                f"the states have {states.parameter_count} parameters of a cell, but none were sampled: leave them "
                "out, or sample a cell with parameters (a number of 'cell' as a range)"
            )
        raise ConfigurationError(
            f"expected a value of each parameter ({', '.join(self.parameters)}) with every state, got "
            f"{states.parameter_count or 'none'}; give {{{self.parameters[0]}: …}} with the state"
        )

    def gather(self, states: MacroState) -> Array:
        """Return the inputs of n states, (n, d).

        Raises
        ------
        ConfigurationError
            The states have not the parameters of this space.
        """
        self.require_parameters(states)
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
        return replace(states, grad_u=back)

    def to_unit(self, x: Array) -> Array:
        """Return inputs (n, d) scaled by their ranges: the box becomes the unit box."""
        low, high = np.array(self.lower), np.array(self.upper)
        unit: Array = (x - low) / (high - low)
        return unit

    def scatter(self, x: npt.ArrayLike) -> MacroState:
        """Return n states from inputs (n, d), all other components zero."""
        rows: Array = np.atleast_2d(np.asarray(x, dtype=float))
        flat = np.zeros((len(rows), 10 + len(self.parameters)))
        flat[:, list(self.columns)] = rows
        theta = flat[:, 10:].copy() if self.parameters else None
        return MacroState(flat[:, :9].reshape(-1, 3, 3), flat[:, 9].copy(), theta)

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
        """Return the same for the ``components`` (10, n), or more rows with those of parameters."""
        rest = rows[[column for column in range(10) if column not in self.columns]]
        moves: npt.NDArray[np.bool_] = np.abs(rest, out=rest).max(axis=0, initial=0.0) > self.negligible
        return moves


def value_text(name: str, value: float, digits: int = 6) -> str:
    """Return the value of an input, with the study's unit if it is p."""
    return spoken().text(value, "pressure" if name == "p" else "", digits)


def components(states: MacroState) -> Array:
    """Return (10 + m, n): H row by row, then p and m parameters, each contiguous in memory."""
    rows, H = np.empty((10 + states.parameter_count, len(states))), states.grad_u.reshape(-1, 9)
    for i in range(9):
        rows[i] = H[:, i]
    rows[9] = states.p
    if states.parameters is not None:
        rows[10:] = states.parameters.T
    return rows


def flatten(states: MacroState) -> Array:
    """Return (n, 10 + m): H row by row, then p and m parameters."""
    more = [] if states.parameters is None else [states.parameters]
    return np.concatenate([states.grad_u.reshape(-1, 9), states.p[:, None], *more], axis=1)
