"""The built-in samplers, offered through the same door as those of plugins."""

from __future__ import annotations

from typing import Any

from porocore.hookspecs import Offer, hookimpl


def _density_sweep() -> type[Any]:
    from porocore.sampling.density import DensitySweep

    return DensitySweep


@hookimpl
def porocore_samplers() -> list[Offer]:
    """One-factor-at-a-time sweeps with a check of the output density."""
    return [
        Offer(
            name="density-sweep",
            load=_density_sweep,
            summary="one input at a time; the step is halved where <∇u¹> bends (Dehghani & Zilian)",
        )
    ]
