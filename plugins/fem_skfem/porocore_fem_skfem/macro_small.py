"""Tangent of a small body, such as a column: summed straight into the equations; its factor is kept."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse

from porocore.cell.equilibrium.discrete import FactorError
from porocore.interfaces.law import MacroTangent
from porocore.macro.integration.discretisation import StepFailed
from porocore.macro.linear_systems.work import LinearWork
from porocore.states import Array, IntArray
from porocore_fem_skfem.factor import SingularError
from porocore_fem_skfem.linalg import superlu
from porocore_fem_skfem.macro_band import Band
from porocore_fem_skfem.macro_linear import NOT_HELD
from porocore_fem_skfem.macro_products import Products
from porocore_fem_skfem.macro_space import Shapes

#: Entries of all element matrices up to which a body is small: the pattern takes 40 bytes for each.
SMALL = 1_000_000
#: Half the width of a band up to which LAPACK's factor of the band is fastest: 1.0 ms for the column of 106 elements,
#: where PARDISO takes 1.4 ms and SuperLU 2.0 to 8 ms.
NARROW = 100


@dataclass(frozen=True, eq=False)
class SmallSystem:
    """Tangent of the equations, and of the prescribed unknowns that move.

    Attributes
    ----------
    tangent, dt
        From which it comes.
    free, moved : CSR
        Equations by their unknowns, and by prescribed unknowns.
    order
        Order of the equations in which the entries lie in a narrow band; None where they do not.
    """

    tangent: MacroTangent
    dt: float
    free: sparse.csr_matrix
    moved: sparse.csr_matrix
    order: Band | None

    def transposed(self) -> SmallSystem:
        """Return the transpose of the equations, in the same pattern; nothing that is prescribed moves in it."""
        free = self.free.T.tocsr()
        free.sort_indices()
        return SmallSystem(self.tangent, self.dt, free, sparse.csr_matrix(self.moved.shape), self.order)

    @cached_property
    def sizes(self) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
        """Magnitudes of the entries of :attr:`free` and :attr:`moved`."""
        return abs(self.free), abs(self.moved)

    @cached_property
    def factor(self) -> Any:
        """Factor with a method ``solve``.

        Raises
        ------
        FactorError
            The matrix is singular.
        """
        return superlu(self.free) if self.order is None else self.order.factor(self.free.data)

    def solve(self, right: Array, work: LinearWork) -> Array:
        """Return x with A x = ``right``; the factor is made at the first call.

        Raises
        ------
        StepFailed
            The matrix is singular or not finite.
        """
        began = perf_counter()
        try:
            if not (np.isfinite(self.free.data).all() and np.isfinite(right).all()):
                raise StepFailed("the tangent or the residual is not finite")
            known, factor = "factor" in self.__dict__, self.factor
            if not known:
                work.add_set_up(perf_counter() - began)
                began = perf_counter()
            x: Array = factor.solve(right)
            if not np.isfinite(x).all():
                raise SingularError("the tangent is singular")
        except FactorError as error:
            raise StepFailed(f"{error}: {NOT_HELD}") from error
        work.add_solve(0, perf_counter() - began)
        return x


class SmallTangent:
    """Integration of the tangent over all elements at once.

    A block of all element matrices is one product of two matrices: derivatives of the law (elements, points) by
    products of shape functions (points, pairs of nodes), see :class:`~porocore_fem_skfem.macro_products.Products`.

    A local unknown that is held at zero in every element, as across a confined column, takes no part; a system knows
    nothing of unknowns that are held.

    Parameters
    ----------
    shapes
        Shape functions.
    dofs : (elements, 3 a + c)
        Unknowns of each element, by component.
    equation : (unknowns,)
        Equation of each unknown, -1 where it is prescribed.
    held : (unknowns,) bool
        Unknowns that are zero at all times.
    """

    def __init__(
        self, shapes: Shapes, dofs: IntArray, equation: IntArray, held: npt.NDArray[np.bool_]
    ) -> None:
        self.held = held
        a = shapes.grad_u.shape[2]
        used = ~held[dofs].all(axis=0)
        nodes = [np.flatnonzero(part) for part in np.split(used[: 3 * a], 3)]
        corners = np.flatnonzero(used[3 * a :])
        self._products = Products(shapes, nodes, corners)
        parts = [dofs[:, i * a + part] for i, part in enumerate((*nodes, corners))]
        rows, columns = (np.concatenate(each) for each in zip(*self._products.places(parts), strict=True))
        n = int(equation.max(initial=-1)) + 1
        self._free = _Sum(equation[rows], equation[columns], (n, n))
        moved = np.where((equation < 0) & ~held, np.arange(len(equation)), -1)
        self._moved = _Sum(equation[rows], moved[columns], (n, len(equation)))
        band = Band(self._free.indices, self._free.indptr)
        self._band = band if band.width <= NARROW else None

    def system(self, tangent: MacroTangent, dt: float) -> SmallSystem:
        """Return the system of a step of length ``dt``."""
        entries = self._products.integrate(tangent, dt)
        return SmallSystem(tangent, dt, self._free.matrix(entries), self._moved.matrix(entries), self._band)


class _Sum:
    """Sum of element entries at (row, column) into sorted compressed rows; a negative index leaves one out."""

    def __init__(self, row: IntArray, column: IntArray, shape: tuple[int, int]) -> None:
        kept = np.flatnonzero((row >= 0) & (column >= 0))
        unique, slot = np.unique(row[kept] * shape[1] + column[kept], return_inverse=True)
        self._shape = shape
        self.indices = (unique % max(shape[1], 1)).astype(np.int32)
        self.indptr = np.searchsorted(unique // max(shape[1], 1), np.arange(shape[0] + 1)).astype(np.int32)
        order = np.argsort(slot.ravel(), kind="stable")
        starts = np.searchsorted(slot.ravel()[order], np.arange(len(unique) + 1))
        ones = np.ones(len(kept))
        self._sum = sparse.csr_matrix((ones, kept[order], starts), shape=(len(unique), len(row)))

    def matrix(self, entries: Array) -> sparse.csr_matrix:
        """Return the matrix in CSR."""
        data = self._sum @ entries.ravel()
        return sparse.csr_matrix((data, self.indices, self.indptr), shape=self._shape)
