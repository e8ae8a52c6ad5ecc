"""First and second derivatives of the contact energy by nodal positions and loads, in blocks.

The position of a node is x = F₀ X̃ + u, where X̃ is its place in the undeformed cell, periodic shift included. So one
gradient and one Hessian by positions give the derivatives by the unknowns u and by the load H.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.states import Array, IntArray


@dataclass(frozen=True, eq=False)
class Blocks:
    """Second derivatives by nodal positions, in m blocks of k nodes each.

    Attributes
    ----------
    nodes : (m, k)
        Nodes of the mesh; −1 for one without a displacement of its own.
    places : (m, k, 3)
        Undeformed places X̃.
    matrices : (m, 3k, 3k)
        ∂²E/∂x∂x, symmetric.
    """

    nodes: IntArray
    places: Array
    matrices: Array

    def load_change(self, n: int, dH: Array) -> Array:
        """Return ∂²E/∂u∂H : δH, (n nodes, 3)."""
        force = np.einsum("mab,mb->ma", self.matrices, self._moved(dH))
        return scatter(n, self.nodes, force.reshape(*self.nodes.shape, 3))

    def second(self, one: Array, other: Array) -> float:
        """Return δH : ∂²E/∂H∂H : δH' at fixed u."""
        return float(np.einsum("ma,mab,mb->", self._moved(one), self.matrices, self._moved(other)))

    def _moved(self, dH: Array) -> Array:
        return (self.places @ dH.T).reshape(len(self.nodes), 3 * self.nodes.shape[1])

    @cached_property
    def entries(self) -> tuple[IntArray, IntArray, Array]:
        """Rows, columns (unknown 3·node + i) and values of ∂²E/∂u∂u; entries at equal places add up."""
        m, k = self.nodes.shape
        dofs = (3 * self.nodes[:, :, None] + np.arange(3)).reshape(m, 3 * k)
        rows = np.repeat(dofs, 3 * k, axis=1).ravel()
        columns = np.tile(dofs, (1, 3 * k)).ravel()
        kept = (rows >= 0) & (columns >= 0)
        return rows[kept], columns[kept], self.matrices.ravel()[kept]


@dataclass(frozen=True, eq=False)
class Forces:
    """Energy and first derivatives of contact at one iterate.

    Attributes
    ----------
    energy : float
        Energy E.
    nodes : (m, k), places : (m, k, 3)
        See :class:`Blocks`.
    gradient : (m, k, 3)
        ∂E/∂x.
    share : float
        Share of the undeformed wall that is in contact.
    """

    energy: float
    nodes: IntArray
    places: Array
    gradient: Array
    share: float

    def by_displacement(self, n: int) -> Array:
        """Return ∂E/∂u, (n nodes, 3)."""
        return scatter(n, self.nodes, self.gradient)

    @property
    def by_load(self) -> Array:
        """∂E/∂H (3, 3) at fixed u, Σ f_i X̃_j."""
        return np.asarray(np.einsum("mki,mkj->ij", self.gradient, self.places))


def joined(parts: list[Blocks]) -> Blocks:
    """Return all blocks as one batch; smaller blocks are padded with zeros."""
    if len(parts) == 1:
        return parts[0]
    k = max(part.nodes.shape[1] for part in parts)
    nodes, places, matrices = [], [], []
    for part in parts:
        more = k - part.nodes.shape[1]
        nodes.append(np.pad(part.nodes, ((0, 0), (0, more)), constant_values=-1))
        places.append(np.pad(part.places, ((0, 0), (0, more), (0, 0))))
        matrices.append(np.pad(part.matrices, ((0, 0), (0, 3 * more), (0, 3 * more))))
    return Blocks(np.concatenate(nodes), np.concatenate(places), np.concatenate(matrices))


def scatter(n: int, nodes: IntArray, values: Array) -> Array:
    """Return values (m, k, 3) summed at their nodes (m, k), (n, 3); node −1 is left out."""
    own = nodes >= 0
    out = np.zeros((n, 3))
    np.add.at(out, nodes[own], values[own])
    return out
