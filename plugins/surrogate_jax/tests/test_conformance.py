from porocore_surrogate_jax.conformance import (
    TestMlp,
    TestMlpWithTanh,
    TestPotential,
    TestPotentialOnPolynomial,
)

__all__ = ["TestMlp", "TestMlpWithTanh", "TestPotential", "TestPotentialOnPolynomial"]
