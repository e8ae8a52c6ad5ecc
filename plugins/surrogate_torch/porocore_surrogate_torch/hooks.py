"""Offer of this plugin, the surrogate ``torch``, without importing torch."""

from __future__ import annotations

from typing import Any

from porocore import Offer, hookimpl


def _networks() -> type[Any]:
    from porocore_surrogate_torch.surrogate import TorchSurrogate

    return TorchSurrogate


def _suites() -> list[type[Any]]:
    from porocore_surrogate_torch.conformance import SUITES

    return list(SUITES.values())


@hookimpl
def porocore_surrogates() -> list[Offer]:
    """Offer the network of Dehghani & Zilian and that of the potential."""
    return [
        Offer(
            name="torch",
            load=_networks,
            summary="networks for <∇u¹> (Dehghani & Zilian) and for W(ln U, p), trained by PyTorch",
            requires=("torch",),
            install="pip install porocore-surrogate-torch",
            suites=_suites,
        )
    ]
