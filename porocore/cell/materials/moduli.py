"""Averaged Young's and shear modulus of a stiffness, Kelvin matrix, check of the solid at rest."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from porocore.states import Array

#: Tolerances of a residual stress and of the smallest eigenvalue of the elasticity, over the largest modulus.
STRESS_FREE, POSITIVE = 1e-10, 1e-8
#: Kelvin's notation: pairs of indices, and the factors that make the basis orthonormal.
_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
_FACTORS = np.array([1.0, 1.0, 1.0, np.sqrt(2), np.sqrt(2), np.sqrt(2)])


def voigt_moduli(C: Array) -> tuple[float, float]:
    """Return Young's modulus and shear modulus [E] of C (3, 3, 3, 3) averaged over all directions (Voigt 1889)."""
    bulk = float(np.einsum("iijj->", C)) / 9
    shear = (3 * float(np.einsum("ijij->", C)) - 9 * bulk) / 30
    return 9 * bulk * shear / (3 * bulk + shear), shear


def kelvin(C: Array) -> Array:
    """Return the Kelvin matrix (6, 6) of C (3, 3, 3, 3), with the eigenvalues of C on symmetric strains (1856)."""
    rows = np.array([[C[i, j, k, l] for k, l in _PAIRS] for i, j in _PAIRS])
    return np.asarray(_FACTORS[:, None] * rows * _FACTORS)


def check_reference(energy: Array, P: Array, C: Array, hint: Callable[[], str]) -> None:
    """Refuse a solid with a residual stress or without stiffness in the undeformed state.

    Parameters
    ----------
    energy, P, C
        Ψ, stress (3, 3) and its derivative (3, 3, 3, 3) at F = I.
    hint
        Advice against a residual stress.

    Raises
    ------
    ValueError
        Ψ is not smooth at F = I, P is not zero, or an eigenvalue of C is not positive.
    """
    if not (np.isfinite(energy).all() and np.isfinite(P).all() and np.isfinite(C).all()):
        raise ValueError(
            "the energy, the stress or its derivative is not finite in the undeformed solid; expected an energy that "
            "is smooth at F = I, where J = 1 and I1 = I2 = 3"
        )
    scale = float(np.abs(C).max())
    residual = float(np.abs(P).max())
    if residual > STRESS_FREE * max(scale, 1e-300):
        i, j = np.unravel_index(int(np.abs(P).argmax()), (3, 3))
        advice = hint()
        raise ValueError(
            f"expected no stress in the undeformed solid, got P_{i + 1}{j + 1} = {P[i, j]:.6g} at F = I"
            + (f"; {advice}" if advice else "")
        )
    values, modes = np.linalg.eigh(kelvin(C))
    if values[0] <= POSITIVE * max(scale, 1e-300):
        share = float(modes[:3, 0].sum() ** 2) / 3
        mode = "a change of volume" if share > 0.5 else "a change of shape"
        raise ValueError(
            f"expected positive initial moduli, got {values[0]:.6g} for {mode} (smallest eigenvalue of the elasticity "
            f"tensor at F = I); raise the {'bulk' if share > 0.5 else 'shear'} stiffness"
        )
