"""Response of the solid at the quadrature points, and its tangent stiffness.

Arrays at quadrature points are component-first, (3, 3, points), element by element.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Protocol

from porocore.cell.materials.material import StrainEnergy
from porocore.states import Array
from porocore_fem_skfem.operators import Operators, Scatter

#: Numbers in a batch of element blocks that fits into the processor's cache.
CACHED = 60_000


class PointKinematics(Protocol):
    """Kinematics of one iterate at the quadrature points.

    Attributes
    ----------
    F, cof : (3, 3, points)
        Deformation gradient and its cofactor.
    J : (points,)
        det F.
    p : float
        Pore pressure.
    """

    F: Array
    cof: Array
    J: Array
    p: float


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
