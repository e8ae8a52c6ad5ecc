"""Numbers of unstable modes for each wave vector in {0, π}³, by negative pivots on the eighth.

Each wave vector has eight classes of perturbations (:func:`porocore.cell.symmetry.parity.bloch_classes`). Each class
has a tangent of the eighth with its own held displacements. By Sylvester's law their negative pivots add up to the
number of modes of that wave vector under which the energy falls.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from typing import TypeVar

from porocore.cell.equilibrium.discrete import DiscreteSolid, Iterate
from porocore.cell.symmetry.exchange import images
from porocore.cell.symmetry.parity import bloch_classes

Value = TypeVar("Value")
#: "110" is k = (π, π, 0), period two along x and y.
WAVES = tuple(bloch_classes())
#: Wave vectors that differ in the names of the axes only.
FAMILIES = {"0": ("000",), "100": ("100", "010", "001"), "110": ("110", "101", "011"), "111": ("111",)}
#: Free unknowns up to which the factors of all classes are kept for the next state, at about 6 kB an unknown.
KEPT = 10_000


def negative_pivots(solid: DiscreteSolid, iterate: Iterate, waves: Iterable[str] = WAVES) -> dict[str, int]:
    """Return the number of unstable modes of each wave vector; −1 where the solver cannot tell.

    The solid is that of the eighth, in equilibrium under a diagonal H.

    Raises
    ------
    FactorError
        A tangent cannot be factorised.
    """

    def count(parity: str) -> int:
        pivots = solid.negative_pivots(iterate, parity)
        if "|" in parity and len(iterate.residual) > KEPT:
            solid.release(parity)
        return pivots

    found = by_wave(waves, solid.exchanged_axes(iterate), count)
    return {wave: -1 if min(counts) < 0 else sum(counts) for wave, counts in found.items()}


def by_wave(
    waves: Iterable[str], swaps: Iterable[str], evaluate: Callable[[str], Value]
) -> dict[str, list[Value]]:
    """Return a value of each class of each wave vector; classes that ``swaps`` of axes map onto each other share it."""
    evaluated = cache(evaluate)
    return {
        wave: [evaluated(min(images(parity, swaps))) for parity in bloch_classes()[wave]] for wave in waves
    }
