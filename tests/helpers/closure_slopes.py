"""Central differences of a closed law's responses, beside its tangent."""

from __future__ import annotations

import numpy as np

from porocore.interfaces.law import LawMemory
from porocore.macro.laws.macro_law import ClosedLaw
from porocore.states import MacroState

#: Arguments of a closed law, one component each: H, p and ∇p.
INPUTS = [("H", k) for k in range(9)] + [("p", 0)] + [("g", k) for k in range(3)]
_NAMES = {"H": "grad_u", "p": "p", "g": "grad_p"}
STEP = 1e-5


def assert_slopes(
    law: ClosedLaw, points: tuple[MacroState, np.ndarray, LawMemory], response: str, kind: str, k: int
) -> None:
    """Hold one column of the tangent of stress, storage or flux to central differences."""
    states, grad_p, memory = points

    def at(h: float) -> np.ndarray:
        H, p, g = states.grad_u.copy(), states.p.copy(), grad_p.copy()
        {"H": H.reshape(-1, 9), "p": p[:, None], "g": g}[kind][:, k] += h
        return getattr(law.respond(MacroState(H, p), g, memory, tangent=False), response)

    slope = (at(STEP) - at(-STEP)) / (2 * STEP)
    tangent, name = law.respond(states, grad_p, memory).tangent, f"{response}_{_NAMES[kind]}"
    exact = getattr(tangent, name)
    if exact is None:  # stress and storage do not depend on ∇p
        exact = np.zeros_like(slope)
    elif kind != "p":
        exact = exact.reshape(*slope.shape, -1)[..., k]
    np.testing.assert_allclose(exact, slope, rtol=1e-7, atol=1e-7)
