"""Generated numpy functions of the value and the derivatives of a formula by its invariants."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from porocore.cell.invariants.formula import Formula, tree
from porocore.cell.materials.ramp import ramp, ramp_curvature, ramp_derivative

#: Limit on the operations of the first derivatives; the second ones have up to about thirty times as many.
MOST_OPERATIONS = 2000


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of W(I, parameters); each function takes the used invariants and all parameters and returns a list.

    Attributes
    ----------
    used
        Indices of the m invariants in the formula.
    value
        Values of W, (n,).
    first
        First derivatives, m of (n,) or numbers where constant.
    second
        First derivatives, then the second ones, row by row of the upper triangle.
    """

    used: tuple[int, ...]
    value: Callable[..., list[Any]]
    first: Callable[..., list[Any]]
    second: Callable[..., list[Any]]


def _absolute(x: Any) -> Any:
    """Return |x|; of a complex number with the sign of its real part, so that a complex step passes."""
    return np.where(np.real(x) < 0, -x, x) if np.iscomplexobj(x) else np.abs(x)


@lru_cache(maxsize=64)
def derivatives(formula: Formula) -> Derivatives:
    """Return the derivatives of a formula; each formula is differentiated once.

    Raises
    ------
    ValueError
        The text is no energy, or its derivatives are too long.
    """
    import sympy  # a third of a second, and few need it

    energy, symbols, constants = tree(formula)
    used = tuple(i for i, s in enumerate(symbols) if energy.has(s))
    if not used:
        raise ValueError(f"'{formula.text}' holds no invariant of the deformation")
    own = [symbols[i] for i in used]
    first = [sympy.diff(energy, s) for s in own]
    size = sum(int(part.count_ops()) for part in first)
    if size > MOST_OPERATIONS:
        raise ValueError(
            f"the first derivatives of the energy take {size} operations, and at most {MOST_OPERATIONS} are generated; "
            "write it with fewer factors and less nesting"
        )
    second = [sympy.diff(first[i], own[j]) for i in range(len(own)) for j in range(i, len(own))]

    def generate(parts: Sequence[Any]) -> Callable[..., list[Any]]:
        functions = {
            "ramp": ramp,
            "ramp_derivative": ramp_derivative,
            "ramp_curvature": ramp_curvature,
            "abs": _absolute,
        }
        modules: list[Any] = [functions, "numpy"]
        return sympy.lambdify([*own, *constants], list(parts), modules=modules, cse=True)  # type: ignore[no-any-return]

    return Derivatives(used, generate([energy]), generate(first), generate([*first, *second]))
