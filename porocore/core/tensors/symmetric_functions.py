"""Eigenvalues, logarithm and exponential of symmetric matrices; derivative of the exponential."""

from __future__ import annotations

import numpy as np

from porocore.states import Array

#: Of Jacobi's rotations at most; entries off the diagonal count as zero below this share of the trace.
SWEEPS, ROUND_OFF = 8, 1e-18
#: Keeps 0/0 away.
TINY = 1e-300


def symmetric_eigen(A: Array) -> tuple[Array, Array]:
    """Return eigenvalues (3, n) and eigenvectors (3, 3, n), in columns, of symmetric A (3, 3, n).

    By Jacobi's rotations, which converge quadratically; for thousands of matrices at once they are faster than a
    call of LAPACK for each.
    """
    d = np.stack([A[i, i] for i in range(3)])
    off = np.stack([A[1, 2], A[0, 2], A[0, 1]])  # by the third axis
    Q = np.zeros_like(A)  # eigenvectors in rows, so that a rotation mixes two blocks of memory
    Q[0, 0] = Q[1, 1] = Q[2, 2] = 1.0
    smallest = ROUND_OFF * d.sum(axis=0)
    for _ in range(SWEEPS):
        if (np.abs(off).max(axis=0) <= smallest).all():
            break
        for i, j, k in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
            e = off[k]
            gap = d[j] - d[i]
            gap *= 0.5
            t = np.sqrt(gap * gap + e * e)
            t += np.abs(gap)
            t += TINY
            t = e / np.copysign(t, gap, out=t)
            c = t * t
            c += 1.0
            np.sqrt(c, out=c)
            np.divide(1.0, c, out=c)
            s = t * c
            t *= e
            d[i] -= t
            d[j] += t
            off[k] = 0.0
            before = off[j].copy()
            off[j] *= c
            off[j] -= s * off[i]
            off[i] *= c
            off[i] += s * before
            turned = s * Q[i]
            Q[i] *= c
            Q[i] -= s * Q[j]
            Q[j] *= c
            Q[j] += turned
    return d, Q.swapaxes(0, 1)


def logarithm(A: Array) -> Array:
    """Return ln A (..., r, r) of symmetric A; NaN where A is not positive definite."""
    values, vectors = np.linalg.eigh(A)
    with np.errstate(invalid="ignore", divide="ignore"):
        logs = np.where(values > 0, np.log(values), np.nan)
    return _composed(logs, vectors)


def exponential(A: Array) -> Array:
    """Return exp A (..., r, r) of symmetric A, symmetric and positive definite."""
    values, vectors = np.linalg.eigh(A)
    return _composed(np.exp(values), vectors)


def symmetric_exponential(A: Array, directions: Array) -> tuple[Array, Array]:
    """Return exp A (n, r, r) of symmetric A, and its derivatives (n, d, r, r) along symmetric ``directions``.

    In the eigenbasis a derivative is the direction times the divided differences of exp, entry by entry (Daleckii &
    Krein 1965; Higham, Functions of Matrices, ch. 3): (eˣ − eʸ)/(x − y) = e^((x+y)/2) sinh(z)/z with z = (x − y)/2.
    """
    values, vectors = np.linalg.eigh(A)
    half = (values[:, :, None] - values[:, None, :]) / 2
    mean = (values[:, :, None] + values[:, None, :]) / 2
    size = np.maximum(np.abs(half), 1e-150)
    differences = np.exp(mean) * np.sinh(size) / size
    turned = vectors.swapaxes(-1, -2)[:, None] @ directions @ vectors[:, None]
    slopes: Array = vectors[:, None] @ (differences[:, None] * turned) @ vectors.swapaxes(-1, -2)[:, None]
    return _composed(np.exp(values), vectors), slopes


def _composed(values: Array, vectors: Array) -> Array:
    composed: Array = (vectors * values[..., None, :]) @ vectors.swapaxes(-1, -2)
    return composed


def symmetric_logarithm(A: Array, directions: Array) -> tuple[Array, Array]:
    """Return ln A (n, r, r) of symmetric positive definite A, and its derivatives (n, d, r, r) along ``directions``.

    (ln x − ln y)/(x − y) = (z/tanh z)/mean with z = (ln x − ln y)/2 and the arithmetic mean of x and y is exact where
    x and y are close: tanh z = (x − y)/(x + y).
    """
    values, vectors = np.linalg.eigh(A)
    logs = np.log(values)
    half = (logs[:, :, None] - logs[:, None, :]) / 2
    mean = (values[:, :, None] + values[:, None, :]) / 2
    size = np.maximum(np.abs(half), 1e-150)
    differences = size / np.tanh(size) / mean
    turned = vectors.swapaxes(-1, -2)[:, None] @ directions @ vectors[:, None]
    slopes: Array = vectors[:, None] @ (differences[:, None] * turned) @ vectors.swapaxes(-1, -2)[:, None]
    return _composed(logs, vectors), slopes
