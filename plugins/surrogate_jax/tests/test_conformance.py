from porocore_surrogate_jax.conformance import SUITES

globals().update(SUITES)
