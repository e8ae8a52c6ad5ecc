"""Products of shape functions, by which the tangent of all elements of a small body is integrated at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from porocore.interfaces.law import MacroTangent
from porocore.states import Array, IntArray
from porocore_fem_skfem.macro_space import Shapes


class _Block(NamedTuple):
    """Part of all element matrices that comes from the same products.

    Each row of derivatives (elements, points) by the products gives the entries (elements, pairs) of one pair of kinds
    of unknowns; these are 0, 1, 2 for the components of u and 3 for p.
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
                values = derivatives[kind][rows].reshape(count, -1)
                if number:
                    entries += values @ products
                else:
                    np.matmul(values, products, out=entries)
        return self._entries

    def _derivatives(self, tangent: MacroTangent, dt: float) -> dict[str, Array]:
        """Return the derivatives (rows, points, indices) that are integrated, by the number of indices of gradients.

        Those with two indices are of the stress by H, of the flux by H and of the flux by ∇p, those with one of the
        stress by p, of the storage by H and of the flux by p; that without is of the storage by p.
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
        return self._pulled if self._pull else rows


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
        blocks.append(block([(i, 3) for i in members], ("one", at, product(slopes, p))))
        by_H = ("two", 9 + at, product(p_slopes, slopes)), ("one", 3 + at, product(p, slopes))
        blocks.append(block([(3, k) for k in members], *by_H))
        at += len(members)
    by_p = ("one", 6, product(p_slopes, p)), ("none", 0, product(p, p))
    return [*blocks, block([(3, 3)], ("two", 12, product(p_slopes, p_slopes)), *by_p)]
