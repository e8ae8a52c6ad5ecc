"""The checks of every surrogate, for this one."""

from porocore.testing import SurrogateSuite
from porocore_surrogate_gaussian_process.surrogate import GaussianProcessSurrogate


class TestGaussianProcessSurrogate(SurrogateSuite):
    kit_version = "5"
    random = False
    resumable = False
    invalid_options = ({"no_such_option": 1}, {"noise": 0}, {"noise": "low"}, {"noise": True})

    @classmethod
    def make_surrogate(cls):
        return GaussianProcessSurrogate()
