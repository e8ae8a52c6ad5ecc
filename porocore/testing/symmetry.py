"""The symmetries of the cube as matrices on the variables of a potential."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from porocore.states import Array
from porocore.surrogates.components import COMPONENT, PLACES


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
