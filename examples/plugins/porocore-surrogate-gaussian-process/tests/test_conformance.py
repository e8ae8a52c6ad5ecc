"""The checks of this plugin for pytest; 'porocore plugin check' runs the same checks."""

from porocore_surrogate_gaussian_process.conformance import TestGaussianProcessSurrogate

__all__ = ["TestGaussianProcessSurrogate"]
