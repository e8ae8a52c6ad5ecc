"""What every strain energy of the solid offers, and what a configured one must obey."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Self

import numpy as np
from pydantic import model_validator

from porocore.cell.materials.moduli import check_reference, voigt_moduli
from porocore.core.models.strict import StrictModel
from porocore.core.tensors.point_group import CUBIC, MIRRORS, PointGroup
from porocore.states import Array, IntArray

if TYPE_CHECKING:
    from porocore.cell.meshing.mesh import CellMesh


class StrainEnergy(ABC):
    """A hyperelastic solid, Ψ(F) at many points.

    F_ij = ∂x_i/∂X_j has the shape (..., 3, 3); where materials differ from element to element it is led by the
    elements of the mesh, (elements, points, 3, 3). All stresses and moduli are in units of E, the reference modulus of
    the study.
    """

    @property
    @abstractmethod
    def isotropic(self) -> bool:
        """Whether the response is the same along all directions of the reference configuration, everywhere."""

    @abstractmethod
    def energy_density(self, F: Array) -> Array:
        """Ψ (...) per undeformed volume [E]; 0 at F = I."""

    @abstractmethod
    def stress(self, F: Array) -> Array:
        """P = ∂Ψ/∂F (..., 3, 3), first Piola–Kirchhoff, tension positive [E]."""

    @abstractmethod
    def tangent(self, F: Array) -> Array:
        """A_ijkl = ∂P_ij/∂F_kl (..., 3, 3, 3, 3) [E]."""

    @abstractmethod
    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """Young's modulus and shear modulus of small strains [E], averaged over directions and over elements (all)."""


class Material(StrictModel, StrainEnergy):
    """A homogeneous solid as it stands in the configuration.

    A new kind derives this class, has a field ``kind`` with one allowed text, and stands in
    :data:`porocore.cell.materials.choice.AnyMaterial`.
    """

    @property
    @abstractmethod
    def description(self) -> str:
        """A few words for a reader, such as ``neo-hookean solid with Poisson's ratio 0.35``."""

    def turned(self, Q: IntArray) -> Material | None:
        """Return the solid after a signed permutation Q (3, 3) of the axes, Ψ'(F) = Ψ(QᵀFQ); None if unknown.

        A kind that is not isotropic, and whose symmetry shall be made use of, turns its directions here.
        """
        return self if self.isotropic else None

    def equals(self, other: Material) -> bool:
        """Return whether another solid has the same Ψ, as far as the parameters of both tell."""
        return self == other

    def allows(self, Q: IntArray, regions: Mapping[str, str] | None) -> bool:
        """Return whether Q leaves the response alone; which ``regions`` of the cell change places does not matter."""
        turned = self.turned(Q)
        return turned is not None and turned.equals(self)

    @property
    def point_group(self) -> PointGroup:
        """The operations of the cube that leave the response alone."""
        return CUBIC.kept(lambda Q: self.allows(Q, None))

    @property
    def mirrored(self) -> bool:
        """Whether the mirrors of the three axes leave the response alone, as the eighth of a cell asks for."""
        return all(self.allows(Q, None) for Q in MIRRORS.matrices)

    @property
    def identity(self) -> str:
        """All that it is, as text."""
        return self.model_dump_json()

    def on(self, mesh: CellMesh) -> StrainEnergy:
        """Of every element of a mesh of the solid: itself."""
        return self

    @property
    def elasticity(self) -> Array:
        """C (3, 3, 3, 3) of small strains, A at F = I [E]."""
        return self.tangent(np.eye(3))

    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """See :class:`StrainEnergy`; Voigt's average over directions, exact where the solid is isotropic."""
        return voigt_moduli(self.elasticity)

    def stress_hint(self) -> str:
        """What a user may change where the undeformed solid is not free of stress."""
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
