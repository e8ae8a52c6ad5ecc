from porocore_surrogate_torch.conformance import SUITES

globals().update(SUITES)
