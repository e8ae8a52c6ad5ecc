"""Mass matrix that approximates the Schur complement of the pressure in a preconditioner."""

from __future__ import annotations

import numpy as np

from porocore.interfaces.law import MacroTangent
from porocore.states import Array

_PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
#: (6, 9) orthonormal symmetric tensors, so that products of them are those of their components.
_SYMMETRIC = np.array(
    [
        (
            (np.eye(3)[i][:, None] * np.eye(3)[j] + np.eye(3)[j][:, None] * np.eye(3)[i])
            / (2 if i == j else 2**0.5)
        )
        for i, j in _PAIRS
    ]
).reshape(6, 9)
#: Points that are treated at once, and the share of the stiffness that is added so that none is singular.
CHUNK, SHIFT = 50_000, 1e-10


def pressure_mass(tangent: MacroTangent) -> Array:
    """Return L (n,) at n points, for the Schur complement D − C A⁻¹ B ≈ D + ∫ L N N.

    L = a : ℂ⁻¹ : (−b) with a = ∂Δstorage/∂H, b = ∂P_E/∂p and ℂ = ∂P_E/∂H, all symmetrised: the storage that a change of
    the pressure brings about where the solid can follow it freely. Never negative.
    """
    n = len(tangent.storage_p)
    mass = np.empty(n)
    for first in range(0, n, CHUNK):
        part = slice(first, first + CHUNK)
        stiffness = _SYMMETRIC @ tangent.stress_grad_u[part].reshape(-1, 9, 9) @ _SYMMETRIC.T
        a, b = (x[part].reshape(-1, 9) @ _SYMMETRIC.T for x in (tangent.storage_grad_u, tangent.stress_p))
        largest = np.abs(stiffness).max(axis=(1, 2), keepdims=True)
        strain = np.linalg.solve(stiffness + SHIFT * largest * np.eye(6), -b[:, :, None])[:, :, 0]
        mass[part] = (a * strain).sum(axis=1)
    return np.maximum(mass, 0.0)
