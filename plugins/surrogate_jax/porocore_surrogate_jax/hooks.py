"""Offer of this plugin, the surrogate ``jax``, without importing jax."""

from __future__ import annotations

from typing import Any

from porocore import Offer, hookimpl


def _networks() -> type[Any]:
    from porocore_surrogate_jax.surrogate import JaxSurrogate

    return JaxSurrogate


def _suites() -> list[type[Any]]:
    from porocore_surrogate_jax.conformance import SUITES

    return list(SUITES.values())


@hookimpl
def porocore_surrogates() -> list[Offer]:
    """Offer the network of Dehghani & Zilian and that of the potential."""
    return [
        Offer(
            name="jax",
            load=_networks,
            summary="networks for <∇u¹> (Dehghani & Zilian) and for W(ln U, p), compiled by JAX",
            requires=("jax",),
            install="pip install porocore-surrogate-jax",
            suites=_suites,
        )
    ]
