"""Response of a solid of any strain energy at the quadrature points, and its tangent stiffness.

Arrays at quadrature points are component-first, (3, 3, points), element by element.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

import numpy as np

from porocore.cell.materials.material import StrainEnergy
from porocore.core.tensors.cofactors import add_cofactor_tangent
from porocore.states import Array
from porocore_fem_skfem.operators import Operators, Scatter

#: Numbers in a batch of element blocks that fits into the processor's cache.
CACHED = 60_000


class PointKinematics(Protocol):
    """Kinematics of one iterate at the quadrature points."""

    F: Array  #: (3, 3, points)  deformation gradient
    cof: Array  #: (3, 3, points)  its cofactor
    J: Array  #: (points,)  det F
    p: float  #: pore pressure


class SolidResponse(ABC):
    """Response of one material on one mesh.

    Parameters
    ----------
    material
        Material of every element.
    operators
        Gradients and weights at the quadrature points.
    scatter
        Sum of element blocks into the stiffness.
    """

    def __init__(self, material: StrainEnergy, operators: Operators, scatter: Scatter) -> None:
        self.material, self.scatter = material, scatter
        self.grad_N, self.w = operators.grad_N, operators.weights

    @abstractmethod
    def energy_density(self, at: PointKinematics) -> Array:
        """Return Ψ (points)."""

    @abstractmethod
    def stress(self, at: PointKinematics) -> Array:
        """Return P + p cof F (3, 3, points)."""

    @abstractmethod
    def tangent_apply(self, at: PointKinematics, dF: Array) -> Array:
        """Return A:δF + p δcof F (3, 3, points) for δF (3, 3, points) or (3, 3, 1)."""

    @abstractmethod
    def stiffness(self, at: PointKinematics) -> Array:
        """Return the entries of the upper triangle of ∂²Π/∂u², in the order of the scatter's pattern."""


class GeneralResponse(SolidResponse):
    """Response of any strain energy, by its stress and its tangent A_ijkl."""

    _of: PointKinematics | None = None
    _moduli: Array

    def _by_element(self, F: Array) -> Array:
        """Return a view (elements, points of each, 3, 3)."""
        e, q = self.grad_N.shape[:2]
        return np.moveaxis(F.reshape(3, 3, e, q), (0, 1), (-2, -1))

    def energy_density(self, at: PointKinematics) -> Array:
        return self.material.energy_density(self._by_element(at.F)).reshape(-1)

    def stress(self, at: PointKinematics) -> Array:
        P = np.moveaxis(self.material.stress(self._by_element(at.F)), (-2, -1), (0, 1))
        return P.reshape(3, 3, -1) + at.p * at.cof

    def moduli(self, at: PointKinematics) -> Array:
        """Return A + p ∂cof F/∂F (3, 3, 3, 3, points), kept for the last iterate."""
        if self._of is not at:
            A = self.material.tangent(self._by_element(at.F))
            self._moduli = np.moveaxis(A, (-4, -3, -2, -1), (0, 1, 2, 3)).reshape(3, 3, 3, 3, -1)
            if at.p:
                add_cofactor_tangent(self._moduli, at.p * at.F)
            self._of = at
        return self._moduli

    def tangent_apply(self, at: PointKinematics, dF: Array) -> Array:
        moduli, changes = self.moduli(at), np.zeros((3, 3, at.J.size))
        for k in range(3):
            for l in range(3):
                if dF[k, l].any():
                    changes += moduli[:, :, k, l] * dF[k, l]
        return changes

    def stiffness(self, at: PointKinematics) -> Array:
        e, q, a, _ = self.grad_N.shape
        weighted = (self.moduli(at) * self.w).reshape(3, 3, 3, 3, e, q)
        blocks = np.empty((e, 3, a, 3, a))
        chunk = max(1, CACHED // (3 * a) ** 2)
        for start in range(0, e, chunk):
            part = slice(start, start + chunk)
            grad = self.grad_N[part]
            n = len(grad)
            # Σ_ql grad_bl (Σ_j grad_aj A_ijkl) as two batched products
            A = weighted[..., part, :].transpose(4, 5, 1, 0, 2, 3).reshape(n, q, 3, 27)
            half = np.matmul(grad, A).reshape(n, q, a, 3, 3, 3).transpose(0, 3, 4, 2, 1, 5)
            right = grad.transpose(0, 1, 3, 2).reshape(n, 3 * q, a)
            full = np.matmul(half.reshape(n, 9 * a, 3 * q), right).reshape(n, 3, 3, a, a)
            blocks[part] = full.transpose(0, 1, 3, 2, 4)
        return self.scatter(blocks)
