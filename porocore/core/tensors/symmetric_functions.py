"""Logarithm and exponential of symmetric matrices, and the derivative of the exponential."""

from __future__ import annotations

import numpy as np

from porocore.states import Array


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
