"""Closed form of the force on a confined layer after a sudden displacement, with compressible constituents."""

from __future__ import annotations

import numpy as np

from porocore.states import Array

#: Modes that are summed; the last one matters before T = 1e-5 alone.
MODES = 150


def excess_force(share: float, times: Array) -> Array:
    """Return by which share of its final value the force on a layer is larger, at times T = c_v t/h².

    The layer is drained on one face, and both faces have had their displacement since T = 0. With σ = C ε − α p the
    stress is the same everywhere, σ = C ε̄ − α p̄, and ∂p/∂t − r ∂p̄/∂t = c_v ∂²p/∂y² with p̄ the mean of p. Its modes
    cos(x y/h) − cos x have tan x = −x (1 − r)/r, so that x = n π where the constituents are incompressible, r = 1.

    Parameters
    ----------
    share
        r = (α²/C)/(1/M_B + α²/C), at most 1.
    times
        T > 0.
    """
    from scipy.optimize import brentq  # slow to import

    x = np.arange(1, MODES + 1) * np.pi
    if share < 1:

        def fault(x: float) -> float:
            return float(share * np.sin(x) + (1 - share) * x * np.cos(x))

        ends = [(n * np.pi - np.pi / 2, n * np.pi) for n in range(1, MODES + 1)]
        x = np.array([brentq(fault, *pair, xtol=1e-13) for pair in ends])
    cos2 = np.cos(x) ** 2
    weights = 2 * cos2 / (share + (1 - share) * cos2)
    return np.asarray(np.exp(-np.multiply.outer(times, x**2)) @ weights)


def relaxed(share: float, left: float) -> float | None:
    """Return the time T at which the force is within ``left`` of its final value; None if it begins within it.

    Parameters
    ----------
    share
        r as of :func:`excess_force`.
    left
        Share of the final force.
    """
    if share <= 0 or share / max(1 - share, 1e-300) <= left:
        return None

    def more(T: float) -> float:
        return float(excess_force(share, np.array([T]))[0]) - left

    from scipy.optimize import brentq

    low, high = 1e-5, 10.0
    return float(brentq(more, low, high, xtol=1e-12)) if more(low) > 0 else None
