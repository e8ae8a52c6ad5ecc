"""What this plugin offers. Listing plugins imports this module, so it imports nothing heavy."""

from porocore import Offer, hookimpl

#: The version of the interface that this plugin was made for.
POROCORE_INTERFACES = {"sampler": 1}


def _load():
    from porocore_sampler_halton.sampler import HaltonSampler

    return HaltonSampler


def _suites():
    from porocore_sampler_halton.conformance import TestHaltonSampler

    return [TestHaltonSampler]


@hookimpl
def porocore_samplers():
    return [
        Offer(
            name="halton",
            load=_load,
            summary="a Halton sequence in the box of the inputs",
            requires=("scipy",),
            install="pip install porocore-sampler-halton",
            suites=_suites,
        )
    ]
