"""What the solid problem asks of its forms, whatever the material."""

from __future__ import annotations

import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import ufl

from porocore_fem_dolfinx import compat
from porocore_fem_dolfinx.cell_mesh import CellDomain


class SolidForms(ABC):
    """Compiled once for a mesh; everything refers to the state that :meth:`load` has put in.

    Parameters
    ----------
    domain
        Of the solid.
    space
        Of u¹.
    """

    def __init__(self, domain: CellDomain, space: Any) -> None:
        self.domain, self.space = domain, space
        self.function = compat.fem.Function(space)
        self.dH = compat.constant(domain.domain, np.zeros((3, 3)))
        self.grad_v = ufl.grad(ufl.TestFunction(space))
        self._here: Callable[[], Any] = lambda: None
        self._mean = compat.form(ufl.inner(self.dH, self.grad_v) * domain.dx)

    def load(self, iterate: Any) -> None:
        """Put a state (its u, H and p) into what the forms refer to."""
        if self.iterate is not iterate:
            self.function.x.array[:] = iterate.u
            self._here = weakref.ref(iterate)  # a state knows these forms
            self.changed()

    @property
    def iterate(self) -> Any:
        """Iterate that was put in, None where it is gone."""
        return self._here()

    @abstractmethod
    def changed(self) -> None:
        """Another state has been put in."""

    @abstractmethod
    def values(self) -> Any:
        """∇u¹ (9), P + p cof F (9), Ψ and J at the quadrature points, (cells, q, 20)."""

    @abstractmethod
    def residual(self) -> Any:
        """∂Π/∂u, (dofs,)."""

    @abstractmethod
    def tangent(self, matrix: Any) -> Any:
        """∂²Π/∂u² as a PETSc matrix, into one that this method has made before, or None."""

    @abstractmethod
    def load_change(self, dH: Any, dp: float) -> Any:
        """Change of the residual by the load alone, (dofs,)."""

    @abstractmethod
    def stress_change(self, dH: Any, dp: float) -> Any:
        """Change of P + p cof F by the load alone, (cells, q, 9)."""

    @cached_property
    def means(self) -> list[Any]:
        """g with g·u = ∫ ∂u_i/∂Y_j dV, for each (i, j)."""
        vectors = []
        for unit in np.eye(9).reshape(9, 3, 3):
            self.dH.value[...] = unit
            vectors.append(compat.assemble_vector(self._mean))
        return vectors


def flat(tensor: Any) -> list[Any]:
    """The nine components of a UFL tensor, row by row."""
    return [tensor[i, j] for i in range(3) for j in range(3)]
