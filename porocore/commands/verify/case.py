"""Case with a known answer (VerificationCase), its checks, relative error, observed order."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.plugins.kinds import Kind


@dataclass(frozen=True)
class Check:
    """One quantity held against what is known of it.

    Attributes
    ----------
    quantity
        In words.
    error
        What counts: relative to the reference where there is one, else as the quantity says.
    allowed
        Up to which it passes.
    reference, ours
        The numbers, where the quantity is one.
    order
        Observed order of convergence in the element size or in what the quantity names; None where one resolution
        is solved.
    note
        What should be known about the reference.
    """

    quantity: str
    error: float
    allowed: float
    reference: float | None = None
    ours: float | None = None
    order: float | None = None
    note: str = ""

    @property
    def passed(self) -> bool:
        """True if the error is finite and at most ``allowed``."""
        return math.isfinite(self.error) and self.error <= self.allowed


#: Solves an item with a backend's solver, in the long form or not.
Solve = Callable[[Any, bool], Sequence[Check]]


@dataclass(frozen=True)
class VerificationCase:
    """Something that is known, in items that are solved one by one.

    Attributes
    ----------
    name
        What the user writes.
    source
        Publication, or what the answer is known from.
    kind
        Which solver of a backend is asked.
    items
        By name; each takes a solver of that kind and whether the long form is wanted.
    """

    name: str
    source: str
    kind: Kind
    items: Mapping[str, Solve]


def relative_check(quantity: str, reference: float, ours: float, allowed: float, **more: Any) -> Check:
    """A number against its reference, with the relative error."""
    return Check(quantity, abs(ours / reference - 1), allowed, reference, ours, **more)


def observed_order(sizes: Sequence[float], values: Sequence[float], exact: float | None = None) -> float:
    """Slope of the logarithm of the error over that of the size, by least squares.

    Parameters
    ----------
    sizes
        Of the elements or the steps, descending.
    values
        One for each size.
    exact
        Without it the errors are the distances from the last value, which is left out.
    """
    known = np.asarray(values if exact is not None else values[:-1], dtype=float)
    errors = np.abs(known - (values[-1] if exact is None else exact))
    slope = np.polyfit(np.log(sizes[: len(errors)]), np.log(errors), 1)[0]
    return float(slope)
