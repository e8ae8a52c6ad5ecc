"""Solid that relaxes, as the hyperelastic solid that it is within one step (RelaxingSolid)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.cell.materials.material import StrainEnergy
from porocore.core.files.yaml_document import Location
from porocore.core.tensors import cofactor, determinant
from porocore.states import Array, IntArray


@dataclass(frozen=True, eq=False)
class RelaxingSolid(StrainEnergy):
    """Solid that relaxes, as the hyperelastic solid that it is within one step.

    With the overstresses and the stress S_old of the last step known, the stress of the next one is

        P = (1 + G) P_∞(F) + F B,  G = Σ g_i,  B = Σ e_i Q_i − G S_old

    by the factors of :func:`~porocore.cell.materials.prony.step_factors`. G and B are constant in the step, so it has
    the energy (1 + G) Ψ_∞ + ½ FᵀF : B and the tangent (1 + G) A_∞ + I ⊗ B. The energy does not change under rotations.

    Parameters
    ----------
    elastic
        Solid in equilibrium, Ψ_∞.
    gain
        G.
    overstress : (elements, points, 3, 3)
        B at the quadrature points of the mesh, symmetric [E]; others cannot be asked for.
    """

    elastic: StrainEnergy
    gain: float
    overstress: Array

    @property
    def isotropic(self) -> bool:
        """False: the overstress distinguishes directions."""
        return False

    @property
    def mean_stretch(self) -> float:
        """Stretch at which the solid in equilibrium has no stress."""
        return self.elastic.mean_stretch

    def energy_density(self, F: Array) -> Array:
        """Return the energy of the step, which is 0 at F = I only without overstress."""
        stretch = np.einsum("...ki,...kj->...ij", F, F)
        work = (stretch * self.overstress).sum(axis=(-2, -1)) / 2
        return np.asarray((1 + self.gain) * self.elastic.energy_density(F) + work)

    def stress(self, F: Array) -> Array:
        return np.asarray((1 + self.gain) * self.elastic.stress(F) + F @ self.overstress)

    def tangent(self, F: Array) -> Array:
        found = (1 + self.gain) * self.elastic.tangent(F)
        for i in range(3):
            found[..., i, :, i, :] += self.overstress
        return found

    def mean_moduli(self, elements: IntArray | None = None) -> tuple[float, float]:
        """Return the moduli of equilibrium; see :class:`StrainEnergy`."""
        return self.elastic.mean_moduli(elements)

    def parameter_slopes(self, key: Location, F: Array) -> tuple[Array, Array]:
        """Return the slopes by a number of the solid in equilibrium, at a constant overstress."""
        by_energy, by_stress = self.elastic.parameter_slopes(key, F)
        return (1 + self.gain) * by_energy, (1 + self.gain) * by_stress


def second_stress(solid: StrainEnergy, F: Array) -> Array:
    """Return the second Piola–Kirchhoff stress S = F⁻¹ P (..., 3, 3) of a solid [E], symmetric."""
    S = cofactor(F).swapaxes(-2, -1) @ solid.stress(F) / determinant(F)[..., None, None]
    return np.asarray((S + S.swapaxes(-2, -1)) / 2)
