"""Points of a body (BodyPoints): the element of each, its coordinates there, interpolation, derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.spatial import cKDTree

from porocore.macro.body.mesh import BodyMesh, ReferenceElement
from porocore.states import Array, IntArray

#: How far outside its element a point may lie, in reference coordinates.
LEEWAY = 1e-6
#: A curved element may reach beyond the box of its nodes by this share of its size.
BEYOND_BOX = 0.1
#: Newton's steps for reference coordinates, the error that ends them as a share of the element, and coordinates that
#: are too far outside.
STEPS, CLOSE, FAR = 30, 1e-12, 5.0
#: Pairs of points and boxes that are compared at a time.
PAIRS = 4_000_000
#: Elements that are tried for a point outside the body, those whose middles are nearest.
NEAREST = 8


@dataclass(frozen=True, eq=False)
class BodyPoints:
    """Places in a body by their elements and reference coordinates.

    Attributes
    ----------
    mesh
        Of the body.
    positions : (nodes, 3)
        Places of its nodes, of the undeformed or a deformed body.
    cells : (n,)
        Element of each point; of one outside the body that which is nearest by its reference coordinates.
    local : (n, 3)
        Reference coordinates ξ there.
    beyond : (n,)
        How far outside its element each lies, in reference coordinates; at most :data:`LEEWAY` within the body.
    """

    mesh: BodyMesh
    positions: Array
    cells: IntArray
    local: Array
    beyond: Array

    @classmethod
    def at(
        cls, mesh: BodyMesh, places: Array, positions: Array | None = None, near: BodyPoints | None = None
    ) -> BodyPoints:
        """Return the points at some places.

        Parameters
        ----------
        mesh
            Of the body.
        places : (n, 3)
            Of the body whose nodes are at ``positions``.
        positions : (nodes, 3)
            Nodes of a deformed body; None: the undeformed one.
        near
            As many points in whose elements the places are looked for first.
        """
        positions = mesh.points if positions is None else positions
        n = len(places)
        cells, local, beyond = np.zeros(n, dtype=np.int64), np.zeros((n, 3)), np.full(n, np.inf)

        def take(rows: IntArray, tried: IntArray, start: Array | None = None) -> None:
            """Take the elements in which the places of these rows lie better than where they are known to lie."""
            found, out = _inverted(mesh.element, positions[mesh.cells[tried]], places[rows], start)
            # Of elements that share a place the first one counts.
            order = np.lexsort((tried, np.where(out <= LEEWAY, 0.0, out), rows))
            first = order[np.unique(rows[order], return_index=True)[1]]
            first = first[out[first] < beyond[rows[first]]]
            at = rows[first]
            cells[at], local[at], beyond[at] = tried[first], found[first], out[first]

        if near is not None and n:
            take(np.arange(n), near.cells, near.local)
        left = np.flatnonzero(beyond > LEEWAY)
        for rows, tried in _boxes(positions[mesh.cells], places, left):
            take(rows, tried)
        left = np.flatnonzero(beyond > LEEWAY)
        if len(left):
            tree = cKDTree(positions[mesh.cells].mean(axis=1))
            count = min(NEAREST, len(mesh.cells))
            close = np.asarray(tree.query(places[left], k=count)[1], dtype=np.int64).reshape(len(left), count)
            take(np.repeat(left, count), close.ravel())
        return cls(mesh, positions, cells, local, beyond)

    def __len__(self) -> int:
        return len(self.cells)

    def __getitem__(self, rows: Any) -> BodyPoints:
        return BodyPoints(self.mesh, self.positions, self.cells[rows], self.local[rows], self.beyond[rows])

    @property
    def inside(self) -> npt.NDArray[np.bool_]:
        """(n,) which of them lie within the body."""
        return self.beyond <= LEEWAY

    @cached_property
    def values(self) -> Array:
        """(n, nodes of an element) shape functions of the displacement."""
        return self.mesh.element.values(self.local)

    @cached_property
    def corner_values(self) -> Array:
        """(n, corners of an element) shape functions of the pressure."""
        return self.mesh.element.corner_values(self.local)

    @cached_property
    def gradients(self) -> Array:
        """(n, nodes of an element, 3) ∂N/∂x of the displacement's shape functions by the place x."""
        element = self.mesh.element
        by_local = element.gradients(self.local)
        jacobian = _jacobians(element, self.positions[self.mesh.cells[self.cells]], by_local)
        return np.asarray(by_local @ np.linalg.inv(jacobian))

    @property
    def corner_gradients(self) -> Array:
        """(n, corners of an element, 3) the same of the pressure's, which the displacement's can represent."""
        element = self.mesh.element
        at_nodes = element.corner_values(element.nodes)
        return np.asarray(np.einsum("naj,ac->ncj", self.gradients, at_nodes, optimize=True))

    def displacement(self, u: Array) -> Array:
        """Return a nodal vector field (nodes, 3) at the points, (n, 3)."""
        return np.asarray((self.values[:, None] @ u[self.mesh.cells[self.cells]])[:, 0])

    def displacement_gradient(self, u: Array) -> Array:
        """Return ∂u_i/∂x_j (n, 3, 3) of a nodal vector field (nodes, 3)."""
        at_nodes = u[self.mesh.cells[self.cells]]
        return np.asarray(at_nodes.swapaxes(1, 2) @ self.gradients)

    def pressure(self, p: Array) -> Array:
        """Return a field of the corners (p_nodes,) at the points, (n,)."""
        return np.asarray(np.einsum("nc,nc->n", self.corner_values, p[self.mesh.p_cells[self.cells]]))

    def pressure_gradient(self, p: Array) -> Array:
        """Return ∂p/∂x_j (n, 3) of a field of the corners (p_nodes,)."""
        return np.asarray(np.einsum("nc,ncj->nj", p[self.mesh.p_cells[self.cells]], self.corner_gradients))

    def rows(self, of_u: Array | None = None, of_p: Array | None = None) -> Any:
        """Return the sparse matrix (n, unknowns) of sums of the displacement and the pressure at each point.

        Parameters
        ----------
        of_u : (n, 3)
            Factors of u_1, u_2 and u_3; None: nothing.
        of_p : (n,)
            Factor of p; None: nothing.
        """
        n, mesh = len(self), self.mesh
        parts, columns = [np.zeros((n, 0))], [np.zeros((n, 0), dtype=np.int64)]
        if of_u is not None:
            count = 3 * mesh.cells.shape[1]
            parts.append((self.values[:, :, None] * of_u[:, None, :]).reshape(n, count))
            columns.append((3 * mesh.cells[self.cells][:, :, None] + np.arange(3)).reshape(n, count))
        if of_p is not None:
            parts.append(self.corner_values * of_p[:, None])
            columns.append(mesh.n_u + mesh.p_cells[self.cells])
        data, at = np.concatenate(parts, axis=1), np.concatenate(columns, axis=1)
        ends = np.arange(n + 1) * data.shape[1]
        found = sparse.csr_matrix((data.ravel(), at.ravel(), ends), shape=(n, mesh.size))
        found.eliminate_zeros()
        return found


