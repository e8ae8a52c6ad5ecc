"""Interface of a strain energy (StrainEnergy), and base of a configured material (Material)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Self

import numpy as np
from pydantic import model_validator

from porocore.cell.materials.moduli import check_reference, voigt_moduli
from porocore.core.models.strict import StrictModel
from porocore.core.tensors.point_group import MIRRORS
from porocore.states import Array, IntArray

if TYPE_CHECKING:
    from porocore.cell.meshing.mesh import CellMesh


class StrainEnergy(ABC):
    """Strain energy Ψ(F) of a hyperelastic solid at many points.

    F_ij = ∂x_i/∂X_j has the shape (..., 3, 3), and (elements, points, 3, 3) where materials differ between elements.
    All stresses and moduli are in units of E, the reference modulus of the study.
    """

    @property
    @abstractmethod
    def isotropic(self) -> bool:
        """True where the response is the same in all directions of the reference configuration."""

    @abstractmethod
    def energy_density(self, F: Array) -> Array:
        """Return Ψ (...) per undeformed volume [E]; 0 at F = I."""

    @abstractmethod
    def stress(self, F: Array) -> Array:
        """Return P = ∂Ψ/∂F (..., 3, 3), first Piola–Kirchhoff, tension positive [E]."""

    @abstractmethod
    def tangent(self, F: Array) -> Array:
        """Return A_ijkl = ∂P_ij/∂F_kl (..., 3, 3, 3, 3) [E]."""

    @abstractmethod
    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """Return Young's and shear modulus of small strains [E], averaged over directions and elements (all)."""


class Material(StrictModel, StrainEnergy):
    """Configuration of a homogeneous solid.

    A new kind derives this class, has a field ``kind`` with one allowed text, and stands in
    :data:`porocore.cell.materials.choice.AnyMaterial`.
    """

    @property
    @abstractmethod
    def description(self) -> str:
        """Short description, such as ``neo-hookean solid with Poisson's ratio 0.35``."""

    def turned(self, Q: IntArray) -> Material | None:
        """Return the solid after a signed permutation Q (3, 3) of the axes, Ψ'(F) = Ψ(QᵀFQ); None if unknown.

        An anisotropic kind turns its directions, so that its symmetry is used.
        """
        return self if self.isotropic else None

    def equals(self, other: Material) -> bool:
        """Return whether another solid has the same Ψ by its parameters."""
        return self == other

    def allows(self, Q: IntArray, regions: Mapping[str, str] | None) -> bool:
        """Return whether Q leaves the response unchanged; the images of the ``regions`` do not matter."""
        turned = self.turned(Q)
        return turned is not None and turned.equals(self)

    @property
    def mirrored(self) -> bool:
        """True where the response is invariant under the mirrors of the three axes, as on the eighth of a cell."""
        return all(self.allows(Q, None) for Q in MIRRORS.matrices)

    @property
    def identity(self) -> str:
        """Kind and parameters as text."""
        return self.model_dump_json()

    def on(self, mesh: CellMesh) -> StrainEnergy:
        """Return the strain energy of every element of a mesh of the solid, itself."""
        return self

    @property
    def elasticity(self) -> Array:
        """Elasticity C (3, 3, 3, 3) of small strains, A at F = I [E]."""
        return self.tangent(np.eye(3))

    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """See :class:`StrainEnergy`; Voigt's average over directions, exact where the solid is isotropic."""
        return voigt_moduli(self.elasticity)

    def stress_hint(self) -> str:
        """Return advice for an undeformed solid with a residual stress."""
        return ""

    @model_validator(mode="after")
    def _sound(self) -> Self:
        rest = np.eye(3)
        try:
            check_reference(self.energy_density(rest), self.stress(rest), self.elasticity, self.stress_hint)
        except OverflowError:
            raise ValueError(
                "the energy or a derivative of it is too large a number at F = I; give smaller powers"
            ) from None
        return self
