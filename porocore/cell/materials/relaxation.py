"""Prony series of a solid that relaxes (PronySeries), and its strain energy within one step (RelaxingSolid)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from porocore.cell.materials.material import StrainEnergy
from porocore.core.files.yaml_document import Location
from porocore.core.tensors import cofactor, determinant
from porocore.errors import ConfigurationError
from porocore.states import Array, IntArray


@dataclass(frozen=True)
class PronySeries:
    """Branches by which the second Piola–Kirchhoff stress of a solid exceeds that of equilibrium, S = S_∞ + Σ Q_i.

    Each overstress follows dQ_i/dt + Q_i/τ_i = γ_i dS_∞/dt, so the stress of a sudden strain is 1 + Σγ times that of
    equilibrium and relaxes with 1 + Σ γ_i exp(−t/τ_i) [Simo & Hughes, Computational Inelasticity, 1998, ch. 10].

    Parameters
    ----------
    strengths
        γ_i ≥ 0, over the stress of equilibrium.
    times
        τ_i > 0, in the unit of the times of a path.

    Raises
    ------
    ConfigurationError
        The numbers of strengths and times differ, or one of them is out of its range.
    """

    strengths: tuple[float, ...]
    times: tuple[float, ...]

    def __init__(self, strengths: Sequence[float], times: Sequence[float]) -> None:
        for name, given in (("strengths", strengths), ("times", times)):
            object.__setattr__(self, name, tuple(map(float, given)))
        if len(self.strengths) != len(self.times):
            raise ConfigurationError(
                f"relaxation: expected as many times as strengths, got {len(self.times)} and {len(self.strengths)}"
            )
        for strength, time in zip(self.strengths, self.times, strict=True):
            if not (np.isfinite(strength) and strength >= 0):
                raise ConfigurationError(f"relaxation: expected strengths of at least 0, got {strength:g}")
            if not (np.isfinite(time) and time > 0):
                raise ConfigurationError(f"relaxation: expected times above 0, got {time:g}")

    @property
    def effective(self) -> PronySeries:
        """The branches whose strength is not 0; the others never have a stress."""
        kept = [pair for pair in zip(self.strengths, self.times, strict=True) if pair[0] > 0]
        return PronySeries([strength for strength, _ in kept], [time for _, time in kept])

    def step(self, length: float) -> tuple[Array, Array]:
        """Return the factors of a step Q_i ← e_i Q_i + g_i (S_new − S_old), exact where S_∞ changes at a constant rate.

        Parameters
        ----------
        length
            Δt ≥ 0; at 0 the step is instantaneous.

        Returns
        -------
        decays, gains : (b,)
            e_i = exp(−Δt/τ_i) and g_i = γ_i (1 − e_i) τ_i/Δt.
        """
        a = length / np.array(self.times)
        share = np.ones_like(a)
        np.divide(-np.expm1(-a), a, out=share, where=a > 0)
        return np.exp(-a), np.array(self.strengths) * share


@dataclass(frozen=True, eq=False)
class RelaxingSolid(StrainEnergy):
    """Solid that relaxes, as the hyperelastic solid that it is within one step.

    With the overstresses and the stress S_old of the last step known, the stress of the next one is

        P = (1 + G) P_∞(F) + F B,  G = Σ g_i,  B = Σ e_i Q_i − G S_old

    by the factors of :meth:`PronySeries.step`. G and B are constant in the step, so it has the energy
    (1 + G) Ψ_∞ + ½ FᵀF : B and the tangent (1 + G) A_∞ + I ⊗ B, all of them unchanged by rotations.

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
