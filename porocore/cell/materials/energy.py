"""Interface of a strain energy (StrainEnergy), and that of a swollen solid (Swollen): F = F_e F_g, F_g = λ I."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from porocore.core.files.yaml_document import Location
from porocore.states import Array, IntArray

#: Key of λ below a material.
SWELLING = "swelling"


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

    @property
    def mean_stretch(self) -> float:
        """Stretch λ at which the solid, free, has no stress, averaged over elements; 1 unless it is swollen."""
        return 1.0

    @abstractmethod
    def parameter_slopes(self, key: Location, F: Array) -> tuple[Array, Array]:
        """Return the slopes of energy and stress by one number of the solid.

        Parameters
        ----------
        key
            Keys that lead to the number, below ``cell.material``, such as ``("poisson_ratio",)``, or below
            ``cell.materials``, such as ``("core", "poisson_ratio")``.
        F : (..., 3, 3)
            Deformation gradient, which is kept.

        Returns
        -------
        by_energy, by_stress
            ∂Ψ/∂θ (...) and ∂P/∂θ (..., 3, 3), exact to round-off.
        """


@dataclass(frozen=True, eq=False)
class Swollen(StrainEnergy):
    """Solid that has no stress where it is stretched by λ in all directions.

    With F = F_e F_g and F_g = λ I only F_e stores energy. Per volume of the solid before it swells

        Ψ_ref(F) = λ³ Ψ(F/λ),  P = λ² P_e(F/λ),  A = λ A_e(F/λ),

    where Ψ, P_e and A_e are those of the ``elastic`` solid (Rodriguez, Hoger & McCulloch 1994, J. Biomech. 27). It
    stands for osmotic swelling, growth, shrinkage and thermal expansion alike.
    """

    elastic: StrainEnergy
    stretch: float

    @property
    def isotropic(self) -> bool:
        """True where the elastic solid is isotropic."""
        return self.elastic.isotropic

    @property
    def mean_stretch(self) -> float:
        """Swelling stretch λ."""
        return self.stretch

    def energy_density(self, F: Array) -> Array:
        """Return Ψ_ref (...) per volume before swelling [E]; 0 at F = λ I."""
        return np.asarray(self.stretch**3 * self.elastic.energy_density(F / self.stretch))

    def stress(self, F: Array) -> Array:
        return np.asarray(self.stretch**2 * self.elastic.stress(F / self.stretch))

    def tangent(self, F: Array) -> Array:
        return np.asarray(self.stretch * self.elastic.tangent(F / self.stretch))

    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """Return the moduli of the elastic solid; see :class:`StrainEnergy`."""
        return self.elastic.mean_moduli(elements)

    def parameter_slopes(self, key: Location, F: Array) -> tuple[Array, Array]:
        """Return ∂Ψ_ref/∂θ and ∂P/∂θ; by λ itself 3λ² Ψ − λ P_e:F and 2λ P_e − A_e:F, all at F/λ."""
        stretch, inner = self.stretch, F / self.stretch
        if key != (SWELLING,):
            by_energy, by_stress = self.elastic.parameter_slopes(key, inner)
            return stretch**3 * by_energy, stretch**2 * by_stress
        P = self.elastic.stress(inner)
        work = (P * F).sum(axis=(-2, -1))
        stiffened = np.einsum("...ijkl,...kl->...ij", self.elastic.tangent(inner), F)
        energy = self.elastic.energy_density(inner)
        return 3 * stretch**2 * energy - stretch * work, 2 * stretch * P - stiffened
