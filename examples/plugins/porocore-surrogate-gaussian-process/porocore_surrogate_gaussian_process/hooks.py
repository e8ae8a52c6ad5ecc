"""What this plugin offers. Listing plugins imports this module, so it imports nothing heavy."""

from porocore import Offer, hookimpl

#: The version of the interface that this plugin was made for.
POROCORE_INTERFACES = {"surrogate": 1}


def _load():
    from porocore_surrogate_gaussian_process.surrogate import GaussianProcessSurrogate

    return GaussianProcessSurrogate


def _suites():
    from porocore_surrogate_gaussian_process.conformance import TestGaussianProcessSurrogate

    return [TestGaussianProcessSurrogate]


@hookimpl
def porocore_surrogates():
    return [
        Offer(
            name="gaussian-process",
            load=_load,
            summary="a Gaussian process for <∇u¹>, with its uncertainty",
            requires=("scipy",),
            install="pip install porocore-surrogate-gaussian-process",
            suites=_suites,
        )
    ]
