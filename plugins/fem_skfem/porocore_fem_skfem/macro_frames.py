"""Rotation of element blocks into the frames of nodes on oblique surfaces."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from porocore.states import Array, IntArray

_I = np.arange(3)[:, None]


class Frames:
    """Rotation of the entries of elements that have nodes with frames of their own.

    Parameters
    ----------
    rotation
        Sparse (unknowns, unknowns), the components of each node among themselves.
    cells : (elements, a)
        Nodes of each element.
    """

    def __init__(self, rotation: sparse.csr_matrix, cells: IntArray) -> None:
        n = int(cells.max()) + 1
        node = np.arange(n)[:, None, None]
        rows, columns = (np.broadcast_to(3 * node + i, (n, 3, 3)).ravel() for i in (_I, _I.T))
        of_nodes = np.asarray(rotation[rows, columns]).reshape(n, 3, 3)
        oblique = (of_nodes != np.eye(3)).any(axis=(1, 2))
        self._elements = np.flatnonzero(oblique[cells].any(axis=1))
        #: (turned elements, a, 3, 3)
        self._of_nodes = of_nodes[cells[self._elements]]

    def turn(self, blocks: list[Array], part: slice) -> None:
        """Rotate, in place, the blocks of the elements in ``part``.

        These are (elements, ...) of (e, a, i, k, b), (e, a, i, c), (e, c, k, b) and (e, c, d), each made flat.
        """
        which = slice(*np.searchsorted(self._elements, [part.start, part.stop]))
        elements, Q = self._elements[which] - part.start, self._of_nodes[which]
        e, a = Q.shape[:2]
        if not e:
            return
        stiffness, by_p, by_u = (block[elements] for block in blocks[:3])
        stiffness = np.matmul(Q, stiffness.reshape(e, a, 3, 3 * a)).reshape(e, 3 * a, 3, a)
        blocks[0][elements] = _columns(Q, stiffness).reshape(e, -1)
        blocks[1][elements] = np.matmul(Q, by_p.reshape(e, a, 3, -1)).reshape(e, -1)
        blocks[2][elements] = _columns(Q, by_u.reshape(e, -1, 3, a)).reshape(e, -1)


def _columns(Q: Array, values: Array) -> Array:
    """Return Q_b applied to the components k of (e, rows, k, b)."""
    return np.asarray(np.einsum("ebkl,erlb->erkb", Q, values, optimize=True))
