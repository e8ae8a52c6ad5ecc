"""The core's box as a dolfinx mesh: function spaces, and whose number each of their unknowns has in the core."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from porocore.errors import ConfigurationError
from porocore.macro.mesh import DEGREE, BoxMesh, gauss_points
from porocore_fem_dolfinx import compat

CELL = "hexahedron"


@dataclass(frozen=True, eq=False)
class Space:
    """What one process holds of the discrete problem.

    Local unknowns are the owned displacements and pressures, then the copies of displacements and pressures.

    Attributes
    ----------
    domain
        dolfinx mesh.
    cells : (elements,)
        Its cells that belong to this process.
    V, Q
        Spaces of the displacement and of the pressure.
    of_u, of_p : (n,)
        Local unknown of each value of a function in V and in Q.
    owned_u, owned_p : int
        Owned displacements and pressures.
    unknowns, elements
        Numbers in the core's order of the local unknowns and elements.
    dofs : (elements, 81 + 8)
        Local unknowns of each element, displacements by node.
    order : (27,)
        For each quadrature point of the core's order its number in dolfinx's.
    """

    domain: Any
    cells: Any
    V: Any
    Q: Any
    of_u: Any
    of_p: Any
    owned_u: int
    owned_p: int
    unknowns: Any
    elements: Any
    dofs: Any
    order: Any


def make_space(mesh: BoxMesh, comm: Any) -> Space:
    """Distribute the core's mesh over the processes.

    Raises
    ------
    ConfigurationError
        There are more processes than the elements can be shared among.
    """
    first = comm.rank == 0
    cells = mesh.p_cells[:, compat.from_vtk(CELL, 8)]
    domain = compat.make_mesh(
        comm, CELL, 1, mesh.points[mesh.p_nodes] if first else np.empty((0, 3)), cells if first else cells[:0]
    )
    count = domain.topology.index_map(3).size_local
    if min(comm.allgather(count)) == 0:
        raise ConfigurationError(
            f"macro.elements: {len(mesh.cells)} elements are too few for {comm.size} processes; start fewer"
        )
    V = compat.function_space(domain, compat.lagrange_element(CELL, 2, (3,)))
    Q = compat.function_space(domain, compat.lagrange_element(CELL, 1))
    owned_u, copied_u = (3 * n for n in _sizes(V))
    owned_p, copied_p = _sizes(Q)
    owned = owned_u + owned_p
    of_u = np.concatenate([np.arange(owned_u), owned + np.arange(copied_u)])
    of_p = np.concatenate([owned_u + np.arange(owned_p), owned + copied_u + np.arange(copied_p)])
    unknowns = np.empty(owned + copied_u + copied_p, dtype=np.int64)
    nodes = mesh.node_at(V.tabulate_dof_coordinates())
    unknowns[of_u] = (3 * nodes[:, None] + np.arange(3)).ravel()
    corners = mesh.node_at(Q.tabulate_dof_coordinates())
    unknowns[of_p] = mesh.n_u + np.searchsorted(mesh.p_nodes, corners)
    u_cells = 3 * compat.cell_dofs(V.dofmap)[:count, :, None] + np.arange(3)
    dofs = np.concatenate(
        [of_u[u_cells.reshape(count, 81)], of_p[compat.cell_dofs(Q.dofmap)[:count]]], axis=1
    )
    middles = domain.geometry.x[compat.geometry_dofs(domain)[:count]].mean(axis=1)
    return Space(
        domain,
        np.arange(count, dtype=np.int32),
        V,
        Q,
        of_u,
        of_p,
        owned_u,
        owned_p,
        unknowns,
        np.searchsorted(mesh.cells[:, 26], mesh.node_at(middles)),
        dofs,
        _quadrature_order(),
    )


def _sizes(space: Any) -> tuple[int, int]:
    index_map = space.dofmap.index_map
    return index_map.size_local, index_map.num_ghosts


def _quadrature_order() -> Any:
    """The elements lie along the axes, so it is the same in all."""
    theirs = compat.quadrature_points(CELL, DEGREE)
    distance = np.abs(theirs[None] - gauss_points()[:, None]).max(axis=2)
    return distance.argmin(axis=1)
