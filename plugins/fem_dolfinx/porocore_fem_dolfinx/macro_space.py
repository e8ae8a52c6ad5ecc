"""The core's body as a dolfinx mesh: function spaces, and the core's number of each of their unknowns."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from porocore.errors import ConfigurationError
from porocore.macro.body.mesh import BodyMesh, ReferenceElement
from porocore.states import IntArray
from porocore_fem_dolfinx import compat, elements
from porocore_fem_dolfinx.types import FunctionSpace, Mesh


class MacroSpace:
    """Part of the discrete problem on one process of a communicator, over all of which the core's mesh is distributed.

    Local unknowns are the owned displacements and pressures, then the copies of displacements and pressures.

    Attributes
    ----------
    element
        Reference element of the core's mesh.
    domain
        dolfinx mesh.
    cells : (elements,)
        Cells of this process.
    V, Q
        Spaces of the displacement and of the pressure.
    of_u, of_p : (n,)
        Local unknown of each value of a function in V and in Q.
    owned_u, owned_p : int
        Owned displacements and pressures.
    unknowns, elements
        Numbers in the core's order of the local unknowns and elements.
    dofs : (elements, 81 + 8, 30 + 4, 27 + 4 or 18 + 3)
        Local unknowns of each element, displacements by node.
    order : (q,)
        Number in dolfinx of each quadrature point, in the core's order.
    flat, revolved, depth
        As of :class:`~porocore.macro.body.mesh.BodyMesh`.

    Raises
    ------
    ConfigurationError
        There are more processes than the elements can be shared among.
    """

    def __init__(self, mesh: BodyMesh, comm: MPI.Intracomm) -> None:
        self.element = mesh.element
        cell, corners = mesh.element.shape, mesh.element.corners
        self.domain = domain = _domain(mesh, comm)
        count = domain.topology.index_map(mesh.element.dimension).size_local
        if min(comm.allgather(count)) == 0:
            raise ConfigurationError(
                f"macro.body: {len(mesh.cells)} elements are too few for {comm.size} processes; start fewer"
            )
        self.cells = np.arange(count)
        self.V = compat.function_space(domain, elements.lagrange_element(cell, 2, (3,)))
        self.Q = compat.function_space(domain, elements.lagrange_element(cell, 1))
        self._number_unknowns(mesh)
        u_cells = 3 * compat.cell_dofs(self.V.dofmap)[:count, :, None] + np.arange(3)
        p_cells = compat.cell_dofs(self.Q.dofmap)[:count]
        self.dofs = np.concatenate([self.of_u[u_cells.reshape(count, -1)], self.of_p[p_cells]], axis=1)
        middles = domain.geometry.x[compat.cell_nodes(domain)[:count, :corners]].mean(axis=1)
        theirs = cKDTree(mesh.points[mesh.cells[:, :corners]].mean(axis=1))
        self.elements = np.asarray(theirs.query(middles)[1], dtype=np.int64)
        self.order = _quadrature_order(mesh.element)
        self.flat, self.revolved, self.depth = mesh.flat, mesh.revolved, mesh.depth

    def _number_unknowns(self, mesh: BodyMesh) -> None:
        self.owned_u, copied_u = (3 * n for n in _sizes(self.V))
        self.owned_p, copied_p = _sizes(self.Q)
        owned = self.owned_u + self.owned_p
        self.of_u = np.concatenate([np.arange(self.owned_u), owned + np.arange(copied_u)])
        self.of_p = np.concatenate(
            [self.owned_u + np.arange(self.owned_p), owned + copied_u + np.arange(copied_p)]
        )
        self.unknowns = np.empty(owned + copied_u + copied_p, dtype=np.int64)
        nodes = mesh.node_at(self.V.tabulate_dof_coordinates())
        self.unknowns[self.of_u] = (3 * nodes[:, None] + np.arange(3)).ravel()
        p_nodes = mesh.node_at(self.Q.tabulate_dof_coordinates())
        self.unknowns[self.of_p] = mesh.n_u + np.searchsorted(mesh.p_nodes, p_nodes)


def _domain(mesh: BodyMesh, comm: MPI.Intracomm) -> Mesh:
    cell = mesh.element.shape
    # Straight elements are given by their corners, and their forms are simpler.
    points, nodes = (mesh.points[mesh.p_nodes], mesh.p_cells) if mesh.straight else (mesh.points, mesh.cells)
    nodes = nodes[:, compat.from_vtk(cell, nodes.shape[1])]
    points = points[:, : mesh.element.dimension]
    if comm.rank > 0:
        points, nodes = points[:0], nodes[:0]
    return compat.make_mesh(comm, cell, 1 if mesh.straight else 2, points, nodes)


def _sizes(space: FunctionSpace) -> tuple[int, int]:
    index_map = space.dofmap.index_map
    return index_map.size_local, index_map.num_ghosts


def _quadrature_order(element: ReferenceElement) -> IntArray:
    """Return the order of the points, which all elements share since corners are numbered alike."""
    theirs = elements.quadrature_points(element.shape, element.degree)
    ours = element.points[:, : element.dimension]
    distance = np.abs(theirs[None] - ours[:, None]).max(axis=2)
    assert distance.min(axis=1).max() < 1e-12
    return np.asarray(distance.argmin(axis=1))
