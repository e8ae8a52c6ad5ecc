"""Terms in which the potential is a polynomial: the variables themselves, or combinations with the cell's symmetry.

The variables y are the six components of L = ln U (11, 22, 33, 23, 13, 12) and the pressure p.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.states import Array
from porocore.surrogates.monomials import IntArray, Polynomial, exponents_up_to

#: Number of variables: six components of L, and p.
VARIABLES = 7


@dataclass(frozen=True, eq=False)
class Terms:
    """A set of terms t(y), each a polynomial with a weight, the degree that it counts as.

    Attributes
    ----------
    name
        ``plain`` or ``cubic``.
    polynomial
        y → t.
    weights
        One for each term.
    once
        Terms of which a monomial may hold one only: the states tell slopes in their direction, and no more.
    """

    name: str
    polynomial: Polynomial
    weights: tuple[int, ...]
    once: tuple[int, ...] = ()

    def monomials(self, lowest: int, highest: int) -> IntArray:
        """Exponents (K, k) of all monomials of weight ``lowest`` … ``highest``."""
        exponents = exponents_up_to(self.weights, lowest, highest)
        kept: IntArray = exponents[exponents[:, list(self.once)].sum(axis=1) <= 1]
        return kept

    @property
    def variables(self) -> tuple[int, ...]:
        """Of ``plain``: which of y they are."""
        return tuple(int(np.argmax(e)) for e in self.polynomial.exponents)

    def rows_of(self, others: Terms) -> tuple[int, ...] | None:
        """Which of these terms the ``others`` are; None if some are not among them."""
        known = [_described(self.polynomial, row) for row in range(len(self.weights))]
        wanted = [_described(others.polynomial, row) for row in range(len(others.weights))]
        return tuple(known.index(w) for w in wanted) if all(w in known for w in wanted) else None

    def subset(self, rows: tuple[int, ...]) -> Terms:
        """Some of them; those of ``plain`` are then fewer variables."""
        coefficients = self.polynomial.coefficients[list(rows)]
        used = coefficients.any(axis=0)
        return Terms(
            self.name,
            Polynomial(self.polynomial.exponents[used], coefficients[:, used]),
            tuple(self.weights[row] for row in rows),
        )


def plain(active: tuple[int, ...], still: tuple[int, ...] = ()) -> Terms:
    """The variables in ``active`` themselves, and those in ``still``, which no state moves, once in a monomial."""
    both = active + still
    return Terms(
        "plain",
        Polynomial(np.eye(VARIABLES, dtype=np.int64)[list(both)], np.eye(len(both))),
        (1,) * len(both),
        tuple(range(len(active), len(both))),
    )


def cubic() -> Terms:
    """Combinations that every symmetry of the cube leaves alone, in which an invariant polynomial can be written.

    With s = (L_23², L_13², L_12²): ΣL_ii, ΣL_ii², Σs_i, ΣL_ii³, ΣL_ii s_i, L_23 L_13 L_12, ΣL_ii² s_i, Σs_i²,
    ΣL_ii s_i² and p.
    """
    rows: list[dict[tuple[int, ...], float]] = [
        {_power(i, 1): 1.0 for i in range(3)},
        {_power(i, 2): 1.0 for i in range(3)},
        {_power(i + 3, 2): 1.0 for i in range(3)},
        {_power(i, 3): 1.0 for i in range(3)},
        {_join(_power(i, 1), _power(i + 3, 2)): 1.0 for i in range(3)},
        {(0, 0, 0, 1, 1, 1, 0): 1.0},
        {_join(_power(i, 2), _power(i + 3, 2)): 1.0 for i in range(3)},
        {_power(i + 3, 4): 1.0 for i in range(3)},
        {_join(_power(i, 1), _power(i + 3, 4)): 1.0 for i in range(3)},
        {_power(6, 1): 1.0},
    ]
    exponents = sorted({e for row in rows for e in row})
    coefficients = np.array([[row.get(e, 0.0) for e in exponents] for row in rows])
    return Terms("cubic", Polynomial(np.array(exponents), coefficients), (1, 2, 2, 3, 3, 3, 4, 4, 5, 1))


def is_cubic(stiffness: Array, tolerance: float = 1e-6) -> bool:
    """Whether ∂P_E/∂H (3, 3, 3, 3) at rest has the symmetry of the cube, which the terms above then may assume."""
    scale = float(np.abs(stiffness).max())
    same = [
        [stiffness[i, i, i, i] for i in range(3)],
        [stiffness[i, i, j, j] for i in range(3) for j in range(3) if i != j],
        [stiffness[i, j, i, j] for i in range(3) for j in range(3) if i != j],
    ]
    rest = stiffness.copy()
    for i in range(3):
        for j in range(3):
            rest[i, i, j, j] = rest[i, j, i, j] = rest[i, j, j, i] = 0.0
    return bool(
        all(np.ptp(values) <= tolerance * scale for values in same)
        and np.abs(rest).max() <= tolerance * scale
    )


def _described(polynomial: Polynomial, row: int) -> dict[tuple[int, ...], float]:
    pairs = zip(polynomial.exponents, polynomial.coefficients[row], strict=True)
    return {tuple(int(x) for x in e): float(c) for e, c in pairs if c}


def _power(variable: int, exponent: int) -> tuple[int, ...]:
    return tuple(exponent if i == variable else 0 for i in range(VARIABLES))


def _join(*exponents: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(sum(e) for e in zip(*exponents, strict=True))
