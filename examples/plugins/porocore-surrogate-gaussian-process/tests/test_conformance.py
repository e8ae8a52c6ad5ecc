"""pytest finds the laws where 'porocore plugin check' finds them too."""

from porocore_surrogate_gaussian_process.conformance import TestGaussianProcessSurrogate

__all__ = ["TestGaussianProcessSurrogate"]
