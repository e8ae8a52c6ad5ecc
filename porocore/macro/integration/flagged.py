"""Message on flagged points where a macro run finds no solution."""

from __future__ import annotations

import numpy as np

from porocore.interfaces.law import LawMemory, MacroLaw
from porocore.macro.integration.discretisation import Discretisation
from porocore.states import Array, MacroState


def flagged(d: Discretisation, law: MacroLaw, memory: LawMemory, x: Array) -> str:
    """Return how many points are flagged at the unknowns ``x``, and why one of them is; empty where none is.

    It is the one with the largest displacement gradient, the same on all processes.
    """
    states, grad_p = d.states(x)
    outside = law.respond(states, grad_p, memory, tangent=False).outside_training_range
    count, points = (int(n) for n in d.communicator.sum(np.array([outside.sum(), len(outside)])))
    if not count:
        return ""
    size = np.where(outside, np.abs(states.grad_u).max(axis=(1, 2)), -1.0)
    largest = d.communicator.max(float(size.max(initial=-1.0)))
    # Of processes that have one as large, the first.
    own = float(size.max(initial=-1.0)) == largest
    first = -d.communicator.max(-float(d.communicator.rank) if own else -np.inf)
    row = np.zeros(10)
    if first == d.communicator.rank:
        worst = int(size.argmax())
        row = np.append(states.grad_u[worst].ravel(), states.p[worst])
    row = d.communicator.sum(row)
    (why,) = law.reasons(MacroState.single(row[:9].reshape(3, 3), float(row[9])))
    return f"; before it {count} of {points} points are flagged" + (why and f", one of them for {why}")
