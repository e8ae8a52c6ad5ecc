"""Conductivity K and K_ref of the pore (Pore): Stokes flow in a mesh that may be deformed, its slopes.

The Stokes problem is self-adjoint: ∫ w^j_i dx is the stationary value of ∫ L_ij dx with::

    L_ij = w^i_j + w^j_i − ∇w^i:∇w^j + s^i div w^j + s^j div w^i

for the flows w^i under the unit forces and their pressures s^i. So only the explicit dependence on the nodes counts.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from porocore.cell.cell import Cell
from porocore.cell.conductivity.extension import HarmonicExtension, wall_interpolation
from porocore.cell.equilibrium.discrete import ElementGradients, FactorError
from porocore.cell.meshing.mesh import CellMesh, Domain
from porocore.cell.meshing.tetrahedra import determinants, shape_functions, tetrahedron_rule
from porocore.errors import ConfigurationError, PorocoreError
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


def flow_slopes(mesh: CellMesh, points: Array, flow: FlowFields, velocities: Array, degree: int) -> Array:
    """Return the slopes (3, 3, m) of ∫ w^j_i dx.

    Parameters
    ----------
    mesh
        Quadratic mesh of the fluid.
    points : (nodes, 3)
        Positions of its nodes, which may be deformed.
    flow
        Flows on that mesh.
    velocities : (m, nodes, 3)
        Slopes of the positions by m parameters.
    degree
        Degree of the quadrature of the flow.
    """
    gradients = ElementGradients(mesh, degree, points)
    at = tetrahedron_rule(degree)[0]
    N, corner_N = (shape_functions(at, nodes)[0] for nodes in (mesh.cells.shape[1], 4))
    grad = np.stack([gradients.gradient(flow.velocity[:, :, j]) for j in range(3)], axis=2)
    flat = grad.reshape(*grad.shape[:3], 9)
    w = np.einsum("qa,eaij->eqij", N, flow.velocity[mesh.cells], optimize=True)
    s = np.einsum("qa,eaj->eqj", corner_N, flow.pressure[mesh.cells[:, :4]], optimize=True)
    div = np.trace(grad, axis1=3, axis2=4)
    half = w - flat @ flat.swapaxes(2, 3) / 2 + s[..., :, None] * div[..., None, :]
    found = []
    for velocity in velocities:
        grad_V = gradients.gradient(velocity)
        turned = grad @ grad_V[:, :, None]
        change = turned.reshape(flat.shape) @ flat.swapaxes(2, 3)
        change -= s[..., :, None] * np.trace(turned, axis1=3, axis2=4)[..., None, :]
        div_V = np.trace(grad_V, axis1=2, axis2=3)
        slope = gradients.integral(half * div_V[..., None, None] + change)
        found.append(slope + slope.T)
    return np.moveaxis(np.reshape(found, (-1, 3, 3)), 0, -1)


#: Degree of the rule at whose points J of the fluid must be positive, that of the flow.
DEGREE = 4


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
        self, H: Array, u: Array, solid: CellMesh, V_solid: Array, V_fluid: Array, u_slopes: Array
    ) -> tuple[Array, float, Array]:
        """Return K_ref μ_f, the smallest J and the slopes (3, 3, m) of K_ref μ_f by m parameters; see :meth:`deformed`.

        The slopes are NaN where K_ref is.

        Parameters
        ----------
        H, u, solid
            As of :meth:`deformed`.
        V_solid, V_fluid : (m, nodes of the solid, 3), (m, nodes of the fluid, 3)
            Velocities of the undeformed solid, and of the undeformed fluid's quadratic mesh.
        u_slopes : (m, nodes of the solid, 3)
            Slopes of u¹ at the moving nodes.
        """
        moved, smallest = self._moved(H, u, solid)
        mesh, m = self.fluid.mesh, len(u_slopes)
        missing = np.full((3, 3), np.nan), smallest, np.full((3, 3, m), np.nan)
        if not smallest > 0:
            return missing
        try:
            flow = self.fluid.flow_fields(moved)
        except PorocoreError:
            return missing
        F0, extension = np.eye(3) + H, self._extension(solid)
        velocities = [
            W @ F0.T + extension.slope(u, u_slope, V, W)
            for V, W, u_slope in zip(V_solid, V_fluid, u_slopes, strict=True)
        ]
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
