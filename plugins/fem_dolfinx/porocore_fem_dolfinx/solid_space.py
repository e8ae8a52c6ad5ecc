"""Function space of the solid's displacement: maps of nodes and dofs, free unknowns of a parity class."""

from __future__ import annotations

import numpy as np

from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.symmetry.parity import held_displacements
from porocore.states import Array
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.cell_mesh import CellDomain
from porocore_fem_dolfinx.condensation import Condensation


class SolidSpace:
    """Function space of u¹ on one mesh.

    Attributes
    ----------
    domain
        Mesh of the solid.
    functions
        Lagrange functions of the mesh's order.
    dof : (nodes,)
        Dof of each node of the mesh.
    """

    def __init__(self, mesh: CellMesh, degree: int) -> None:
        self.mesh, self.domain = mesh, CellDomain(mesh, degree)
        self.functions = self.domain.lagrange(mesh.order, (3,))
        self._cell_dofs = compat.cell_dofs(self.functions.dofmap)
        self._node = self.domain.nodes_of(self._cell_dofs)
        self.dof = np.argsort(self._node)
        self._free: dict[str, Condensation] = {}

    def to_nodes(self, u: Array) -> Array:
        """Return values (nodes, 3) in the order of the mesh from those at the dofs."""
        return u.reshape(-1, 3)[self.dof]

    def to_dofs(self, values: Array) -> Array:
        """Return values at the dofs, flat, from those (nodes, 3) in the order of the mesh."""
        return np.ascontiguousarray(values[self._node]).ravel()

    def integral(self, values: Array) -> Array:
        """Return the integral over the domain of values (cells, q, ...)."""
        return np.tensordot(self.domain.weights, values, axes=2)

    def nodal_sums(self, stress: Array) -> Array:
        """Return, at each dof, the sum over its elements of the forces of a stress of the size (cells, q)."""
        # ∇N is about the inverse of the length of an element.
        length = np.cbrt(6 * self.domain.weights.sum(axis=1))
        forces = np.repeat((stress * self.domain.weights).sum(axis=1) / length, 3 * len(self._cell_dofs[0]))
        dofs = 3 * self._cell_dofs[:, :, None] + np.arange(3)
        return np.bincount(dofs.ravel(), forces, minlength=3 * len(self._node)).astype(float)

    def free(self, parity: str) -> Condensation:
        """Return the free unknowns of a class of perturbations."""
        if parity not in self._free:
            images = 3 * self.mesh.periodic_class[self._node][:, None] + np.arange(3)
            held = held_displacements(self.mesh, parity)[self._node]
            self._free[parity] = Condensation(images.ravel(), held.ravel())
        return self._free[parity]

    def release(self, parity: str) -> None:
        """Free the memory of the unknowns of a class."""
        self._free.pop(parity, None)
