"""Loss of rank-one convexity: the acoustic tensor, and its smallest eigenvalue over all directions.

Q_ik(n) = A_ijkl n_j n_l with A = ∂P_E/∂H at fixed p, the drained tangent. Where m·Q(n)m < 0 for some n and m, a jump of
F by m ⊗ n lowers the energy to second order: the macroscopic problem loses ellipticity, and bands may form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from porocore.states import Array

#: Directions on the half sphere, about 2.5° apart.
DIRECTIONS = 4000
#: Number of sampled minima that are refined.
REFINED = 12
ITERATIONS = 500


@dataclass(frozen=True, eq=False)
class AcousticMinimum:
    """Smallest m·Q(n)m over unit vectors.

    Attributes
    ----------
    value : float
        Minimum [E]; the material is strongly elliptic where it is positive.
    direction : (3,)
        n, normal of the band.
    polarisation : (3,)
        m, direction of the jump.
    """

    value: float
    direction: Array
    polarisation: Array


def acoustic_tensor(A: Array, n: Array) -> Array:
    """Return Q (..., 3, 3), symmetrised, for directions (..., 3)."""
    Q = np.einsum("ijkl,...j,...l->...ik", A, n, n, optimize=True)
    return np.asarray((Q + np.swapaxes(Q, -1, -2)) / 2)


def acoustic_minimum(A: Array) -> AcousticMinimum:
    """Return the minimum of A = ∂P_ij/∂H_kl over all directions, all NaN where A is not finite.

    A fine sample is followed by descent from its best points.
    """
    if not np.isfinite(A).all():
        return AcousticMinimum(float("nan"), np.full(3, np.nan), np.full(3, np.nan))
    sample = half_sphere(DIRECTIONS)
    lowest = np.linalg.eigvalsh(acoustic_tensor(A, sample))[:, 0]
    n = sample[np.argsort(lowest, kind="stable")[:REFINED]]
    best = np.inf
    for _ in range(ITERATIONS):
        m = np.linalg.eigh(acoustic_tensor(A, n))[1][..., 0]
        # At fixed m the form is quadratic in n: each half step takes its minimum.
        by_n = np.einsum("ijkl,ai,ak->ajl", A, m, m, optimize=True)
        values, vectors = np.linalg.eigh((by_n + by_n.transpose(0, 2, 1)) / 2)
        n = vectors[..., 0]
        value = float(values[:, 0].min())
        if best - value <= 1e-12 * np.abs(A).max():
            break
        best = value
    values, vectors = np.linalg.eigh(acoustic_tensor(A, n))
    first = int(values[:, 0].argmin())
    return AcousticMinimum(float(values[first, 0]), _upward(n[first]), _upward(vectors[first, :, 0]))


def half_sphere(count: int) -> Array:
    """Return directions (count, 3) spread evenly over the half sphere z > 0, by the golden angle."""
    k = np.arange(count) + 0.5
    z = k / count
    angle = np.pi * (3 - np.sqrt(5)) * k
    r = np.sqrt(1 - z * z)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])


def _upward(n: Array) -> Array:
    """Return n or −n, whichever has a positive largest component."""
    return np.asarray(n * np.sign(n[np.abs(n).argmax()]))
