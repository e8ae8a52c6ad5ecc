"""Hooks of the built-in samplers, offered like those of plugins."""

from __future__ import annotations

from typing import Any

from porocore.plugins.hookspecs import Offer, hookimpl


def _density_sweep() -> type[Any]:
    from porocore.sampling.samplers.density import DensitySweep

    return DensitySweep


def _sobol() -> type[Any]:
    from porocore.sampling.samplers.designs import SobolDesign

    return SobolDesign


def _latin_hypercube() -> type[Any]:
    from porocore.sampling.samplers.designs import LatinHypercube

    return LatinHypercube


def _active() -> type[Any]:
    from porocore.sampling.samplers.active import Active

    return Active


def _macro_driven() -> type[Any]:
    from porocore.sampling.samplers.macro_driven import MacroDriven

    return MacroDriven


@hookimpl
def porocore_samplers() -> list[Offer]:
    """Offer sweeps, space-filling designs and two samplers that learn."""
    return [
        Offer(
            name="density-sweep",
            load=_density_sweep,
            summary="one input at a time; the step is halved where <∇u¹> bends (Dehghani & Zilian)",
        ),
        Offer(name="sobol", load=_sobol, summary="a scrambled Sobol sequence, with or without the corners"),
        Offer(
            name="latin-hypercube",
            load=_latin_hypercube,
            summary="each input takes as many values as there are states",
        ),
        Offer(
            name="active",
            load=_active,
            summary="round by round where a committee of surrogates disagrees",
        ),
        Offer(
            name="macro-driven",
            load=_macro_driven,
            summary="where macro runs with the present surrogate go, until their results stay",
        ),
    ]
