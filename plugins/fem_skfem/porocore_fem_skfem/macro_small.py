"""Tangent and band factor of a small body, such as a column: summed straight into the equations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.linalg import get_lapack_funcs
from scipy.sparse.csgraph import reverse_cuthill_mckee

from porocore.cell.equilibrium.discrete import FactorError
from porocore.interfaces.law import MacroTangent
from porocore.macro.integration.discretisation import StepFailed
from porocore.macro.linear_systems.work import LinearWork
from porocore.states import Array, IntArray
from porocore_fem_skfem.factor import SingularError
from porocore_fem_skfem.linalg import superlu
from porocore_fem_skfem.macro_linear import NOT_HELD
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
    order: _Band | None

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
        e, q, a, _ = shapes.grad_u.shape
        self.held = held
        used = ~held[dofs].all(axis=0)
        nodes = [np.flatnonzero(part) for part in np.split(used[: 3 * a], 3)]
        corners = np.flatnonzero(used[3 * a :])
        #: Where the unknowns of each component of u begin, and those of p.
        self._ends = [int(end) for end in np.cumsum([0, *map(len, nodes)])]
        w, g, gp = shapes.weights, shapes.grad_u, shapes.grad_p
        self._slopes = [np.ascontiguousarray(g[:, :, part].swapaxes(2, 3)) for part in nodes]
        by_grad = (g * w[:, :, None, None]).transpose(0, 2, 1, 3).reshape(e, a, 3 * q)
        self._by_grad = [np.ascontiguousarray(by_grad[:, part]) for part in nodes]
        self._p = np.ascontiguousarray(shapes.p[:, corners])
        self._p_slopes = np.ascontiguousarray(gp[:, :, corners].swapaxes(2, 3))
        N = np.broadcast_to(self._p.T[None, :, :, None], (e, len(corners), q, 1))
        by_p = np.concatenate([N, gp[:, :, corners].transpose(0, 2, 1, 3)], axis=3)
        self._by_p = np.ascontiguousarray(by_p * w[:, None, :, None]).reshape(e, -1, 4 * q)
        m = self._ends[3] + len(corners)
        self._stress_by = np.empty((e, q, 9, m))
        self._fluid_by = np.empty((e, q, 4, m))
        self._entries = np.empty((e, m, m))
        local = dofs[:, used]
        rows = np.broadcast_to(equation[local][:, :, None], (e, m, m)).ravel()
        columns = np.broadcast_to(local[:, None, :], (e, m, m)).ravel()
        n = int(equation.max(initial=-1)) + 1
        self._free = _Sum(rows, equation[columns], (n, n))
        moved = np.where((equation < 0) & ~held, np.arange(len(equation)), -1)
        self._moved = _Sum(rows, moved[columns], (n, len(equation)))
        band = _Band(self._free.indices, self._free.indptr)
        self._band = band if band.width <= NARROW else None

    def system(self, tangent: MacroTangent, dt: float) -> SmallSystem:
        """Return the system of a step of length ``dt``."""
        e, q = self._stress_by.shape[:2]
        n, entries = self._ends[3], self._entries
        by_H = np.ascontiguousarray(tangent.stress_grad_u.reshape(e, q, 3, 3, 3, 3).swapaxes(2, 3))
        by_H = by_H.reshape(e, q, 9, 3, 3)
        fluid_H = np.empty((e, q, 4, 3, 3))
        fluid_H[:, :, 0] = tangent.storage_grad_u.reshape(e, q, 3, 3)
        np.multiply(tangent.flux_grad_u.reshape(e, q, 3, 3, 3), -dt, out=fluid_H[:, :, 1:])
        for k, slopes in enumerate(self._slopes):
            columns = slice(self._ends[k], self._ends[k + 1])
            np.matmul(by_H[:, :, :, k], slopes, out=self._stress_by[..., columns])
            np.matmul(fluid_H[:, :, :, k], slopes, out=self._fluid_by[..., columns])
        stress_p = tangent.stress_p.reshape(e, q, 3, 3).swapaxes(2, 3).reshape(e, q, 9, 1)
        np.multiply(stress_p, self._p[:, None], out=self._stress_by[..., n:])
        fluid_p = np.concatenate([tangent.storage_p[:, None], -dt * tangent.flux_p], axis=1)
        np.multiply(fluid_p.reshape(e, q, 4, 1), self._p[:, None], out=self._fluid_by[..., n:])
        by_grad_p = (-dt * tangent.flux_grad_p).reshape(e, q, 3, 3)
        self._fluid_by[:, :, 1:, n:] += np.matmul(by_grad_p, self._p_slopes)
        # Rows (q, j) of each component i of the stress.
        stress_by = self._stress_by.reshape(e, 3 * q, 3, -1)
        for i, by_grad in enumerate(self._by_grad):
            np.matmul(by_grad, stress_by[:, :, i], out=entries[:, self._ends[i] : self._ends[i + 1]])
        np.matmul(self._by_p, self._fluid_by.reshape(e, 4 * q, -1), out=entries[:, n:])
        free, moved = self._free.matrix(entries), self._moved.matrix(entries)
        return SmallSystem(tangent, dt, free, moved, self._band)


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


class _Band:
    """Order of equations in which a matrix has a narrow band, and its factors by LAPACK.

    Attributes
    ----------
    width
        Number of diagonals on either side.
    """

    def __init__(self, indices: npt.NDArray[np.int32], indptr: npt.NDArray[np.int32]) -> None:
        n = len(indptr) - 1
        pattern = sparse.csr_matrix((np.ones(len(indices)), indices, indptr), shape=(n, n))
        self.order = reverse_cuthill_mckee(pattern, symmetric_mode=True)
        place = np.empty(n, dtype=np.int64)
        place[self.order] = np.arange(n)
        row, column = np.repeat(place, np.diff(indptr)), place[indices]
        self.width = int(np.abs(row - column).max(initial=0))
        #: LAPACK's storage, column after column, with room for the fill of row exchanges.
        self._shape = (3 * self.width + 1, n)
        self._places = column * self._shape[0] + 2 * self.width + row - column

    def factor(self, data: Array) -> _BandFactor:
        """Return the factor of the matrix with these entries, in the order of the pattern.

        Raises
        ------
        SingularError
            A pivot vanishes.
        """
        band = np.zeros(self._shape[0] * self._shape[1])
        band[self._places] = data
        band = band.reshape(self._shape, order="F")
        (factorise,) = get_lapack_funcs(("gbtrf",), (band,))
        factors, pivots, info = factorise(band, self.width, self.width, overwrite_ab=True)
        if info:
            raise SingularError("LAPACK: a pivot of the band vanished")
        return _BandFactor(self, factors, pivots)


class _BandFactor:
    def __init__(self, band: _Band, factors: Array, pivots: npt.NDArray[np.int32]) -> None:
        self._band, self._factors, self._pivots = band, factors, pivots

    def solve(self, right: Array) -> Array:
        """Return x with A x = ``right``."""
        (substitute,) = get_lapack_funcs(("gbtrs",), (self._factors,))
        width, order = self._band.width, self._band.order
        x = np.empty_like(right)
        x[order], _ = substitute(self._factors, width, width, right[order], self._pivots)
        return x
