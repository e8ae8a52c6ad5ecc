"""Derivatives of polynomials as rows over a basis of monomials (Rows), for sets of points or each one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from porocore.states import Array, IntArray
from porocore.surrogates.polynomial.monomials import Place

#: Number of a coefficient and of a monomial.
Term = tuple[int, int]


@dataclass(frozen=True, eq=False)
class RowGroup:
    """Rows with the same monomials.

    Attributes
    ----------
    rows
        Which of all rows.
    coefficient : (m, k)
        Numbers of the coefficients of the m rows.
    column : (k,)
        Numbers of the monomials.
    """

    rows: slice
    coefficient: IntArray
    column: IntArray


@dataclass(frozen=True, eq=False)
class Rows:
    """Derivatives as rows over a basis of monomials t^e/e!, of which those of one are others; rows that are not zero.

    Attributes
    ----------
    places
        Output and variables of each row.
    groups
        What the rows consist of.
    columns
        Monomials that the rows use, the first of the basis.
    """

    places: list[Place]
    groups: list[RowGroup]
    columns: int

    @classmethod
    def from_entries(cls, rows: Iterable[tuple[Place, list[Term]]]) -> Rows:
        """Return the rows with these places and terms."""
        together: dict[tuple[int, ...], list[tuple[Place, list[int]]]] = {}
        for place, terms in rows:
            if terms:
                own = tuple(column for _, column in terms)
                together.setdefault(own, []).append((place, [coefficient for coefficient, _ in terms]))
        places: list[Place] = []
        groups, columns = [], 0
        for own, members in together.items():
            first = len(places)
            places += [place for place, _ in members]
            coefficient = np.array([numbers for _, numbers in members], dtype=np.int64)
            groups.append(RowGroup(slice(first, len(places)), coefficient, np.array(own, dtype=np.int64)))
            columns = max(columns, max(own) + 1)
        return cls(places, groups, columns)

    @property
    def size(self) -> int:
        """Number of entries of the rows."""
        return len(self.places) * self.columns

    def matrices(self, coefficients: Array) -> Array:
        """Return the rows (sets, rows, columns) for coefficients (P, sets)."""
        found = np.zeros((coefficients.shape[1], len(self.places), self.columns))
        for group in self.groups:
            found[:, group.rows, group.column] = np.moveaxis(coefficients[group.coefficient], -1, 0)
        return found

    def fill(self, out: Array, coefficients: Array, monomials: Array) -> None:
        """Write the rows (rows, n) of points with coefficients (P, n) of their own into ``out``."""
        for group in self.groups:
            np.einsum(
                "rkn,kn->rn",
                coefficients[group.coefficient],
                monomials[group.column],
                out=out[group.rows],
            )
