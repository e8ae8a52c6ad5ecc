"""pytest finds the laws where 'porocore plugin check' finds them too."""

from porocore_sampler_halton.conformance import TestHaltonSampler

__all__ = ["TestHaltonSampler"]
