"""Plan of a sensitivity study: loads, goals, quantities of the paper's figures, half lines."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from itertools import product
from typing import Any

import numpy as np

from porocore.core.inputs import NAMES
from porocore.core.models.bounds import MOST_POINTS, SMALLEST_INTERVAL
from porocore.core.tensors import determinant
from porocore.errors import ConfigurationError
from porocore.macro.laws.closure import ConductivityLaw, PulledBack
from porocore.states import Array, CellResponse, MacroState, Status

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


#: Of the largest K_ii: what is less is no conductivity but round-off, as across a single channel.
NO_FLOW = 1e-9
#: By the first part of a name; all others are plain numbers.
_WITH_UNIT = {"Q": "compliance", "biot": "stress"} | dict.fromkeys(
    ("avg_energy", "max_energy"), "energy-density"
)


def quantity_of(name: str) -> str:
    """Return the quantity of one of :func:`quantities` for its unit; '' is a plain number."""
    return _WITH_UNIT.get(name, _WITH_UNIT.get(name.partition("_")[0], ""))


def _by_component(name: str, tensors: Array) -> dict[str, Array]:
    """``name_ij…`` → (n,) of n tensors."""
    rows = tensors.reshape(len(tensors), -1)
    indices = product("123", repeat=tensors.ndim - 1)
    return {f"{name}_{''.join(ijkl)}": rows[:, k] for k, ijkl in enumerate(indices)}


def quantities(
    states: MacroState,
    response: CellResponse,
    porosity: float,
    conductivity: Array,
    law: ConductivityLaw = "piola-unrotated",
) -> dict[str, Array]:
    r"""Name → (n,), NaN where a state has no values, or the cell solver does not provide them.

    Definitions of Dehghani & Zilian (eqs. intavg_cell and intavg_domain): the "integral average" <·>_s is per
    volume of the whole cell, and the "average", written with a bar, is that of the solid, <·>_s/φ_s. Their figures of
    averages show the latter; Ĵ, the "RVE volumetric strain", is taken of it as well, like F̄.

    ==================  ==================================================================================
    ``mean_grad_ij``    <∂u¹_i/∂Y_j>_s [–]
    ``avg_grad_ij``     <∂u¹_i/∂Y_j>_s/φ_s, the average of the paper's figures [–]
    ``max_grad_ij``     largest \|∂u¹_i/∂Y_j\| in the solid [–]
    ``avg_energy``      <Ψ>_s/φ_s [E]
    ``max_energy``      largest Ψ [E]
    ``J_bar``           det F̄, F̄ = I + H + <∇u¹>_s/φ_s [–]
    ``J_hat``           Ĵ = det(I + <∇u¹>_s/φ_s) [–]
    ``Kt_ii``           (K_t)_ii/K_ii of K_t = K_ref/det F̄, K that of the undeformed cell and K_ref by the
                        conductivity law, for the paper Ḡ K F̄⁻ᵀ; NaN where K_ii = 0 [–]
    ``M_ijkl``          ∂<∂u¹_i/∂Y_j>_s/∂H_kl [–]
    ``M_hat_ijkl``      Ĵ M_ijkl [–]
    ``Q_ij``            ∂<∂u¹_i/∂Y_j>_s/∂p [1/E]
    ``Q_hat_ij``        Ĵ Q_ij [1/E]
    ``biot``            Biot modulus −1/tr Q [E]
    ``biot_hat``        −1/(Ĵ tr Q) [E]
    ==================  ==================================================================================

    Parameters
    ----------
    states, response
        n of them, with tangent; without extrema the maxima and the energy are NaN.
    porosity
        φ_f of the undeformed cell.
    conductivity : (3, 3)
        Of the undeformed cell.
    law
        Of the flux, by default the paper's.
    """
    assert response.tangent is not None
    assert response.tangent.mean_grad_grad_u is not None
    assert response.tangent.mean_grad_p is not None
    solid = 1 - porosity
    average = response.mean_grad / solid
    pulled = PulledBack.from_states(
        states,
        response.mean_grad,
        np.zeros((len(states), 3)),
        solid,
        conductivity,
        law,
        response.conductivity,
    )
    K_ii = np.diag(conductivity)
    K_ii = np.where(K_ii > NO_FLOW * K_ii.max(), K_ii, np.nan)
    normalised = np.diagonal(pulled.conductivity, axis1=1, axis2=2) / pulled.J[:, None] / K_ii
    J_hat = determinant(np.eye(3) + average)
    M, Q = response.tangent.mean_grad_grad_u, response.tangent.mean_grad_p
    biot = -1 / np.trace(Q, axis1=1, axis2=2)
    extrema, unknown = response.extrema, np.full(len(response), np.nan)
    largest = np.full_like(response.mean_grad, np.nan) if extrema is None else extrema.grad
    return {
        **_by_component("mean_grad", response.mean_grad),
        **_by_component("avg_grad", average),
        **_by_component("max_grad", largest),
        "avg_energy": unknown if extrema is None else extrema.energy_mean / solid,
        "max_energy": unknown if extrema is None else extrema.energy,
        "J_bar": pulled.J,
        "J_hat": J_hat,
        **{f"Kt_{i + 1}{i + 1}": normalised[:, i] for i in range(3)},
        **_by_component("M", M),
        **_by_component("M_hat", J_hat[:, None, None, None, None] * M),
        **_by_component("Q", Q),
        **_by_component("Q_hat", J_hat[:, None, None] * Q),
        "biot": biot,
        "biot_hat": biot / J_hat,
    }


@dataclass(frozen=True, eq=False)
class HalfLine:
    """n states in the order of their load, from the undeformed cell on.

    All have values but the last, where the load's goal was not reached: that one lies beyond the end of what can be
    solved, by no more than the tolerance of the plan.

    Attributes
    ----------
    load, sign
        Name of the load, and +1 or −1.
    values : (n,)
        Of the load, the first one 0.
    response : n rows
        With tangent and extrema.
    seconds : (n,)
        Wall time of each solve.
    """

    load: str
    sign: int
    values: Array
    response: CellResponse
    seconds: Array

    def __len__(self) -> int:
        return len(self.values)

    @property
    def end(self) -> Status | None:
        """Status that ended the line before its goal; None if the goal was reached."""
        last = Status(int(self.response.status[-1]))
        return None if last.has_values else last


def step_count(goal: float, step: float) -> int:
    """Return the number of equal steps from zero to the goal."""
    return max(1, math.ceil(abs(goal / step) - 1e-9))
