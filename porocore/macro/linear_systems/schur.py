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
#: Elements that are treated at once, and the share of the stiffness that is added so that none is singular.
CHUNK, SHIFT = 4_000, 1e-10


def pressure_mass(tangent: MacroTangent, points: int) -> Array:
    """Return L (n,) at n points, for the Schur complement D − C A⁻¹ B ≈ D + ∫ L N N.

    L = a : ℂ⁻¹ : (−b) with a = ∂Δstorage/∂H, b = ∂P_E/∂p and ℂ = ∂P_E/∂H, all symmetrised: the storage that a change of
    the pressure brings about where the solid can follow it freely. Never negative. It is that of the mean tangent of an
    element, which a preconditioner tells from that of its points by no iteration.

    Parameters
    ----------
    tangent
        At n points, those of an element one after another.
    points
        Points of an element.
    """
    elements = len(tangent.storage_p) // points
    mass = np.empty(elements)
    for first in range(0, elements, CHUNK):
        last = min(first + CHUNK, elements)
        stiffness, a, b = (
            x[first * points : last * points].reshape(last - first, points, -1).mean(axis=1)
            for x in (tangent.stress_grad_u, tangent.storage_grad_u, tangent.stress_p)
        )
        C = _SYMMETRIC @ stiffness.reshape(-1, 9, 9) @ _SYMMETRIC.T
        largest = np.abs(C).max(axis=(1, 2), keepdims=True)
        pressed = -(b @ _SYMMETRIC.T)[:, :, None]
        strain = np.linalg.solve(C + SHIFT * largest * np.eye(6), pressed)[:, :, 0]
        mass[first:last] = ((a @ _SYMMETRIC.T) * strain).sum(axis=1)
    return np.repeat(np.maximum(mass, 0.0), points)
