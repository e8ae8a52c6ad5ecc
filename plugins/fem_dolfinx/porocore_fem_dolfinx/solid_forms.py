"""Interface of the solid's compiled forms: residual, tangent, load change, means; for any material."""

from __future__ import annotations

import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property

import numpy as np
import ufl
from petsc4py import PETSc

from porocore.cell.equilibrium.discrete import Iterate
from porocore.states import Array
from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.cell_mesh import CellDomain
from porocore_fem_dolfinx.types import Expr, FunctionSpace


class SolidForms(ABC):
    """Forms compiled once for a mesh and the space of u¹; all refer to the iterate that :meth:`load` has put in."""

    def __init__(self, domain: CellDomain, space: FunctionSpace) -> None:
        self.domain, self.space = domain, space
        self.function = compat.make_function(space)
        self.dH = compat.constant(domain.domain, np.zeros((3, 3)))
        self.grad_v = ufl.grad(ufl.TestFunction(space))
        self._loaded: Callable[[], Iterate | None] = lambda: None
        self._mean = compat.form(ufl.inner(self.dH, self.grad_v) * domain.dx)

    def load(self, iterate: Iterate, u: Array) -> None:
        """Put an iterate, with u¹ at the dofs, into what the forms refer to."""
        if self._loaded() is not iterate:
            self.function.x.array[:] = u
            self._loaded = weakref.ref(iterate)  # an iterate knows these forms
            self.set_load(iterate.H, iterate.p)

    @abstractmethod
    def set_load(self, H: Array, p: float) -> None:
        """Put in the load of another iterate, whose u¹ has been put in."""

    @abstractmethod
    def values(self) -> Array:
        """Return ∇u¹ (9), P + p cof F (9), Ψ and J at the quadrature points, (cells, q, 20)."""

    @abstractmethod
    def residual(self) -> Array:
        """Return ∂Π/∂u (dofs,)."""

    @abstractmethod
    def tangent(self, matrix: PETSc.Mat | None) -> PETSc.Mat:
        """Return ∂²Π/∂u², in ``matrix`` if that was made by this method before."""

    @abstractmethod
    def load_change(self, dH: Array, dp: float) -> Array:
        """Return the change of the residual (dofs,) by the load alone."""

    @abstractmethod
    def stress_change(self, dH: Array, dp: float) -> Array:
        """Return the change of P + p cof F (cells, q, 9) by the load alone."""

    @cached_property
    def means(self) -> list[Array]:
        """Vectors g with g·u = ∫ ∂u_i/∂Y_j dV, one for each (i, j)."""
        vectors = []
        for unit in np.eye(9).reshape(9, 3, 3):
            self.dH.value[...] = unit
            vectors.append(compat.assemble_vector(self._mean))
        return vectors


def components(tensor: Expr) -> list[Expr]:
    """Return the nine components of a UFL tensor, row by row."""
    return [tensor[i, j] for i in range(3) for j in range(3)]
