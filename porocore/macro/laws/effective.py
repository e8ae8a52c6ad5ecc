"""Effective properties of a cell (EffectiveProperties): permeability, moduli, Biot's coefficients, c_v."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from porocore.core.files.plain_data import json_ready
from porocore.core.units.dimensions import MULTIPLES
from porocore.core.units.results import ResultUnits
from porocore.macro.laws.linear import NO_STORAGE, LinearCoefficients
from porocore.states import Array

#: Quantities of the properties, each a key of :data:`porocore.core.units.scales.QUANTITIES`; '' for a pure number.
PROPERTIES = {
    "porosity": "",
    "permeability": "permeability",
    "conductivity": "conductivity",
    "stiffness_voigt": "stress",
    "confined_moduli": "stress",
    "young_moduli": "stress",
    "poisson_ratios": "",
    "shear_moduli": "stress",
    "anisotropy_ratio": "",
    "biot_tensor": "",
    "biot_modulus": "stress",
    "storage": "compliance",
    "consolidation_coefficients": "diffusivity",
    "held_stress": "stress",
}
#: Axes of Voigt's components: 11, 22, 33, 23, 13, 12, with e_23 counted twice.
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
#: Values along several axes that differ by less than this share are one.
SAME = 1e-3

Isotropy = Literal["isotropic", "cubic", "anisotropic"]


@dataclass(frozen=True, eq=False)
class EffectiveProperties:
    """Properties of a cell in linear poroelasticity, for tables, reports and figures derived from them.

    All numbers are dimensionless. In a study with :class:`~porocore.core.units.scales.Scales` each times
    ``ResultUnits.factor`` of its quantity in ``PROPERTIES``, or ``Scales.factor`` for SI units, has its unit;
    :meth:`in_units` does it for all. Multiples of E are of the reference modulus, d is the edge of the cell, of a box
    the cube root of its volume, μ_c the viscosity of the scales.

    Attributes
    ----------
    porosity : float
        φ_f of the mesh [-].
    permeability : (3, 3)
        Intrinsic permeability k = K μ_f [d²; m² in SI units].
    conductivity : (3, 3)
        K = k/μ_f, the hydraulic permeability of biomechanics [d²/μ_c; m²/(Pa s), which is m⁴/(N s), in SI units].
    stiffness_voigt : (6, 6)
        Drained stiffness C_eff [E], axes 11, 22, 33, 23, 13, 12 of stress, and of strain with twice e_23, e_13, e_12.
    confined_moduli : (3,)
        C_iiii of compression along each axis with the sides held [E]: the aggregate modulus H_A, oedometer modulus.
    young_moduli : (3,)
        Drained Young's moduli E_i along the axes, of a sample that is free at its sides [E].
    poisson_ratios : (3, 3)
        ν_ij, the contraction along j by the extension along i under uniaxial stress along i [-]; NaN for i = j.
    shear_moduli : (3,)
        G_23, G_13, G_12 [E].
    anisotropy_ratio : float
        Zener's 2 G (1 + ν)/E [-], 1 if isotropic; NaN where the stiffness is not cubic.
    biot_tensor : (3, 3)
        Biot coefficients α [-].
    biot_modulus : float
        M_B [E], infinite without pores.
    storage : float
        1/M_B [1/E].
    consolidation_coefficients : (3,)
        c_v = K_ii/(1/M_B + α_ii²/C_iiii) of a layer that is compressed and drained along an axis
        [E d²/μ_c; m²/s in SI units].
    held_stress : (3, 3)
        Stress of a solid whose swelling is held [E], tension positive; 0 unless it swells.
    """

    porosity: float
    permeability: Array
    conductivity: Array
    stiffness_voigt: Array
    confined_moduli: Array
    young_moduli: Array
    poisson_ratios: Array
    shear_moduli: Array
    anisotropy_ratio: float
    biot_tensor: Array
    biot_modulus: float
    storage: float
    consolidation_coefficients: Array
    held_stress: Array

    @classmethod
    def of(cls, c: LinearCoefficients, porosity: float, viscosity: float) -> EffectiveProperties:
        """Return the properties that follow from the coefficients of a cell, its porosity and its viscosity [μ_c]."""
        C = np.array([[c.stiffness[*one, *other] for other in VOIGT] for one in VOIGT])
        S = np.linalg.inv((C + C.T) / 2)
        young = 1 / np.diag(S)[:3]
        poisson = -S[:3, :3] * young[:, None]
        np.fill_diagonal(poisson, np.nan)
        shear = 1 / np.diag(S)[3:]
        ratio = 2 * shear.mean() * (1 + np.nanmean(poisson)) / young.mean()
        storage = 0.0 if abs(c.storage) <= NO_STORAGE else c.storage
        confined = np.diag(C)[:3].copy()
        taken_up = storage + np.diag(c.biot) ** 2 / confined
        K = np.diag(c.conductivity)
        return cls(
            porosity,
            c.conductivity * viscosity,
            c.conductivity,
            C,
            confined,
            young,
            poisson,
            shear,
            float(ratio) if _is_cubic(C) else np.nan,
            c.biot,
            1 / storage if storage else np.inf,
            storage,
            np.divide(K, taken_up, out=np.zeros(3), where=taken_up > NO_STORAGE),
            c.stress,
        )

    @classmethod
    def of_flow(cls, porosity: float, conductivity: Array, viscosity: float) -> EffectiveProperties:
        """Return the properties of a cell of which the flow alone is known; the others are NaN."""
        none, of_axes, tensor = np.nan, np.full(3, np.nan), np.full((3, 3), np.nan)
        C = np.full((6, 6), np.nan)
        flow = (porosity, conductivity * viscosity, conductivity)
        return cls(
            *flow, C, of_axes, of_axes, tensor, of_axes, none, tensor, none, none, of_axes, np.zeros((3, 3))
        )

    @property
    def stiff(self) -> bool:
        """True where the stiffness is known."""
        return bool(np.isfinite(self.stiffness_voigt).all())

    @property
    def isotropy(self) -> Isotropy:
        """Class of the stiffness, equal numbers being those within :data:`SAME`."""
        if np.isnan(self.anisotropy_ratio):
            return "anisotropic"
        return "isotropic" if abs(self.anisotropy_ratio - 1) < SAME else "cubic"

    def in_units(self, units: ResultUnits | None = None, length: float | None = None) -> dict[str, Any]:
        """Return every property by its name, ready for JSON, as ``{"value", "unit", "dimensionless", "multiple_of"}``.

        Pure numbers have the unit ``1`` and no more. Without scales there is no ``value`` and no ``unit``, except for
        the permeability of a cell with a ``length`` [m]. Numbers that are not defined are None.
        """
        units = units or ResultUnits()
        found: dict[str, Any] = {}
        for name, quantity in PROPERTIES.items():
            given = np.asarray(getattr(self, name), dtype=float)
            if not quantity:
                found[name] = {"value": json_ready(given), "unit": "1"}
                continue
            found[name] = {"dimensionless": json_ready(given), "multiple_of": MULTIPLES[quantity]}
            if units.given:
                values = np.vectorize(lambda x, q=quantity: units.value(float(x), q), otypes=[float])(given)
                found[name] = {"value": json_ready(values), "unit": units.name(quantity)} | found[name]
            elif quantity == "permeability" and length is not None:
                found[name] = {"value": json_ready(given * length**2), "unit": "m²"} | found[name]
        return found


def _is_cubic(C: Array) -> bool:
    """Tell whether a stiffness (6, 6) is that of a cubic cell with its axes, to :data:`SAME`."""
    normal, mixed, shear = np.diag(C)[:3], C[np.triu_indices(3, 1)], np.diag(C)[3:]
    scale = float(np.abs(C).max())
    one = np.diag(np.r_[np.full(3, normal.mean()), np.full(3, shear.mean())])
    one[:3, :3][~np.eye(3, dtype=bool)] = mixed.mean()
    alike = all(np.ptp(each) <= SAME * np.abs(each).max() for each in (normal, shear))
    return bool(alike and np.abs(C - one).max() <= SAME * scale)
