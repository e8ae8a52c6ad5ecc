"""Deformation, energy and stress at quadrature points of the solid, and recovered at nodes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.materials.material import StrainEnergy
from porocore.cell.meshing.mesh import CellMesh, unfold_displacement
from porocore.cell.meshing.tetrahedra import shape_functions, tetrahedron_rule
from porocore.core.tensors import determinant
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


#: Nodes of a tetrahedron (VTK order) on the unit one.
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
MIDDLES = np.array(
    [[0.5, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0], [0, 0, 0.5], [0.5, 0, 0.5], [0, 0.5, 0.5]], dtype=float
)


@dataclass(frozen=True, eq=False)
class NodalFields:
    """Fields at the N nodes of the whole cell; each field recovered by :func:`recover_at_nodes`.

    Attributes
    ----------
    points
        Where it comes from.
    """

    points: PointFields

    @property
    def displacement(self) -> Array:
        """H X + u¹, (N, 3): to where a node moves, but for a translation."""
        return self.points.mesh.points @ self.points.grad_u.T + self.points.u

    @cached_property
    def grad(self) -> Array:
        """∇u¹, (N, 3, 3) [–]."""
        return recover_at_nodes(self.points, self.points.grad)

    @property
    def F(self) -> Array:
        """I + H + ∇u¹, (N, 3, 3)."""
        return np.asarray(np.eye(3) + self.points.grad_u + self.grad)

    @cached_property
    def J(self) -> Array:
        """det F, (N,)."""
        return recover_at_nodes(self.points, self.points.J)

    @cached_property
    def energy(self) -> Array:
        """Ψ, (N,) [E]."""
        return recover_at_nodes(self.points, self.points.energy)

    @cached_property
    def stress(self) -> Array:
        """First Piola–Kirchhoff stress P, (N, 3, 3) [E]."""
        return recover_at_nodes(self.points, self.points.stress)

    @cached_property
    def cauchy(self) -> Array:
        """σ, (N, 3, 3) [E]."""
        return recover_at_nodes(self.points, self.points.cauchy)

    @cached_property
    def von_mises(self) -> Array:
        """Von Mises stress of σ, (N,) [E]."""
        trace = np.trace(self.points.cauchy, axis1=-2, axis2=-1)
        deviator = self.points.cauchy - trace[..., None, None] / 3 * np.eye(3)
        return recover_at_nodes(self.points, np.sqrt(1.5 * (deviator**2).sum(axis=(-2, -1))))


def recover_at_nodes(points: PointFields, values: Array) -> Array:
    """Values (M, q, …) of the quadrature points at the nodes, (N, …).

    Extrapolated linearly from the quadrature points of each element, where a finite-element gradient is most accurate,
    to its nodes [Hinton & Campbell, Int. J. Numer. Meth. Eng. 8 (1974) 461–480]; averaged by volume over the elements
    that meet at a node or at its periodic images; and each component kept between the least and the largest of the
    values at the quadrature points of these elements, which at a crease it would otherwise exceed several times. So J
    stays positive, Ψ is nowhere negative, and no peak is higher than what the cell solver reports.
    """
    flat = values.reshape(*values.shape[:2], -1)
    mesh = points.mesh
    classes, count = mesh.periodic_class[mesh.cells], int(mesh.periodic_class.max()) + 1
    there = np.einsum("aq,eqc->eac", _extrapolation(points), flat).reshape(-1, flat.shape[2])
    weights = np.repeat(points.volume.sum(axis=1), mesh.cells.shape[1])
    total = np.bincount(classes.ravel(), weights, count)
    columns = [np.bincount(classes.ravel(), weights * column, count) / total for column in there.T]
    low, high = np.full((count, flat.shape[2]), np.inf), np.full((count, flat.shape[2]), -np.inf)
    np.minimum.at(low, classes, flat.min(axis=1)[:, None])
    np.maximum.at(high, classes, flat.max(axis=1)[:, None])
    merged = np.stack(columns, axis=1).clip(low, high)
    return np.asarray(merged[mesh.periodic_class].reshape(-1, *values.shape[2:]))


def _extrapolation(points: PointFields) -> Array:
    """(nodes of an element, q): from values at the quadrature points to the linear function through them."""
    mesh = points.mesh
    at, _ = tetrahedron_rule(mesh.quadrature_degree)
    nodes = CORNERS if mesh.order == 1 else np.concatenate([CORNERS, MIDDLES])
    if len(at) == 1:
        return np.ones((len(nodes), 1))
    linear, _ = shape_functions(at, 4)
    at_nodes, _ = shape_functions(nodes, 4)
    return np.asarray(at_nodes @ np.linalg.inv(linear))
