"""Bounds as a stiffness; what an isotropic solid that is the same everywhere ties to the stiffness of its cell.

With H = −p/(3 K_s) I and p in the pores, solid and fluid bear the same pressure and nothing fluctuates. That gives
Biot's coupling and modulus. The mean strain of the solid follows from its mean stress.
"""

from __future__ import annotations

import numpy as np

from porocore.states import Array
from porocore.surrogates.family.coordinates import Bounds
from porocore.surrogates.stretch.components import PLACES

#: Mandel's factors of the six components of a stress that counts a shear in both places.
MANDEL = np.array([1.0, 1.0, 1.0, *[1 / np.sqrt(2)] * 3])
#: Volumetric and deviatoric projector in Mandel's components.
VOLUMETRIC = np.outer([1, 1, 1, 0, 0, 0], [1, 1, 1, 0, 0, 0]) / 3
DEVIATORIC = np.eye(6) - VOLUMETRIC


def normaliser(values: Bounds, slopes: Bounds) -> tuple[Array, Array]:
    """Return N^½ (n, 6, 6) of the bounds, and its derivatives (n, l, 6, 6)."""
    a, b = np.sqrt(3 * values.drained), np.sqrt(values.wave)
    root = a[:, None, None] * VOLUMETRIC + b[:, None, None] * DEVIATORIC
    by_a, by_b = (1.5 * slopes.drained / a).T[..., None, None], (0.5 * slopes.wave / b).T[..., None, None]
    return root, by_a * VOLUMETRIC + by_b * DEVIATORIC


def tied(
    C: Array, C_slopes: Array, phi: Array, phi_slopes: Array, solid: tuple[Bounds, Bounds] | None
) -> tuple[Array, Array, Array, Array]:
    """Return A (7, 7, n) and ∂⟨∇u¹⟩/∂y (9, 7, n), each with its derivatives, as far as the stiffness ties them."""
    n, l = len(phi), len(phi_slopes)
    A, A_slopes = np.zeros((7, 7, n)), np.zeros((7, 7, l, n))
    factor = np.outer(MANDEL, MANDEL)
    A[:6, :6], A_slopes[:6, :6] = C / factor[:, :, None], C_slopes / factor[:, :, None, None]
    m, m_slopes = np.zeros((9, 7, n)), np.zeros((9, 7, l, n))
    if solid is None:
        return A, A_slopes, m, m_slopes
    values, slopes = solid
    bulk, shear = values.bulk, values.shear
    # With H = −p/(3 K_s) I and p in the pores, solid and fluid bear the same pressure, and nothing fluctuates.
    sums = A[:6, :3].sum(axis=1)
    A[6, :6] = sums / (3 * bulk)
    A[6, :3] -= 1.0
    A_slopes[6, :6] = A_slopes[:6, :3].sum(axis=1) / (3 * bulk) - sums[:, None] * slopes.bulk / (3 * bulk**2)
    A[:6, 6], A_slopes[:6, 6] = A[6, :6], A_slopes[6, :6]
    normal = A[6, :3].sum(axis=0)
    A[6, 6] = normal / (3 * bulk) + phi / bulk
    A_slopes[6, 6] = (A_slopes[6, :3].sum(axis=0) + 3 * phi_slopes) / (3 * bulk)
    A_slopes[6, 6] -= (normal + 3 * phi) / (3 * bulk**2) * slopes.bulk
    for a in range(6):
        strain, strain_slopes = _strain(A[:6, a], A_slopes[:6, a], bulk, shear, slopes)
        i, j = PLACES[a]
        m[:, a], m_slopes[:, a] = strain, strain_slopes
        for place in {3 * i + j, 3 * j + i}:
            m[place, a] -= 1 - phi
            m_slopes[place, a] += phi_slopes
    trace = m[:, :3].sum(axis=1)
    m[:, 6] = trace / (3 * bulk)
    m_slopes[:, 6] = m_slopes[:, :3].sum(axis=1) / (3 * bulk)
    m_slopes[:, 6] -= trace[:, None] * slopes.bulk / (3 * bulk**2)
    return A, A_slopes, m, m_slopes


def _strain(
    stress: Array, stress_slopes: Array, bulk: Array, shear: Array, slopes: Bounds
) -> tuple[Array, Array]:
    """Return the strain (9, n) of the solid for six stresses, shears counted twice, and its derivatives (9, l, n)."""
    deviator = 1 / (2 * shear)
    volume = 1 / (9 * bulk) - 1 / (6 * shear)
    by_deviator = -slopes.shear / (2 * shear**2)
    by_volume = -slopes.bulk / (9 * bulk**2) + slopes.shear / (6 * shear**2)
    trace, trace_slopes = stress[:3].sum(axis=0), stress_slopes[:3].sum(axis=0)
    strain, strain_slopes = np.zeros((9, len(bulk))), np.zeros((9, *stress_slopes.shape[1:]))
    for b, (i, j) in enumerate(PLACES):
        half = 1.0 if i == j else 0.5
        for place in {3 * i + j, 3 * j + i}:
            strain[place] = half * stress[b] * deviator
            strain_slopes[place] = half * (stress_slopes[b] * deviator + stress[b] * by_deviator)
            if i == j:
                strain[place] += trace * volume
                strain_slopes[place] += trace_slopes * volume + trace * by_volume
    return strain, strain_slopes
