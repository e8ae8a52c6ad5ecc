"""The laws of this plugin for pytest; 'porocore plugin check' runs the same laws."""

from porocore_surrogate_gaussian_process.conformance import TestGaussianProcessSurrogate

__all__ = ["TestGaussianProcessSurrogate"]
