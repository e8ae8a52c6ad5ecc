"""Interface of a discrete fluid (DiscreteFluid): Stokes flow through a mesh that may be deformed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from porocore.cell.equilibrium.discrete import FactorError
from porocore.cell.meshing.mesh import CellMesh
from porocore.errors import PorocoreError
from porocore.states import Array

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class FlowFields:
    """Flows under the three unit forces e_j.

    Attributes
    ----------
    velocity : (nodes, 3, 3)
        w^j_i at the nodes.
    pressure : (nodes, 3)
        Pressure s^j at the corners; 0 at mid-edge nodes.
    integrals : (3, 3)
        ∫ w^j_i dx.
    """

    velocity: Array
    pressure: Array
    integrals: Array


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
        return self._solved(self.integrals, points)

    def flow_fields(self, points: Array | None = None) -> FlowFields:
        """Return velocities and pressures that are as accurate as slopes of the flow need; see :meth:`flow`.

        Raises
        ------
        PorocoreError
            The system cannot be solved.
        """
        return self._solved(self.fields, points)

    def _solved(self, solve: Callable[[Array], T], points: Array | None) -> T:
        try:
            return solve(self.mesh.points if points is None else points)
        except FactorError as error:
            raise PorocoreError(
                f"the Stokes cell problem cannot be solved ({error}); refine the mesh (cell.mesh.fluid_size)"
            ) from error

    @abstractmethod
    def integrals(self, points: Array) -> Array:
        """Return what :meth:`flow` does; a FactorError says why the system cannot be solved."""

    @abstractmethod
    def fields(self, points: Array) -> FlowFields:
        """Return what :meth:`flow_fields` does; a FactorError says why the system cannot be solved."""
