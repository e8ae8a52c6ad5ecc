"""Small macro problems (SmallSystem), whose tangent is a band or dense in products."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.linalg import get_lapack_funcs
from scipy.sparse.csgraph import reverse_cuthill_mckee

from porocore.cell.equilibrium.discrete import FactorError
from porocore.interfaces.law import MacroTangent
from porocore.macro.integration.discretisation import StepFailed
from porocore.macro.linear_systems import LinearWork
from porocore.states import Array, IntArray
from porocore_fem_skfem.factor import SingularError
from porocore_fem_skfem.linalg import superlu
from porocore_fem_skfem.macro_linear import NOT_HELD
from porocore_fem_skfem.macro_space import Shapes


class _Block(NamedTuple):
    """Part of all element matrices that comes from the same products.

    Each row of derivatives (elements, points) by the products gives the entries (elements, pairs) of one pair of kinds
    of unknowns; these are 0, 1, 2 for the components of u and 3 for p. Terms of derivatives that a law may leave out
    come last.
    """

    kinds: list[tuple[int, int]]  #: of each row
    width: int  #: pairs of nodes
    terms: list[tuple[str, slice, Array]]  #: kind of derivatives, which rows of them, and the products


class Products:
    """Products of shape functions at the points, by which derivatives of the law are integrated.

    In coordinates of the reference element they are the same for all elements; derivatives by H and ∇p are pulled back
    there. Where all elements are alike but for their place, as in a straight column, there is nothing to pull back.

    Parameters
    ----------
    shapes
        Shape functions.
    nodes
        Local nodes of each component of u that take part.
    corners
        Local corners whose p takes part.
    """

    def __init__(self, shapes: Shapes, nodes: Sequence[IntArray], corners: IntArray) -> None:
        self._e, self._q = e, q = shapes.weights.shape
        slopes, p_slopes, weights = shapes.slopes, shapes.corner_slopes, np.ones(q)
        #: Pull-back of two indices, (points, j l, J L), of one, (points, j, J), and of none, times the volume.
        self._pull: dict[str, Array] = {}
        if shapes.alike:
            slopes, p_slopes, weights = shapes.grad_u[0], shapes.grad_p[0], shapes.weights[0]
        else:
            w, X = shapes.weights.reshape(-1, 1, 1), shapes.inverse.reshape(-1, 3, 3)
            two = np.einsum("nJj,nLl->njlJL", w * X, X).reshape(-1, 9, 9)
            self._pull = {"two": two, "one": np.ascontiguousarray(w * X.swapaxes(1, 2)), "none": w}
        #: Components of u with the same nodes, one after the other, and the gradients there.
        together: dict[bytes, list[int]] = {}
        for i, part in enumerate(nodes):
            together.setdefault(part.tobytes(), []).append(i)
        groups = [(members, slopes[:, nodes[members[0]]]) for members in together.values()]
        self._order = [i for members, _ in groups for i in members]
        p, p_slopes = shapes.p[:, corners, None], p_slopes[:, corners]
        self._blocks = _blocks(groups, p, p_slopes, weights)
        pairs = [pair for block in self._blocks for pair in block.kinds if block.terms[0][0] == "two"]
        #: Components of the stress and of H by which it is derived, as the rows of the derivatives follow one another.
        self._pairs = [pair for pair in pairs if 3 not in pair]
        self._rows = {
            "two": np.empty((13, e * q, 9)),
            "one": np.empty((7, e * q, 3)),
            "none": np.empty((1, e * q, 1)),
        }
        self._pulled = {name: np.empty_like(self._rows[name]) for name in self._pull}
        self._entries = np.empty(e * sum(len(block.kinds) * block.width for block in self._blocks))

    def places(self, unknowns: Sequence[IntArray]) -> Iterator[tuple[IntArray, IntArray]]:
        """Return row and column of each entry, by blocks, from the unknowns (elements, n) of u_1, u_2, u_3 and p."""
        for block in self._blocks:
            for i, k in block.kinds:
                rows, columns = unknowns[i], unknowns[k]
                yield (
                    np.repeat(rows, columns.shape[1], axis=1).ravel(),
                    np.tile(columns, rows.shape[1]).ravel(),
                )

    def integrate(self, tangent: MacroTangent, dt: float) -> Array:
        """Return the entries of all element matrices, which the next call overwrites."""
        derivatives, first = self._derivatives(tangent, dt), 0
        for block in self._blocks:
            count = len(block.kinds) * self._e
            entries = self._entries[first : first + count * block.width].reshape(count, block.width)
            first += entries.size
            for number, (kind, rows, products) in enumerate(block.terms):
                if kind not in derivatives:
                    continue
                values = derivatives[kind][rows].reshape(count, -1)
                if number:
                    entries += values @ products
                else:
                    np.matmul(values, products, out=entries)
        return self._entries

    def _derivatives(self, tangent: MacroTangent, dt: float) -> dict[str, Array]:
        """Return the derivatives (rows, points, indices) that are integrated, by the number of indices of gradients.

        Those with two indices are of the stress by H, of the flux by H and of the flux by ∇p, those with one of the
        stress by p, of the storage by H and of the flux by p; that without is of the storage by p. Those of the stress
        and of the storage by ∇p, with two indices and one, are there where the law has them.
        """
        rows, n, order = self._rows, self._e * self._q, self._order
        stress, flux = tangent.stress_grad_u, tangent.flux_grad_u
        two = rows["two"].reshape(13, n, 3, 3)
        for row, (i, k) in zip(two, self._pairs, strict=False):
            row[:] = stress[:, i, :, k]
        for row, k in zip(two[9:], order, strict=False):
            np.multiply(flux[:, :, k], -dt, out=row)
        np.multiply(tangent.flux_grad_p, -dt, out=two[12])
        for i, k in enumerate(order):
            rows["one"][i], rows["one"][3 + i] = tangent.stress_p[:, k], tangent.storage_grad_u[:, k]
        np.multiply(tangent.flux_p, -dt, out=rows["one"][6])
        rows["none"][0, :, 0] = tangent.storage_p
        for name, by in self._pull.items():
            np.matmul(rows[name].swapaxes(0, 1), by, out=self._pulled[name].swapaxes(0, 1))
        found = dict(self._pulled if self._pull else rows)
        if tangent.stress_grad_p is not None:
            by_slope = np.stack([tangent.stress_grad_p[:, k] for k in order]).reshape(3, n, 9)
            found["stress by slope"] = self._pulled_back("two", by_slope)
        if tangent.storage_grad_p is not None:
            found["storage by slope"] = self._pulled_back("one", tangent.storage_grad_p[None])
        return found

    def _pulled_back(self, name: str, rows: Array) -> Array:
        """Return rows (r, points, indices) of derivatives in coordinates of the reference element."""
        if not self._pull:
            return rows
        return np.asarray(np.matmul(rows.swapaxes(0, 1), self._pull[name]).swapaxes(0, 1))


def _blocks(
    groups: Sequence[tuple[list[int], Array]], p: Array, p_slopes: Array, weights: Array
) -> list[_Block]:
    """Return the blocks of components with the same nodes, each with the gradients (q, a, 3) of these; then those of p.

    Shape functions of what an equation is tested with are multiplied by the ``weights`` (q,) of the points.
    """

    def product(test: Array, trial: Array) -> Array:
        """Return the products of (q, a, J) and (q, b, L) as a matrix (q J L, a b)."""
        (q, a, J), (_, b, L) = test.shape, trial.shape
        values = np.einsum("q,qaJ,qbL->qJLab", weights, test, trial, optimize=True)
        return np.ascontiguousarray(values.reshape(q * J * L, a * b))

    def block(kinds: list[tuple[int, int]], *terms: tuple[str, int, Array]) -> _Block:
        rows = [(kind, slice(first, first + len(kinds)), products) for kind, first, products in terms]
        return _Block(kinds, terms[0][2].shape[1], rows)

    blocks, at = [], 0
    for members, test in groups:
        for others, trial in groups:
            kinds = [(i, k) for i in members for k in others]
            blocks.append(block(kinds, ("two", at, product(test, trial))))
            at += len(kinds)
    at = 0
    for members, slopes in groups:
        stress = ("one", at, product(slopes, p)), ("stress by slope", at, product(slopes, p_slopes))
        blocks.append(block([(i, 3) for i in members], *stress))
        by_H = ("two", 9 + at, product(p_slopes, slopes)), ("one", 3 + at, product(p, slopes))
        blocks.append(block([(3, k) for k in members], *by_H))
        at += len(members)
    by_p = (
        ("one", 6, product(p_slopes, p)),
        ("none", 0, product(p, p)),
        ("storage by slope", 0, product(p, p_slopes)),
    )
    return [*blocks, block([(3, 3)], ("two", 12, product(p_slopes, p_slopes)), *by_p)]


class Band:
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
    def __init__(self, band: Band, factors: Array, pivots: npt.NDArray[np.int32]) -> None:
        self._band, self._factors, self._pivots = band, factors, pivots

    def solve(self, right: Array) -> Array:
        """Return x with A x = ``right``."""
        (substitute,) = get_lapack_funcs(("gbtrs",), (self._factors,))
        width, order = self._band.width, self._band.order
        x = np.empty_like(right)
        x[order], _ = substitute(self._factors, width, width, right[order], self._pivots)
        return x


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
    products of shape functions (points, pairs of nodes), see :class:`~porocore_fem_skfem.macro_small.Products`.

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
