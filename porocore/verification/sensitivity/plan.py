"""Plan of a sensitivity study: loads, their goals and steps, the states of a load."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from porocore.core.inputs.input_space import NAMES
from porocore.core.models.bounds import MOST_POINTS, SMALLEST_INTERVAL
from porocore.errors import ConfigurationError
from porocore.states import MacroState

#: The loads of Dehghani & Zilian, section "RVE numerical tests", and the components of (H, p) that each moves alike.
LOADS: dict[str, tuple[str, ...]] = {
    "uniaxial": ("H11",),
    "volumetric": ("H11", "H22", "H33"),
    "shear": ("H12",),
    "pressure": ("p",),
}


def load_quantity(load: str) -> str:
    """Return the quantity of a load's values for their unit; '' is a plain number."""
    return "pressure" if LOADS[load] == ("p",) else ""


@dataclass(frozen=True)
class Sweep:
    """Goals of one load on both sides of zero, and its largest step.

    Attributes
    ----------
    lower, upper
        Goals, lower ≤ 0 ≤ upper; nothing is solved on the side of a goal that is 0. [–], for the pressure [E].
    step
        Between the states, where the cell can be solved.
    """

    lower: float
    upper: float
    step: float

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.lower, self.upper, self.step))):
            raise ConfigurationError(f"expected finite goals and a finite step of a load, got {self}")
        if not self.lower <= 0 <= self.upper or self.lower == self.upper:
            raise ConfigurationError(
                f"expected goals with lower ≤ 0 ≤ upper that are not both 0, got {self.lower:g} and {self.upper:g}"
            )
        if self.step <= 0:
            raise ConfigurationError(f"expected a positive step, got {self.step:g}")
        if (states := (self.upper - self.lower) / self.step) > MOST_POINTS:
            raise ConfigurationError(
                f"steps of {self.step:g} make {states:.3g} states; at most {MOST_POINTS} are solved: take larger ones"
            )


#: Beyond what the benchmark's cell can bear in compression, and far enough in the rest. Shear needs the whole cell.
SWEEPS: dict[str, Sweep] = {
    "uniaxial": Sweep(-0.9, 1.0, 0.05),
    "volumetric": Sweep(-0.9, 1.0, 0.05),
    "shear": Sweep(-1.0, 1.0, 0.1),
    "pressure": Sweep(-1.0, 1.0, 0.05),
}


@dataclass(frozen=True)
class StudyPlan:
    """Loads and their sweeps.

    Attributes
    ----------
    sweeps
        By the names of ``LOADS``.
    tolerance
        Width of the interval in which the end of what can be solved is found, of the pressure a multiple of E.
    """

    sweeps: Mapping[str, Sweep] = field(default_factory=lambda: dict(SWEEPS))
    tolerance: float = 0.01

    def __post_init__(self) -> None:
        if not self.sweeps:
            raise ConfigurationError(f"expected at least one load of {', '.join(LOADS)}, got none")
        for name in self.sweeps:
            if name not in LOADS:
                raise ConfigurationError(f"unknown load '{name}'; expected some of {', '.join(LOADS)}")
        if not SMALLEST_INTERVAL <= self.tolerance < math.inf:
            raise ConfigurationError(
                f"expected a tolerance of at least {SMALLEST_INTERVAL:g}, got {self.tolerance:g}"
            )

    def half_lines(self) -> Iterator[tuple[str, int, float]]:
        """Load, sign and goal of every half line; those on the whole cell, which take longest, first."""
        for name in sorted(self.sweeps, key=lambda name: name != "shear"):
            sweep = self.sweeps[name]
            for sign, goal in ((1, sweep.upper), (-1, sweep.lower)):
                if goal:
                    yield name, sign, goal

    def describe(self) -> dict[str, Any]:
        """Plain data, from which alone the states follow."""
        return {
            "sweeps": {name: asdict(self.sweeps[name]) for name in LOADS if name in self.sweeps},
            "tolerance": self.tolerance,
        }

    @classmethod
    def from_description(cls, described: Mapping[str, Any]) -> StudyPlan:
        """The inverse of :meth:`describe`."""
        sweeps = {name: Sweep(**sweep) for name, sweep in described["sweeps"].items()}
        return cls(sweeps, float(described["tolerance"]))


def states_of(load: str, values: Any) -> MacroState:
    """The states of n values of one load."""
    values = np.atleast_1d(np.asarray(values, dtype=float))
    rows = np.zeros((len(values), 10))
    rows[:, [NAMES.index(name) for name in LOADS[load]]] = values[:, None]
    return MacroState(rows[:, :9].reshape(-1, 3, 3), rows[:, 9].copy())
