"""Coarse levels of multigrid by smoothed aggregation: groups of nodes that move like rigid bodies.

A group's motions are known from the places of its nodes, so they are also right where it lies across the faces of a
periodic cell. Rotations about the middle of the cell, which are usual as near kernel, have a jump there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse

from porocore.states import Array, IntArray
from porocore_fem_skfem.products import SparseMatrix, in_blocks

#: Squared norms of a group's motions, of the largest, below which one depends on the others.
DEPENDENT = 1e-8


@dataclass(frozen=True, eq=False)
class Nodes:
    """Nodes of one level of multigrid.

    Attributes
    ----------
    points : (nodes, 3)
        Their places.
    motions : (nodes, b, m)
        Values of the b unknowns of a node in the m fields of least energy: six rigid motions about the node itself, or
        the constant for a scalar. Zero where an unknown is held.
    spans : (3,)
        Periods of the cell; infinite without them.
    """

    points: Array
    motions: Array
    spans: Array


def aggregated(matrix: SparseMatrix, nodes: Nodes) -> tuple[SparseMatrix, Nodes, npt.NDArray[np.bool_]]:
    """Return the prolongation from groups of nodes, the groups, and which of their unknowns take part (unknowns,).

    Nodes that share an entry of ``matrix`` are neighbours, whatever its value. The columns are orthonormal.
    """
    count, block, motions = nodes.motions.shape
    group = _groups(matrix, block)
    groups = int(group.max()) + 1
    first = np.zeros(groups, dtype=np.int64)
    first[group[::-1]] = np.arange(count)[::-1]
    away = nodes.points - nodes.points[first[group]]
    away = away - np.where(np.isfinite(nodes.spans), nodes.spans, 0.0) * np.round(away / nodes.spans)
    size = np.bincount(group, minlength=groups)[:, None]
    mean = np.stack([np.bincount(group, column, groups) for column in away.T], axis=1) / size
    fields = nodes.motions @ _about_another_point(away - mean[group]) if motions == 6 else nodes.motions
    products = fields.transpose(0, 2, 1) @ fields
    flat = products.reshape(count, -1)
    gram = np.stack([np.bincount(group, column, groups) for column in flat.T], axis=1)
    values, vectors = np.linalg.eigh(gram.reshape(groups, motions, motions))
    kept = values > DEPENDENT * np.maximum(values[:, -1:], np.finfo(float).tiny)
    roots = np.sqrt(np.where(kept, values, 1.0))
    fields = fields @ (vectors * (kept / roots)[:, None, :])[group]
    blocks = sparse.bsr_matrix((fields, group, np.arange(count + 1)), shape=(count * block, groups * motions))
    of_groups = (kept * roots)[:, :, None] * vectors.transpose(0, 2, 1)
    return (
        in_blocks(blocks, block, motions),
        Nodes(nodes.points[first] + mean, of_groups, nodes.spans),
        kept.ravel(),
    )


def _groups(matrix: SparseMatrix, block: int) -> IntArray:
    """Return the number of each node's group; a node without neighbours is a group of its own."""
    from pyamg.aggregation import standard_aggregation

    blocks = matrix.tobsr(blocksize=(block, block))
    count = matrix.shape[0] // block
    graph = sparse.csr_matrix(
        (np.ones(len(blocks.indices)), blocks.indices, blocks.indptr), shape=(count, count)
    )
    found = standard_aggregation(graph)[0]
    group, alone = np.full(count, -1, dtype=np.int64), np.diff(found.indptr) == 0
    group[~alone] = found.indices
    group[alone] = found.shape[1] + np.arange(int(alone.sum()))
    return group


def _about_another_point(away: Array) -> Array:
    """Return the maps (k, 6, 6) of a rigid motion about a point to that about a point ``away`` (k, 3) from it."""
    maps = np.tile(np.eye(6), (len(away), 1, 1))
    x, y, z = away.T
    maps[:, 0, 4], maps[:, 0, 5] = z, -y
    maps[:, 1, 3], maps[:, 1, 5] = -z, x
    maps[:, 2, 3], maps[:, 2, 4] = y, -x
    return maps
