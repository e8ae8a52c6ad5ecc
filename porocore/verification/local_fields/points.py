"""Deformation, energy and stress at the quadrature points of the solid, from its displacement."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.materials.energy import StrainEnergy
from porocore.cell.meshing.mesh import CellMesh
from porocore.cell.meshing.mirror import unfold_displacement
from porocore.cell.meshing.quadrature import tetrahedron_rule
from porocore.cell.meshing.shape_functions import shape_functions
from porocore.core.tensors.cofactors import determinant
from porocore.interfaces.cell import CellField
from porocore.states import Array


@dataclass(frozen=True, eq=False)
class PointFields:
    """One state on the whole cell, or on the supercell; M elements with q quadrature points each.

    The points are those of the cell solvers, so that averages and extremes over them are the responses of the cell.

    Attributes
    ----------
    mesh
        Solid of the whole cell, N nodes.
    material
        Of the solid.
    grad_u : (3, 3)
        H.
    p : float
        Pore pressure [E].
    u : (N, 3)
        u¹ at the nodes.
    """

    mesh: CellMesh
    material: StrainEnergy
    grad_u: Array
    p: float
    u: Array

    @classmethod
    def from_cell_field(cls, cell: Cell, field: CellField) -> PointFields:
        """Return the fields of a cell solution; a field of the eighth is unfolded by its mirrors.

        Raises
        ------
        ValueError
            The field is of another mesh.
        """
        mesh = cell.make_mesh("solid", "whole")
        u = field.u
        if field.domain == "eighth":
            eighth = cell.make_mesh("solid", "eighth")
            u = unfold_displacement(eighth.points, u, mesh.points, mesh.sides)
        if u.shape != mesh.points.shape:
            raise ValueError(f"expected a field on {len(mesh.points)} nodes, got {len(u)}")
        return cls(mesh, cell.solid.on(mesh), field.grad_u, field.p, u)

    @cached_property
    def _kinematics(self) -> tuple[Array, Array]:
        points, weights = tetrahedron_rule(self.mesh.quadrature_degree)
        _, dN = shape_functions(points, self.mesh.cells.shape[1])
        jacobian = np.einsum("eai,qaj->eqij", self.mesh.points[self.mesh.cells], dN, optimize=True)
        volume = np.linalg.det(jacobian) * weights
        local = np.einsum("eai,qaj->eqij", self.u[self.mesh.cells], dN, optimize=True)
        return volume, local @ np.linalg.inv(jacobian)

    @property
    def volume(self) -> Array:
        """dV of each point, (M, q)."""
        return self._kinematics[0]

    @property
    def grad(self) -> Array:
        """∇u¹, (M, q, 3, 3), grad_ij = ∂u¹_i/∂Y_j [–]."""
        return self._kinematics[1]

    @cached_property
    def F(self) -> Array:
        """F = I + H + ∇u¹, (M, q, 3, 3)."""
        return np.asarray(np.eye(3) + self.grad_u + self.grad)

    @cached_property
    def J(self) -> Array:
        """det F, (M, q)."""
        return determinant(self.F)

    @cached_property
    def energy(self) -> Array:
        """Ψ, (M, q) [E]."""
        return self.material.energy_density(self.F)

    @cached_property
    def stress(self) -> Array:
        """P = ∂Ψ/∂F, (M, q, 3, 3), first Piola–Kirchhoff, tension positive [E]."""
        return self.material.stress(self.F)

    @cached_property
    def cauchy(self) -> Array:
        """σ = P Fᵀ/J, (M, q, 3, 3) [E]."""
        return np.asarray(self.stress @ self.F.swapaxes(-1, -2) / self.J[..., None, None])

    def mean(self, values: Array) -> Array:
        """<·>_s of values (M, q, …): their integral over the solid by the volume of the whole cell."""
        cells = int(np.prod(self.mesh.periods))
        return np.asarray(np.einsum("eq,eq...->...", self.volume, values) / cells)
