"""The symmetries of the cube as matrices on the variables of a potential, and how far a law is from having one."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations, product

import numpy as np
import numpy.typing as npt

from porocore.states import Array, CellResponse, MacroState
from porocore.surrogates.stretch import COMPONENT, PLACES


def cube_group(active: tuple[int, ...]) -> Array:
    """Matrices (g, d, d) by which the cube's symmetries act on the active ones of (L_11 … L_12, p).

    Permutations of the axes and changes of their signs; each action is listed once. Symmetries that would move
    an active variable to one that is not active are left out, so that the group is that of the problem.
    """
    found: dict[bytes, Array] = {}
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            Q = np.zeros((3, 3))
            for i in range(3):
                Q[i, order[i]] = signs[i]
            full = np.zeros((7, 7))
            full[6, 6] = 1.0
            for a, (i, j) in enumerate(PLACES):
                k, l = order[i], order[j]
                full[a, COMPONENT[k, l]] = signs[i] * signs[j]
            still = [v for v in range(7) if v not in active]
            if full[np.ix_(list(active), still)].any():
                continue
            small = full[np.ix_(list(active), list(active))]
            found.setdefault(small.tobytes(), small)
    return np.array(list(found.values()))


def symmetry_error(
    respond: Callable[[MacroState], CellResponse], states: MacroState, Q: npt.ArrayLike
) -> dict[str, float]:
    """Return by how much each response fails to turn with Q, as a share of its largest entry; 0 for a symmetric law.

    A law has the operation Q if W(Q F Qᵀ, p) = W(F, p), and the same of φ, and if stress, <∇u¹> and conductivity turn:
    P_E(Q F Qᵀ, p) = Q P_E(F, p) Qᵀ.

    Parameters
    ----------
    respond
        The law.
    states
        States (n) of the cell.
    Q : (3, 3)
        Signed permutation of the axes.
    """
    turn = np.asarray(Q, dtype=float)
    before = respond(states)
    after = respond(MacroState(turn @ states.grad_u @ turn.T, states.p))
    found = {}
    for name in ("potential", "fluid_volume", "stress", "mean_grad", "conductivity"):
        value, image = getattr(before, name), getattr(after, name)
        if value is not None:
            turned = turn @ value @ turn.T if value.ndim == 3 else value
            found[name] = float(np.abs(image - turned).max() / max(float(np.abs(value).max()), 1e-300))
    return found
