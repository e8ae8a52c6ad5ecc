"""Interface of a discrete fluid (DiscreteFluid): Stokes flow through a mesh that may be deformed."""

from __future__ import annotations

from abc import ABC, abstractmethod

from porocore.cell.equilibrium.discrete import FactorError
from porocore.cell.meshing.mesh import CellMesh
from porocore.errors import PorocoreError
from porocore.states import Array


class DiscreteFluid(ABC):
    """Stokes flow of unit viscosity on one mesh of the fluid, with quadratic velocity and linear pressure.

    On the mesh deformed by x(Y), with F = ∂x/∂Y and J = det F, the weak form for the unit force e_j is::

        ∫ J (∇w F⁻¹):(∇v F⁻¹) − q J F⁻ᵀ:∇v − s J F⁻ᵀ:∇w dY = ∫ J v_j dY

    for all v, s periodic in Y; w vanishes on the wall. x is quadratic in each element like Y itself, so this is the
    weak form of the undeformed cell with x in place of Y, and the undeformed cell is the case x = Y.

    Attributes
    ----------
    mesh
        Undeformed mesh of quadratic elements.
    """

    mesh: CellMesh

    @property
    def choice(self) -> str:
        """Unknowns and linear solver, in words; empty where the backend does not tell."""
        return ""

    def flow(self, points: Array | None = None) -> Array:
        """Return ∫ w^j_i dx (3, 3) over the deformed mesh for the three unit forces e_j.

        Parameters
        ----------
        points : (nodes, 3)
            Positions of the nodes of ``mesh``, the undeformed ones by default. Partners on opposite faces differ by
            one vector for each pair of faces; on the eighth the mirror planes stay normal to the axes.

        Raises
        ------
        PorocoreError
            The system cannot be solved.
        """
        try:
            return self.integrals(self.mesh.points if points is None else points)
        except FactorError as error:
            raise PorocoreError(
                f"the Stokes cell problem cannot be solved ({error}); refine the mesh (cell.mesh.fluid_size)"
            ) from error

    @abstractmethod
    def integrals(self, points: Array) -> Array:
        """Return what :meth:`flow` does; a FactorError says why the system cannot be solved."""
