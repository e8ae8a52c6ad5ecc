"""Nodes of the unknowns of a cell, and matrices padded to all components of each node, for multigrid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.tetrahedra import EDGES
from porocore.states import Array, IntArray
from porocore_fem_skfem.factor import Indices
from porocore_fem_skfem.products import SparseMatrix, in_blocks


@dataclass(frozen=True, eq=False)
class NodeGrid:
    """The nodes of the unknowns, from which coarser levels are made.

    Attributes
    ----------
    points : (nodes, 3)
        Their places.
    ends : (nodes, 2)
        The corners halfway between which a node lies; a corner is both of its own.
    places : (n,)
        Node · components + component of each unknown.
    components
        3 for a displacement, 1 for a scalar.
    spans : (3,)
        Periods of the cell; infinite on the eighth.
    """

    points: Array
    ends: IntArray
    places: IntArray
    components: int
    spans: Array


def node_grid(mesh: CellMesh, places: IntArray, components: int) -> NodeGrid:
    """Return the nodes of unknowns on a mesh whose periodic nodes are merged."""
    nodes = mesh.periodic_class
    count = int(nodes.max()) + 1
    points = np.zeros((count, 3))
    points[nodes] = mesh.points
    ends = np.tile(np.arange(count)[:, None], (1, 2))
    if mesh.order == 2:
        cells = nodes[mesh.cells]
        for place, (a, b) in enumerate(EDGES, start=4):
            ends[cells[:, place]] = cells[:, [a, b]]
    spans = mesh.spans if mesh.domain == "whole" else np.full(3, np.inf)
    return NodeGrid(points, ends, places, components, spans)


class PaddedPattern:
    """Square matrices with all components of each node that has an unknown, node by node; those that are held have 1.

    Parameters
    ----------
    indptr, indices
        Upper triangle in CSR.
    grid
        Nodes of its unknowns.
    """

    def __init__(self, indptr: Indices, indices: Indices, grid: NodeGrid) -> None:
        b = grid.components
        used, node = np.unique(grid.places // b, return_inverse=True)
        self.used: IntArray = used
        self.places: IntArray = node.reshape(-1) * b + grid.places % b
        self.size = b * len(used)
        #: True where nothing is held at the nodes and the unknowns go node by node, so that nothing is to be padded.
        self._alike = np.array_equal(self.places, np.arange(self.size))
        self.free = np.zeros(self.size, dtype=bool)
        self.free[self.places] = True
        places, held = self.places.astype(np.int32), np.flatnonzero(~self.free).astype(np.int32)
        row = np.repeat(places, np.diff(indptr))
        column = places[indices]
        entry = np.arange(1, len(indices) + 1, dtype=np.int32)
        off = row != column
        rows = np.concatenate([row, column[off], held])
        columns = np.concatenate([column, row[off], held])
        entries = np.concatenate([entry, entry[off], np.full(len(held), len(indices) + 1, np.int32)])
        whole = sparse.csr_matrix((entries, (rows, columns)), shape=(self.size, self.size))
        #: Number of each entry, those of what is held last but one, and that of entries that vanish last.
        self._source = in_blocks(whole, b, b)
        self._source.data -= np.int32(1)

    def matrix(self, data: Array) -> SparseMatrix:
        """Return the symmetric matrix, in blocks of nodes, from the entries of its upper triangle."""
        known, source = np.append(data, [1.0, 0.0]), self._source
        return type(source)((known[source.data], source.indices, source.indptr), shape=source.shape)

    def padded(self, values: Array) -> Array:
        """Return values (size, ...) with zeros for what is held from those of the unknowns (n, ...)."""
        if self._alike:
            return values
        out = np.zeros((self.size, *values.shape[1:]))
        out[self.places] = values
        return out

    def unpadded(self, values: Array) -> Array:
        """Return the values of the unknowns (n, ...) from those with what is held (size, ...)."""
        return values if self._alike else np.asarray(values[self.places])
