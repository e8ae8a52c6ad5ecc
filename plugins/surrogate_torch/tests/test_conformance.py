from porocore_surrogate_torch.conformance import (
    TestTorchPotential,
    TestTorchPotentialOnPolynomial,
    TestTorchSurrogate,
    TestTorchSurrogateWithTanh,
)

__all__ = [
    "TestTorchPotential",
    "TestTorchPotentialOnPolynomial",
    "TestTorchSurrogate",
    "TestTorchSurrogateWithTanh",
]
