"""The laws that the surrogate of this plugin is held to, by its tests and by ``porocore plugin check``."""

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
