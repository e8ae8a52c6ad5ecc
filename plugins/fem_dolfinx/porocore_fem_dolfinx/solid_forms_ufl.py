"""Solid forms of a neo-Hookean solid in UFL; H, p and its constants change without compilation."""

from __future__ import annotations

import numpy as np
import ufl
from petsc4py import PETSc

from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.states import Array
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.cell_mesh import CellDomain
from porocore_fem_dolfinx.solid_forms import SolidForms, components
from porocore_fem_dolfinx.types import Expr, FunctionSpace, Mesh


class UflForms(SolidForms):
    """Energy Π in UFL, which UFL differentiates."""

    def __init__(self, domain: CellDomain, space: FunctionSpace, material: NeoHookean) -> None:
        super().__init__(domain, space)
        dx, grad_v = domain.dx, self.grad_v
        self._H = compat.constant(domain.domain, np.zeros((3, 3)))
        self._p = compat.constant(domain.domain, 0.0)
        self._dp = compat.constant(domain.domain, 0.0)
        grad_u = ufl.grad(self.function)
        F = ufl.variable(ufl.Identity(3) + self._H + grad_u)
        J = ufl.det(F)
        energy = _energy_density(material, F, domain.domain)
        stress = ufl.diff(energy + self._p * J, F)
        cofactor = ufl.diff(J, F)
        i, j, k, m = ufl.indices(4)
        change = ufl.as_tensor(ufl.diff(stress, F)[i, j, k, m] * self.dH[k, m], (i, j)) + self._dp * cofactor
        self._residual = compat.form(ufl.inner(stress, grad_v) * dx)
        self._tangent = compat.form(
            ufl.derivative(ufl.inner(stress, grad_v) * dx, self.function, ufl.TrialFunction(space))
        )
        self._change = compat.form(ufl.inner(change, grad_v) * dx)
        self._state = domain.expression(ufl.as_vector([*components(grad_u), *components(stress), energy, J]))
        self._stress_change = domain.expression(ufl.as_vector(components(change)))

    def set_load(self, H: Array, p: float) -> None:
        self._H.value[...] = H
        self._p.value = p

    def values(self) -> Array:
        return self.domain.evaluate(self._state)

    def residual(self) -> Array:
        return compat.assemble_vector(self._residual)

    def tangent(self, matrix: PETSc.Mat | None) -> PETSc.Mat:
        return compat.assemble_matrix(self._tangent, matrix)

    def load_change(self, dH: Array, dp: float) -> Array:
        self.dH.value[...], self._dp.value = dH, dp
        return compat.assemble_vector(self._change)

    def stress_change(self, dH: Array, dp: float) -> Array:
        self.dH.value[...], self._dp.value = dH, dp
        return self.domain.evaluate(self._stress_change)


def _energy_density(material: NeoHookean, F: Expr, domain: Mesh) -> Expr:
    """Return Ψ(F); the material's constants can change without a new compilation."""
    mu, lam = (compat.constant(domain, value) for value in (material.mu, material.lam))
    log_J = ufl.ln(ufl.det(F))
    return mu / 2 * (ufl.tr(F.T * F) - 3) - mu * log_J + lam / 2 * log_J**2
