"""Solid forms for any material: the core's stress and tangent as functions at the quadrature points."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import ufl
from petsc4py import PETSc

from porocore.cell.materials.energy import StrainEnergy
from porocore.core.tensors.cofactors import cofactor, cofactor_tangent, determinant
from porocore.states import Array, IntArray
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.cell_mesh import CellDomain
from porocore_fem_dolfinx.solid_forms import SolidForms, components
from porocore_fem_dolfinx.types import FunctionSpace


class PointwiseResponse:
    """Response of the material to ∇u¹ (cells, q, 3, 3) and a load; components last, cells in dolfinx's order.

    ``order`` (cells,) is the core's element that each cell is.
    """

    def __init__(self, material: StrainEnergy, grad: Array, H: Array, p: float, order: IntArray) -> None:
        self.material, self.grad, self.p, self.order = material, grad, p, order
        self.F = np.eye(3) + H + grad
        self.by_element = np.empty_like(self.F)
        self.by_element[order] = self.F

    @cached_property
    def values(self) -> Array:
        """Values of ∇u¹ (9), P + p cof F (9), Ψ and J, (cells, q, 20)."""
        stress = self.material.stress(self.by_element)[self.order] + self.p * cofactor(self.F)
        energy = self.material.energy_density(self.by_element)[self.order]
        shape = self.F.shape[:2]
        parts = (self.grad.reshape(*shape, 9), stress.reshape(*shape, 9), energy, determinant(self.F))
        return np.concatenate([part if part.ndim == 3 else part[..., None] for part in parts], axis=2)

    @cached_property
    def moduli(self) -> Array:
        """Moduli A + p ∂cof F/∂F, (cells, q, 9, 9)."""
        moduli = self.material.tangent(self.by_element)[self.order]
        if self.p:
            moduli = moduli + self.p * cofactor_tangent(self.F)
        return moduli.reshape(*self.F.shape[:2], 9, 9)

    def change(self, dH: Array, dp: float) -> Array:
        """Return the change of P + p cof F (cells, q, 9) by the load alone."""
        change = self.moduli @ np.asarray(dH).reshape(9)
        return change + dp * cofactor(self.F).reshape(change.shape) if dp else change


class PointwiseForms(SolidForms):
    """Forms without a material, compiled once for all of them."""

    def __init__(self, domain: CellDomain, space: FunctionSpace, material: StrainEnergy) -> None:
        super().__init__(domain, space)
        self._material, dx, grad_v = material, domain.dx, self.grad_v
        grad_u = ufl.grad(self.function)
        self._grad = domain.expression(ufl.as_vector(components(grad_u)))
        self._stress, self._stress_places = domain.at_points((3, 3))
        self._moduli, self._moduli_places = domain.at_points((9, 9))
        grad_du = ufl.as_vector(components(ufl.grad(ufl.TrialFunction(space))))
        change = ufl.dot(self._moduli, grad_du)
        self._residual = compat.form(ufl.inner(self._stress, grad_v) * dx)
        self._tangent = compat.form(ufl.dot(change, ufl.as_vector(components(grad_v))) * dx)
        self.response: PointwiseResponse

    def set_load(self, H: Array, p: float) -> None:
        grad = self.domain.evaluate(self._grad)
        grad = grad.reshape(*grad.shape[:2], 3, 3)
        self.response = PointwiseResponse(self._material, grad, H, p, self.domain.elements)

    def values(self) -> Array:
        return self.response.values

    def residual(self) -> Array:
        return self._forces(self.response.values[:, :, 9:18])

    def tangent(self, matrix: PETSc.Mat | None) -> PETSc.Mat:
        self._moduli.x.array.reshape(-1, 81)[self._moduli_places] = self.response.moduli.reshape(
            *self._moduli_places.shape, 81
        )
        return compat.assemble_matrix(self._tangent, matrix)

    def load_change(self, dH: Array, dp: float) -> Array:
        return self._forces(self.response.change(dH, dp))

    def stress_change(self, dH: Array, dp: float) -> Array:
        return self.response.change(dH, dp)

    def _forces(self, stress: Array) -> Array:
        """Return ∫ S:∇v dV (dofs,) of S (cells, q, 9)."""
        self._stress.x.array.reshape(-1, 9)[self._stress_places] = stress
        return compat.assemble_vector(self._residual)
