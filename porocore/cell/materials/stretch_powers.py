"""Divided differences of powers of the squared stretches, exact for equal and nearly equal ones."""

from __future__ import annotations

import numpy as np

from porocore.states import Array

#: Below this |t| two terms of the series of sinh(kt)/sinh(t) are exact to round-off for |k| up to 100.
SMALL = 1e-5


def power_difference(log_x: Array, log_y: Array, k: float) -> Array:
    """Return (x^k − y^k)/(x − y), and k x^(k−1) where x = y, of positive numbers given by their logarithms.

    With t = (ln x − ln y)/2 it is (xy)^((k−1)/2) sinh(kt)/sinh(t), without a difference of nearly equal powers. The
    quotient is an even, smooth function of t, so round-off in t has no effect. Below |t| = 1e-5 its
    series k (1 + (k² − 1) t²/6) is summed instead.
    """
    t = (log_x - log_y) / 2
    small = np.abs(t) < SMALL
    safe = np.where(small, 1.0, t)
    quotient = np.where(small, k * (1 + (k * k - 1) / 6 * t * t), np.sinh(k * safe) / np.sinh(safe))
    return np.asarray(np.exp((k - 1) / 2 * (log_x + log_y)) * quotient)
