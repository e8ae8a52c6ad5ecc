"""Conductivity K and K_ref of the undeformed and the deformed pore (Pore); requirements on a cell."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.conductivity.extension import HarmonicExtension
from porocore.cell.conductivity.fluid import DiscreteFluid
from porocore.cell.conductivity.wall_displacement import wall_interpolation
from porocore.cell.meshing.mesh import CellMesh, Domain
from porocore.cell.meshing.quadrature import tetrahedron_rule
from porocore.cell.meshing.tetrahedra import determinants
from porocore.errors import ConfigurationError, PorocoreError
from porocore.states import Array

#: Degree of the rule at whose points J of the fluid must be positive, that of the flow.
DEGREE = 4


class Pore:
    """Stokes flow through one cell, at rest and deformed, for unit viscosity, on the eighth or the whole cell."""

    def __init__(self, fluid: DiscreteFluid) -> None:
        self.fluid = fluid
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
        if solid.hash not in self._extensions:
            self._extensions = {solid.hash: HarmonicExtension(solid, self.fluid.mesh)}
        mesh, F0 = self.fluid.mesh, np.eye(3) + H
        moved = mesh.points @ F0.T + self._extensions[solid.hash](u)
        smallest = float((self._volume_elements(moved) / self._undeformed).min())
        if not smallest > 0:
            return np.full((3, 3), np.nan), smallest
        try:
            integrals = self.fluid.flow(moved)
        except PorocoreError:
            return np.full((3, 3), np.nan), smallest
        inverse = np.linalg.inv(F0)
        K: Array = inverse @ self._of_cell(integrals) @ inverse.T
        return (K + K.T) / 2, smallest

    def _volume_elements(self, points: Array) -> Array:
        """Return det ∂x/∂ξ (elements, q) for nodes at ``points``."""
        return determinants(points, self.fluid.mesh.cells, tetrahedron_rule(DEGREE)[0])

    @cached_property
    def _undeformed(self) -> Array:
        return self._volume_elements(self.fluid.mesh.points)

    def _of_cell(self, integrals: Array) -> Array:
        """Return integrals over the whole cell from those of the domain; the flow is odd or even under its mirrors."""
        return 8 * np.diag(np.diag(integrals)) if self.fluid.mesh.domain == "eighth" else integrals


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
