"""Conductivity K and K_ref of the undeformed and the deformed pore (Pore); requirements on a cell."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.conductivity.extension import HarmonicExtension
from porocore.cell.conductivity.flow_slopes import flow_slopes
from porocore.cell.conductivity.fluid import DiscreteFluid
from porocore.cell.conductivity.wall_displacement import wall_interpolation
from porocore.cell.meshing.mesh import CellMesh, Domain
from porocore.cell.meshing.quadrature import tetrahedron_rule
from porocore.cell.meshing.tetrahedra import determinants
from porocore.errors import ConfigurationError, PorocoreError
from porocore.states import Array

#: Degree of the rule at whose points J of the fluid must be positive, that of the flow.
DEGREE = 4


@dataclass(frozen=True, eq=False)
class PoreMotion:
    """Slopes of the places of the nodes, and of u¹, by m parameters.

    Attributes
    ----------
    solid : (m, nodes of the solid, 3)
        Velocities of the undeformed solid.
    fluid : (m, nodes of the fluid, 3)
        Velocities of the undeformed fluid's quadratic mesh.
    displacement : (m, nodes of the solid, 3)
        Slopes of u¹ at the moving nodes.
    """

    solid: Array
    fluid: Array
    displacement: Array


class Pore:
    """Stokes flow through one cell, at rest and deformed, for unit viscosity, on the eighth or the whole cell.

    Parameters
    ----------
    fluid
        Discrete fluid.
    base
        Meshes of solid and fluid from which those of a member of a family were moved; None without a family.
    """

    def __init__(self, fluid: DiscreteFluid, base: tuple[CellMesh, CellMesh] | None = None) -> None:
        self.fluid, self._base = fluid, base
        self._extensions: dict[str, HarmonicExtension] = {}

    @cached_property
    def undeformed(self) -> Array:
        """K μ_f (3, 3) of the undeformed pore."""
        return self._of_cell(self.fluid.flow())

    def deformed(self, H: Array, u: Array, solid: CellMesh) -> tuple[Array, float]:
        """Return K_ref μ_f (3, 3) of the pore deformed by x = (I + H) Y + u¹, and the smallest J of the fluid's mesh.

        With k the conductivity of the deformed cell, the flux through reference area is q = −K_ref ∇_X p with::

            K_ref = J₀ F₀⁻¹ k F₀⁻ᵀ = F₀⁻¹ ∫ w^j_i dx F₀⁻ᵀ

        where F₀ = I + H, the cell's reference volume is 1 and its deformed volume J₀.

        Parameters
        ----------
        H : (3, 3)
            Macroscopic displacement gradient; diagonal on the eighth.
        u : (nodes, 3)
            u¹ on the solid.
        solid
            Mesh of the solid, of the same domain as the fluid's.

        Returns
        -------
        K : (3, 3)
            Symmetric; NaN where an element of the fluid is inverted, as where walls touch, or where the flow cannot
            be solved.
        smallest : float
            Smallest J at the points of the flow's quadrature; K has values where it is positive.
        """
        moved, smallest = self._moved(H, u, solid)
        if not smallest > 0:
            return np.full((3, 3), np.nan), smallest
        try:
            return self._pulled_back(H, self.fluid.flow(moved)), smallest
        except PorocoreError:
            return np.full((3, 3), np.nan), smallest

    def undeformed_slopes(self, velocities: Array) -> tuple[Array, Array]:
        """Return K μ_f (3, 3) and its slopes (3, 3, m) for velocities (m, nodes, 3) of the fluid's quadratic mesh."""
        mesh, flow = self.fluid.mesh, self.fluid.flow_fields()
        slopes = flow_slopes(mesh, mesh.points, flow, velocities, DEGREE)
        return self._of_cell(flow.integrals), self._of_cell(slopes)

    def deformed_slopes(
        self, H: Array, u: Array, solid: CellMesh, motion: PoreMotion
    ) -> tuple[Array, float, Array]:
        """Return K_ref μ_f, the smallest J and the slopes (3, 3, m) of K_ref μ_f by m parameters; see :meth:`deformed`.

        The slopes are NaN where K_ref is.
        """
        moved, smallest = self._moved(H, u, solid)
        missing = np.full((3, 3), np.nan), smallest, np.full((3, 3, len(motion.solid)), np.nan)
        if not smallest > 0:
            return missing
        try:
            flow = self.fluid.flow_fields(moved)
        except PorocoreError:
            return missing
        F0, extension = np.eye(3) + H, self._extension(solid)
        velocities = [
            V_fluid @ F0.T + extension.slope(u, u_slope, V_solid, V_fluid)
            for V_solid, V_fluid, u_slope in zip(motion.solid, motion.fluid, motion.displacement, strict=True)
        ]
        mesh, m = self.fluid.mesh, len(motion.solid)
        slopes = flow_slopes(mesh, moved, flow, np.reshape(velocities, (m, -1, 3)), DEGREE)
        return self._pulled_back(H, flow.integrals), smallest, self._pulled_back(H, slopes)

    def _extension(self, solid: CellMesh) -> HarmonicExtension:
        if solid.hash not in self._extensions:
            self._extensions = {solid.hash: HarmonicExtension(solid, self.fluid.mesh, self._base)}
        return self._extensions[solid.hash]

    def _moved(self, H: Array, u: Array, solid: CellMesh) -> tuple[Array, float]:
        """Return the places (nodes, 3) of the fluid's nodes, and the smallest J."""
        moved = self.fluid.mesh.points @ (np.eye(3) + H).T + self._extension(solid)(u)
        return moved, float((self._volume_elements(moved) / self._undeformed).min())

    def _pulled_back(self, H: Array, integrals: Array) -> Array:
        """Return the symmetric part of F₀⁻¹ I F₀⁻ᵀ of integrals I over the domain, (3, 3) or (3, 3, m)."""
        inverse = np.linalg.inv(np.eye(3) + H)
        K = np.einsum("ia,ab...,jb->ij...", inverse, self._of_cell(integrals), inverse)
        return np.asarray((K + K.swapaxes(0, 1)) / 2)

    def _volume_elements(self, points: Array) -> Array:
        """Return det ∂x/∂ξ (elements, q) for nodes at ``points``."""
        return determinants(points, self.fluid.mesh.cells, tetrahedron_rule(DEGREE)[0])

    @cached_property
    def _undeformed(self) -> Array:
        return self._volume_elements(self.fluid.mesh.points)

    def _of_cell(self, integrals: Array) -> Array:
        """Return integrals over the whole cell from those of the domain; the flow is odd or even under its mirrors."""
        if self.fluid.mesh.domain == "whole":
            return integrals
        return np.asarray(np.einsum("ij,ij...->ij...", 8 * np.eye(3), integrals))


def require_one_cell(cell: Cell) -> None:
    """Refuse a cell without pores, and a block of cells.

    Raises
    ------
    ConfigurationError
        No conductivity of a deformed pore belongs to it.
    """
    if cell.geometry.porosity == 0:
        raise ConfigurationError("conductivity: the cell has no pores; choose conductivity: piola")
    if cell.supercell != (1, 1, 1):
        raise ConfigurationError(
            "conductivity: the conductivity of the deformed pore is that of one cell, but cell.supercell has "
            "several; choose conductivity: piola, or cell.supercell: [1, 1, 1]"
        )


def require_one_wall(cell: Cell) -> None:
    """Refuse a cell whose two meshes approximate the pore wall too differently for one to follow the other.

    Raises
    ------
    ConfigurationError
        The wall of the fluid's mesh does not lie on that of the solid's.
    """
    domain: Domain = "eighth" if cell.mirrored else "whole"
    wall_interpolation(cell.make_mesh("solid", domain), cell.make_mesh("fluid", domain).quadratic)