def _boxes(nodes: Array, places: Array, left: IntArray) -> Any:
    """Yield rows of places, and elements in whose boxes (elements, nodes, 3) these lie."""
    first, last = nodes.min(axis=1), nodes.max(axis=1)
    margin = BEYOND_BOX * (last - first).max(axis=1, keepdims=True)
    first, last = first - margin, last + margin
    for part in np.array_split(left, -(-len(left) * len(nodes) // PAIRS)) if len(left) else ():
        here = np.ones((len(part), len(nodes)), dtype=bool)
        for axis in range(3):
            at = places[part, axis, None]
            here &= (at >= first[:, axis]) & (at <= last[:, axis])
        rows, tried = np.nonzero(here)
        if len(rows):
            yield part[rows], tried


def _inverted(
    element: ReferenceElement, nodes: Array, places: Array, start: Array | None
) -> tuple[Array, Array]:
    """Return reference coordinates (n, 3) of places in elements by Newton's method, and how far outside they are.

    Parameters
    ----------
    element
        Reference element.
    nodes : (n, nodes of an element, 3)
        Of the element of each place.
    places : (n, 3)
        See above.
    start : (n, 3)
        Where the method begins; None: in the middle.

    Returns
    -------
    local, beyond
        The latter is infinite where the method does not converge.
    """
    n = len(places)
    middle = element.nodes[: element.corners].mean(axis=0)
    local = np.tile(middle, (n, 1)) if start is None else start.copy()
    size = _sizes(nodes)
    going, beyond = np.arange(n), np.full(n, np.inf)
    for _ in range(STEPS):
        error = (element.values(local[going])[:, None] @ nodes[going])[:, 0] - places[going]
        if element.dimension == 2:
            error[:, 2] += size[going] * local[going, 2]
        done = np.abs(error).max(axis=1) < CLOSE * size[going]
        beyond[going[done]] = element.beyond(local[going[done]])
        going, error = going[~done], error[~done]
        if not len(going):
            break
        jacobian = _jacobians(element, nodes[going], element.gradients(local[going]))
        sound = np.abs(np.linalg.det(jacobian)) > 1e-14 * size[going] ** jacobian.shape[1]
        going, error, jacobian = going[sound], error[sound], jacobian[sound]
        local[going] -= np.linalg.solve(jacobian, error[:, :, None])[:, :, 0]
        going = going[np.abs(local[going]).max(axis=1, initial=0.0) <= FAR]
    return local, beyond


def _jacobians(element: ReferenceElement, nodes: Array, gradients: Array) -> Array:
    """Return ∂x_i/∂ξ_j (n, 3, 3); across an element of two dimensions ξ_3 is the place over the element's size."""
    found: Array = nodes.swapaxes(1, 2) @ gradients
    if element.dimension == 2:
        found[:, 2, 2] = _sizes(nodes)
    return found


def _sizes(nodes: Array) -> Array:
    """Return the longest edges (n,) of the boxes of elements by their nodes (n, nodes of an element, 3)."""
    return np.asarray(np.ptp(nodes, axis=1).max(axis=1))
