"""What this plugin offers, described without importing torch."""

from __future__ import annotations

from typing import Any

from porocore import Offer, hookimpl


def _mlp() -> type[Any]:
    from porocore_surrogate_torch.surrogate import TorchSurrogate

    return TorchSurrogate


@hookimpl
def porocore_surrogates() -> list[Offer]:
    """The network of Dehghani & Zilian, exact at the reference state."""
    return [
        Offer(
            name="torch",
            load=_mlp,
            summary="3 × 40 sigmoid network for <∇u¹>, exact linear limit (Dehghani & Zilian)",
            requires=("torch",),
            install="pip install porocore-surrogate-torch",
        )
    ]
