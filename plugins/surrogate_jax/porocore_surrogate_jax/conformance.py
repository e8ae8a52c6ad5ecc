"""The laws that the surrogate of this plugin is held to, by its tests and by ``porocore plugin check``."""

from porocore.surrogates.network import adam
from porocore.testing import PotentialSuite, SurrogateSuite
from porocore_surrogate_jax.surrogate import JaxSurrogate


class TestMlp(SurrogateSuite):
    kit_version = "3"
    invalid_options = (
        {"hiden": [40]},
        {"hidden": []},
        {"hidden": [40, 0]},
        {"activation": "relu"},
        {"epochs": 0},
        {"learning_rate": 0},
        {"validation_fraction": 0.9},
        {"patience": 1.5},
        {"device": "tpu"},
    )

    @classmethod
    def make_surrogate(cls):
        return JaxSurrogate(epochs=2000, hidden=[20, 20], learning_rate=0.1)

    def checkpoint_often(self, monkeypatch):
        monkeypatch.setattr(adam, "CHECKPOINT_INTERVAL", 0.0)


class TestMlpWithTanh(SurrogateSuite):
    kit_version = "3"

    @classmethod
    def make_surrogate(cls):
        return JaxSurrogate(epochs=2000, hidden=[16, 16], learning_rate=0.05, activation="tanh")

    def checkpoint_often(self, monkeypatch):
        monkeypatch.setattr(adam, "CHECKPOINT_INTERVAL", 0.0)


class TestPotential(PotentialSuite):
    kit_version = "3"
    resumable = False
    invalid_options = (
        {"model": "tree"},
        {"hidden": []},
        {"activation": "relu"},
        {"iterations": 0},
        {"epochs": 10},
        {"symmetry": "hexagonal"},
        {"anchor": "spline"},
        {"derivatives": "no"},
        {"device": "tpu"},
    )

    @classmethod
    def make_surrogate(cls):
        return JaxSurrogate(model="potential", iterations=150, hidden=[10, 10])

    @classmethod
    def make_invalid(cls, options):
        return JaxSurrogate(**({"model": "potential"} | options))


class TestPotentialOnPolynomial(PotentialSuite):
    kit_version = "3"
    resumable = False

    @classmethod
    def make_surrogate(cls):
        return JaxSurrogate(
            model="potential", iterations=100, hidden=[8], activation="tanh", anchor="polynomial"
        )
