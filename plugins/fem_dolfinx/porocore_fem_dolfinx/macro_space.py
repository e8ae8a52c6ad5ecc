"""The core's body as a dolfinx mesh: function spaces, and the core's number of each of their unknowns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from porocore.errors import ConfigurationError
from porocore.macro.body.element import ReferenceElement
from porocore.macro.body.mesh import BodyMesh
from porocore.states import IntArray
from porocore_fem_dolfinx import compat, elements
from porocore_fem_dolfinx.types import FunctionSpace, Mesh


@dataclass(frozen=True, eq=False)
class MacroSpace:
    """Part of the discrete problem on one process.

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
    dofs : (elements, 81 + 8 or 30 + 4)
        Local unknowns of each element, displacements by node.
    order : (q,)
        Number in dolfinx of each quadrature point, in the core's order.
    """

    element: ReferenceElement
    domain: Mesh
    cells: IntArray
    V: FunctionSpace
    Q: FunctionSpace
    of_u: IntArray
    of_p: IntArray
    owned_u: int
    owned_p: int
    unknowns: IntArray
    elements: IntArray
    dofs: IntArray
    order: IntArray


def make_space(mesh: BodyMesh, comm: MPI.Intracomm) -> MacroSpace:
    """Return this process's part of the core's mesh, which is distributed over all.

    Raises
    ------
    ConfigurationError
        There are more processes than the elements can be shared among.
    """
    first, element = comm.rank == 0, mesh.element
    cell, corners = element.shape, element.corners
    # Straight elements are given by their corners, and their forms are simpler.
    points, nodes = (mesh.points[mesh.p_nodes], mesh.p_cells) if mesh.straight else (mesh.points, mesh.cells)
    nodes = nodes[:, compat.from_vtk(cell, nodes.shape[1])]
    domain = compat.make_mesh(
        comm,
        cell,
        1 if mesh.straight else 2,
        points if first else np.empty((0, 3)),
        nodes if first else nodes[:0],
    )
    count = domain.topology.index_map(3).size_local
    if min(comm.allgather(count)) == 0:
        raise ConfigurationError(
            f"macro.body: {len(mesh.cells)} elements are too few for {comm.size} processes; start fewer"
        )
    V = compat.function_space(domain, elements.lagrange_element(cell, 2, (3,)))
    Q = compat.function_space(domain, elements.lagrange_element(cell, 1))
    owned_u, copied_u = (3 * n for n in _sizes(V))
    owned_p, copied_p = _sizes(Q)
    owned = owned_u + owned_p
    of_u = np.concatenate([np.arange(owned_u), owned + np.arange(copied_u)])
    of_p = np.concatenate([owned_u + np.arange(owned_p), owned + copied_u + np.arange(copied_p)])
    unknowns = np.empty(owned + copied_u + copied_p, dtype=np.int64)
    nodes = mesh.node_at(V.tabulate_dof_coordinates())
    unknowns[of_u] = (3 * nodes[:, None] + np.arange(3)).ravel()
    p_nodes = mesh.node_at(Q.tabulate_dof_coordinates())
    unknowns[of_p] = mesh.n_u + np.searchsorted(mesh.p_nodes, p_nodes)
    u_cells = 3 * compat.cell_dofs(V.dofmap)[:count, :, None] + np.arange(3)
    dofs = np.concatenate(
        [of_u[u_cells.reshape(count, -1)], of_p[compat.cell_dofs(Q.dofmap)[:count]]], axis=1
    )
    middles = domain.geometry.x[compat.geometry_dofs(domain)[:count, :corners]].mean(axis=1)
    theirs = cKDTree(mesh.points[mesh.cells[:, :corners]].mean(axis=1))
    return MacroSpace(
        element,
        domain,
        np.arange(count),
        V,
        Q,
        of_u,
        of_p,
        owned_u,
        owned_p,
        unknowns,
        np.asarray(theirs.query(middles)[1], dtype=np.int64),
        dofs,
        _quadrature_order(element),
    )


def _sizes(space: FunctionSpace) -> tuple[int, int]:
    index_map = space.dofmap.index_map
    return index_map.size_local, index_map.num_ghosts


def _quadrature_order(element: ReferenceElement) -> IntArray:
    """Return the order of the points, which all elements share since corners are numbered alike."""
    theirs = elements.quadrature_points(element.shape, element.degree)
    distance = np.abs(theirs[None] - element.points[:, None]).max(axis=2)
    assert distance.min(axis=1).max() < 1e-12
    return np.asarray(distance.argmin(axis=1))
