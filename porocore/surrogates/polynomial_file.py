"""Polynomials among the arrays of a file."""

from __future__ import annotations

import numpy as np

from porocore.states import Array
from porocore.surrogates.monomials import Polynomial


def pack_polynomial(polynomial: Polynomial, name: str, arrays: dict[str, Array]) -> None:
    """Add a polynomial to the arrays of a file, under a name."""
    arrays[f"{name}/exponents"] = polynomial.exponents.astype(float)
    arrays[f"{name}/coefficients"] = polynomial.coefficients


def unpack_polynomial(arrays: dict[str, Array], name: str, variables: int, outputs: int) -> Polynomial:
    """Return the polynomial of that name.

    Raises
    ------
    KeyError, ValueError
        It is not there, or not in so many variables and outputs.
    """
    exponents = arrays[f"{name}/exponents"]
    coefficients = arrays[f"{name}/coefficients"]
    if (
        exponents.ndim != 2
        or exponents.shape[1] != variables
        or coefficients.shape != (outputs, len(exponents))
    ):
        raise ValueError(f"{name} has shapes {exponents.shape} and {coefficients.shape}")
    if (exponents < 0).any() or (exponents > 64).any() or (exponents % 1).any():
        raise ValueError(f"{name} has exponents that are none")
    return Polynomial(exponents.astype(np.int64), coefficients)
