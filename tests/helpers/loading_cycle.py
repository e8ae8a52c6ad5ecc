"""The work that a closed loading cycle does on a macroscopic law: none, if the law has a potential."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from porocore.interfaces.law import LawMemory
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.states import Array, MacroState

#: H (3, 3) and p at an angle between 0 and 2π, and their derivatives with respect to it.
Cycle = Callable[[float], tuple[Array, float, Array, float]]


def elliptic_cycle(
    middle: tuple[Array, float], one: tuple[Array, float], other: tuple[Array, float]
) -> Cycle:
    """(H, p) = middle + one · cos s + other · sin s; each is a pair of H (3, 3) and p."""

    def at(s: float) -> tuple[Array, float, Array, float]:
        c, d = np.cos(s), np.sin(s)
        (H0, p0), (H1, p1), (H2, p2) = middle, one, other
        return H0 + H1 * c + H2 * d, p0 + p1 * c + p2 * d, H2 * c - H1 * d, p2 * c - p1 * d

    return at


def work_over_cycle(law: ClosedLaw, cycle: Cycle, steps: int = 128) -> float:
    """∮ P_E:dH + p dφ, which is ∮ P_E:dH − φ dp wherever φ comes back to where it began [E].

    dφ is the rate of the law's storage at the state itself. The trapezoidal rule on a smooth cycle converges faster
    than any power of ``steps``.
    """
    points = [cycle(2 * np.pi * k / steps) for k in range(steps)]
    H, p, H_s, p_s = (np.array(column) for column in zip(*points, strict=True))
    states = MacroState(H, p)
    memory: LawMemory = law.closure.memory(states, law.cell_law.predict(states), np.zeros(steps))
    response = law.respond(states, np.zeros((steps, 3)), memory)
    tangent = response.tangent
    assert tangent is not None
    stored = np.einsum("nij,nij->n", tangent.storage_grad_u, H_s) + tangent.storage_p * p_s
    power = np.einsum("nij,nij->n", response.stress, H_s) + p * stored
    return float(power.sum() * 2 * np.pi / steps)
