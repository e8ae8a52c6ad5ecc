"""The checks of this plugin for pytest; 'porocore plugin check' runs the same checks."""

from porocore_sampler_halton.conformance import TestHaltonSampler

__all__ = ["TestHaltonSampler"]
