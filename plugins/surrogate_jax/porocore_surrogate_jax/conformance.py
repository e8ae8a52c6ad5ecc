"""Conformance suites of this plugin, for its tests and for ``porocore plugin check``."""

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
