"""The checks of every sampler, for this one."""

from typing import ClassVar

from porocore.testing import SamplerSuite
from porocore_sampler_halton.sampler import HaltonSampler


class TestHaltonSampler(SamplerSuite):
    kit_version = "5"
    options: ClassVar = {"count": 24}
    budget = 24
    invalid_options = ({"no_such_option": 1}, {"count": 0}, {"count": True}, {"seed": -1})

    @classmethod
    def make_sampler(cls, inputs, **options):
        return HaltonSampler(inputs, **options)
