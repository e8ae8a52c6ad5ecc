"""The laws of this plugin for pytest; 'porocore plugin check' runs the same laws."""

from porocore_sampler_halton.conformance import TestHaltonSampler

__all__ = ["TestHaltonSampler"]
