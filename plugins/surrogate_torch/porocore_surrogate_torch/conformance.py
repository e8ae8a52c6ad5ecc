"""Conformance suites of this plugin: those of the networks, for its tests and ``porocore plugin check``."""

from porocore.testing.surrogate_checks.networks import network_suites
from porocore_surrogate_torch.surrogate import TorchSurrogate

SUITES = network_suites(TorchSurrogate, "5", __name__)
globals().update(SUITES)
