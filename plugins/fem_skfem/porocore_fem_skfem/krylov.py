"""Flexible GMRES, which stands a preconditioner that is linear in single precision only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from porocore.states import Array

#: Iterations between two restarts.
RESTART = 80
#: A direction of which the second orthogonalisation leaves less than this share is round-off.
BREAKDOWN = 1e-14


@dataclass(frozen=True)
class IterationResult:
    """Solution of an iteration."""

    x: Array
    iterations: int
    reduction: float  #: of the residual, true at the end

    def reached(self, accuracy: float) -> bool:
        """Tell whether the true residual is as small as it was to be, but for round-off."""
        return bool(self.reduction <= 2 * accuracy)


def flexible_gmres(
    apply: Callable[[Array], Array],
    right: Array,
    precondition: Callable[[Array], Array],
    *,
    accuracy: float,
    limit: int,
) -> IterationResult:
    """Solve A x = ``right`` by GMRES, preconditioned from the right, orthogonalised twice [Saad 1993].

    Parameters
    ----------
    apply, precondition
        A, and an approximate inverse of it, which need not be quite the same at every call.
    accuracy
        Residual, as a share of the right-hand side, that ends the iteration.
    limit
        Iterations at most.
    """
    size = float(np.linalg.norm(right))
    x, r, count = np.zeros_like(right), right, 0
    if size == 0:
        return IterationResult(x, 0, 0.0)
    left = size
    while count < limit:
        change, steps = _cycle(apply, r, precondition, accuracy * size, min(RESTART, limit - count))
        count += steps
        x = x + change
        r = right - apply(x)
        before, left = left, float(np.linalg.norm(r))
        if not left > 1.5 * accuracy * size or not left < 0.9 * before:
            break
    return IterationResult(x, count, left / size if np.isfinite(left) else np.inf)


def _cycle(
    apply: Callable[[Array], Array],
    r: Array,
    precondition: Callable[[Array], Array],
    goal: float,
    steps: int,
) -> tuple[Array, int]:
    """Return the change of x after so many steps at most, and how many there were."""
    # Memory that is never written to is never taken.
    basis, z = np.empty((steps + 1, len(r))), np.empty((steps, len(r)))
    beta = float(np.linalg.norm(r))
    basis[0] = r / beta
    H = np.zeros((steps + 1, steps))
    y = np.zeros(0)
    for k in range(steps):
        z[k] = precondition(basis[k])
        w = apply(z[k])
        length = float(np.linalg.norm(w))
        for _ in range(2):
            share = basis[: k + 1] @ w
            w -= share @ basis[: k + 1]
            H[: k + 1, k] += share
        H[k + 1, k] = np.linalg.norm(w)
        if not np.isfinite(H[: k + 2, k]).all():
            return y @ z[:k], k
        e = np.zeros(k + 2)
        e[0] = beta
        y = np.linalg.lstsq(H[: k + 2, : k + 1], e, rcond=None)[0]
        left = float(np.linalg.norm(e - H[: k + 2, : k + 1] @ y))
        if left <= goal or H[k + 1, k] <= BREAKDOWN * length:
            return y @ z[: k + 1], k + 1
        basis[k + 1] = w / H[k + 1, k]
    return y @ z, steps
