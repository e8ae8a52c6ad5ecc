"""Π of the solid and its derivatives as UFL forms; H, p and the material's constants change without compilation."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import ufl

from porocore.materials.neo_hookean import NeoHookean
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.cell_mesh import CellDomain
from porocore_fem_dolfinx.material import energy_density


class SolidForms:
    """Compiled once for a mesh; everything refers to the state that :meth:`load` has put in.

    Parameters
    ----------
    domain
        Of the solid.
    space
        Of u¹.
    material
        Its strain energy.
    """

    def __init__(self, domain: CellDomain, space: Any, material: NeoHookean) -> None:
        self.domain, dx = domain, domain.dx
        self._function = compat.fem.Function(space)
        self._H = compat.constant(domain.domain, np.zeros((3, 3)))
        self._p = compat.constant(domain.domain, 0.0)
        self._dH = compat.constant(domain.domain, np.zeros((3, 3)))
        self._dp = compat.constant(domain.domain, 0.0)
        self._loaded: Any = None
        v = ufl.TestFunction(space)
        grad_u = ufl.grad(self._function)
        F = ufl.variable(ufl.Identity(3) + self._H + grad_u)
        J = ufl.det(F)
        energy = energy_density(material, F, domain.domain)
        stress = ufl.diff(energy + self._p * J, F)
        cofactor = ufl.diff(J, F)
        i, j, k, m = ufl.indices(4)
        change = ufl.as_tensor(ufl.diff(stress, F)[i, j, k, m] * self._dH[k, m], (i, j)) + self._dp * cofactor
        self._residual = compat.form(ufl.inner(stress, ufl.grad(v)) * dx)
        self._tangent = compat.form(
            ufl.derivative(ufl.inner(stress, ufl.grad(v)) * dx, self._function, ufl.TrialFunction(space))
        )
        self._change = compat.form(ufl.inner(change, ufl.grad(v)) * dx)
        self._mean = compat.form(ufl.inner(self._dH, ufl.grad(v)) * dx)
        self._state = domain.expression(ufl.as_vector([*_flat(grad_u), *_flat(stress), energy, J]))
        self._stress_change = domain.expression(ufl.as_vector(_flat(change)))

    def load(self, here: Any) -> None:
        """Put a state (its u, H and p) into the function and the constants that the forms refer to."""
        if self._loaded is not here:
            self._function.x.array[:] = here.u
            self._H.value[...] = here.H
            self._p.value = here.p
            self._loaded = here

    def values(self) -> Any:
        """∇u¹ (9), P + p cof F (9), Ψ and J at the quadrature points, (cells, q, 20)."""
        return self.domain.evaluate(self._state)

    def residual(self) -> Any:
        """∂Π/∂u, (dofs,)."""
        return compat.assemble_vector(self._residual)

    def tangent(self, matrix: Any) -> Any:
        """∂²Π/∂u² as a PETSc matrix, into one that this method has made before, or None."""
        return compat.assemble_matrix(self._tangent, matrix)

    def load_change(self, dH: Any, dp: float) -> Any:
        """Change of the residual by the load alone, (dofs,)."""
        self._dH.value[...] = dH
        self._dp.value = dp
        return compat.assemble_vector(self._change)

    def stress_change(self, dH: Any, dp: float) -> Any:
        """Change of P + p cof F by the load alone, (cells, q, 9)."""
        self._dH.value[...] = dH
        self._dp.value = dp
        return self.domain.evaluate(self._stress_change)

    @cached_property
    def means(self) -> list[Any]:
        """g with g·u = ∫ ∂u_i/∂Y_j dV, for each (i, j)."""
        vectors = []
        for unit in np.eye(9).reshape(9, 3, 3):
            self._dH.value[...] = unit
            vectors.append(compat.assemble_vector(self._mean))
        return vectors


def _flat(tensor: Any) -> list[Any]:
    return [tensor[i, j] for i in range(3) for j in range(3)]
