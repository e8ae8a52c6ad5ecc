"""A conductivity of the deformed pore in closed form, for training sets that have none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from porocore.states import MacroState

K0 = 2.0
EYE = np.eye(3)


def conductivity(states):
    """Made up: objective, and with the symmetry of the cube and no other."""
    F = EYE + states.grad_u
    C = F.swapaxes(1, 2) @ F
    E = (C - EYE) / 2
    size = np.exp(4 * np.trace(E, axis1=1, axis2=2) + states.p)[:, None, None]
    own = E * EYE  # the diagonal only, which no rotation but those of the cube leaves alone
    return K0 * size * (np.linalg.inv(C) + 1.5 * own + 2 * own @ own + states.p[:, None, None] * E)


def with_conductivity(data):
    rest = conductivity(MacroState.zeros(1))
    return replace(
        data,
        responses=replace(data.responses, conductivity=conductivity(data.states)),
        reference=replace(data.reference, conductivity=rest),
    )
