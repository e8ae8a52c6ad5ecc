"""Offer of the surrogate that comes with porocore, the polynomial."""

from __future__ import annotations

from typing import Any

from porocore.plugins.hookspecs import Offer, hookimpl


def _polynomial() -> type[Any]:
    from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate

    return PolynomialSurrogate


@hookimpl
def porocore_surrogates() -> list[Offer]:
    """Offer the polynomial of the potential."""
    return [
        Offer(
            "polynomial",
            _polynomial,
            "least-squares polynomial for W(ln U, p), with <∇u¹> beside it for mean-gradient; numpy only",
        )
    ]
