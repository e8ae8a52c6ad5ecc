"""The laws of every sampler, for this one."""

from porocore.testing import SamplerSuite
from porocore_sampler_halton.sampler import HaltonSampler


class TestHaltonSampler(SamplerSuite):
    kit_version = "1"
    options = {"points": 4}
    budget = 16
    invalid_options = ({"no_such_option": 1}, {"points": 1}, {"points": 2.5}, {"points": True})

    @classmethod
    def make_sampler(cls, inputs, **options):
        return HaltonSampler(inputs, **options)
