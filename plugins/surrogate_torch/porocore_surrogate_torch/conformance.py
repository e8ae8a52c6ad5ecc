"""Conformance suites of this plugin, for its tests and for ``porocore plugin check``."""

from porocore.testing.surrogate_laws.networks import (
    AnchoredPotentialSuite,
    MlpSuite,
    NetworkPotentialSuite,
    TanhMlpSuite,
)
from porocore_surrogate_torch.surrogate import TorchSurrogate


class TestTorchSurrogate(MlpSuite):
    kit_version = "3"
    surrogate = TorchSurrogate


class TestTorchSurrogateWithTanh(TanhMlpSuite):
    kit_version = "3"
    surrogate = TorchSurrogate


class TestTorchPotential(NetworkPotentialSuite):
    kit_version = "3"
    surrogate = TorchSurrogate


class TestTorchPotentialOnPolynomial(AnchoredPotentialSuite):
    kit_version = "3"
    surrogate = TorchSurrogate
