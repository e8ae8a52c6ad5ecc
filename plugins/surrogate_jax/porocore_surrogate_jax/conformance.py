"""The laws that the surrogate of this plugin is held to, by its tests and by ``porocore plugin check``."""

from porocore.testing.surrogate_laws.networks import (
    AnchoredPotentialSuite,
    MlpSuite,
    NetworkPotentialSuite,
    TanhMlpSuite,
)
from porocore_surrogate_jax.surrogate import JaxSurrogate


class TestMlp(MlpSuite):
    kit_version = "3"
    surrogate = JaxSurrogate


class TestMlpWithTanh(TanhMlpSuite):
    kit_version = "3"
    surrogate = JaxSurrogate


class TestPotential(NetworkPotentialSuite):
    kit_version = "3"
    surrogate = JaxSurrogate


class TestPotentialOnPolynomial(AnchoredPotentialSuite):
    kit_version = "3"
    surrogate = JaxSurrogate
