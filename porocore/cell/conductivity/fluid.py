"""What a finite element library contributes to the fluid cell problem: Stokes flow through a mesh that may be moved."""

from __future__ import annotations

from abc import ABC, abstractmethod

from porocore.cell.meshing.mesh import CellMesh
from porocore.states import Array


class DiscreteFluid(ABC):
    """Stokes flow of unit viscosity on one mesh of the fluid, with quadratic velocity and linear pressure.

    On the mesh moved by x(Y), with F = ∂x/∂Y and J = det F, the weak form for the unit force e_j is::

        ∫ J (∇w F⁻¹):(∇v F⁻¹) − q J F⁻ᵀ:∇v − s J F⁻ᵀ:∇w dY = ∫ J v_j dY

    for all v, s periodic in Y; w vanishes on the wall. x is quadratic in each element like Y itself, so this is the
    integral of the undeformed cell with x in the place of Y, and the undeformed cell is the case x = Y.

    Attributes
    ----------
    mesh
        The undeformed mesh, of quadratic elements.
    """

    mesh: CellMesh

    @abstractmethod
    def flow(self, points: Array | None = None) -> Array:
        """∫ w^j_i dx (3, 3) over the moved mesh for the three unit forces e_j.

        Parameters
        ----------
        points : (nodes, 3)
            Where the nodes of ``mesh`` are, the undeformed ones by default. Opposite nodes stay opposite: they
            differ by one vector for each pair of faces, and on the eighth the mirror planes stay at right angles to
            the axes.

        Raises
        ------
        PorocoreError
            The system cannot be solved.
        """
