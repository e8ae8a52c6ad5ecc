"""Polynomials as arrays of a file."""

from __future__ import annotations

import numpy as np

from porocore.states import Array
from porocore.surrogates.polynomial.monomials import Polynomial

#: Largest exponent of a polynomial, and the number of its monomials' divisors: far beyond any that was fitted.
MOST_EXPONENT, MOST_DIVISORS = 32, 1_000_000


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
    if (exponents < 0).any() or (exponents > MOST_EXPONENT).any() or (exponents % 1).any():
        raise ValueError(f"{name} has exponents that are none of 0 … {MOST_EXPONENT}")
    # A monomial is evaluated with all its divisors.
    if (exponents + 1).prod(axis=1).sum() > MOST_DIVISORS:
        raise ValueError(f"{name} has more monomials than can be evaluated")
    return Polynomial(exponents.astype(np.int64), coefficients)
