"""Names of tensor components, such as K₂₂: equal ones as one row, zero ones left out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from porocore.report.format import number
from porocore.states import Array

#: What is printed of a value.
Say = Callable[[float], str]

#: A component off the diagonal below this share of the two diagonal ones is zero up to the mesh.
NOTHING = 1e-3
_SUBSCRIPTS = "₁₂₃"
#: Pairs i ≠ j of a symmetric tensor.
PAIRS = ((0, 1), (0, 2), (1, 2))


def name_of(symbol: str, *axes: int) -> str:
    """Return the name of a component, such as ``K₂₂``, or ``C_eff,1122`` of the symbol ``C_eff,``."""
    digits = "123" if symbol.endswith(",") else _SUBSCRIPTS
    return symbol + "".join(digits[i] for i in axes)


def is_one(values: Sequence[float], say: Say = number) -> bool:
    """Tell whether values along the axes are the same in the digits that are printed."""
    return len({say(float(value)) for value in values}) == 1


def together(names: Sequence[str], values: Sequence[float], say: Say = number) -> Iterator[tuple[str, float]]:
    """Yield name and value of each component, or one row where all are printed as the same."""
    if is_one(values, say):
        yield " = ".join(names), float(values[0])
    else:
        yield from zip(names, map(float, values), strict=True)


def symmetric(symbol: str, tensor: Array, say: Say = number) -> Iterator[tuple[str, float]]:
    """Yield name and value of the components of a tensor (3, 3); those off the diagonal where they are not zero."""
    entries = np.diag(tensor)
    yield from together([name_of(symbol, i, i) for i in range(3)], list(entries), say)
    least = np.finfo(float).eps ** 0.5 * np.abs(entries).max()
    for i, j in PAIRS:
        value = float(tensor[i, j])
        if abs(value) > max(NOTHING * float(np.sqrt(abs(entries[i] * entries[j]))), least):
            yield name_of(symbol, i, j), value


def of_fourth_order(symbol: str, tensor: Array) -> Iterator[tuple[str, float]]:
    """Yield name and value of the components iiii and iijj of a tensor (3, 3, 3, 3), iijj of both signs of i − j."""
    yield from family(symbol, tensor, [(i, i, i, i) for i in range(3)])
    mixed = [(i, i, j, j) for i in (1, 0, 2) for j in range(3) if i != j]
    values = [float(tensor[at]) for at in mixed]
    if is_one(values):
        yield f"{name_of(symbol, *mixed[0])} and all other {symbol}_iijj", values[0]
    else:
        yield from zip([name_of(symbol, *at) for at in mixed], values, strict=True)


def family(
    symbol: str, tensor: Array, places: Sequence[tuple[int, ...]], say: Say = number
) -> Iterator[tuple[str, float]]:
    """Yield name and value of components of one kind."""
    yield from together([name_of(symbol, *at) for at in places], [float(tensor[at]) for at in places], say)
