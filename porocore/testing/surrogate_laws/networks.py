"""Suites of the network models ``mlp`` and ``potential``, the same for all libraries.

A plugin names its class and the version of the kit that it passes, see :func:`network_suites`.
"""

from __future__ import annotations

from typing import Any, ClassVar

import pytest

from porocore.interfaces.surrogate import Surrogate
from porocore.surrogates.network import adam
from porocore.surrogates.network.surrogate import NetworkSurrogate
from porocore.testing.surrogate_laws.base import SurrogateSuite
from porocore.testing.surrogate_laws.network_training import NetworkTrainings
from porocore.testing.surrogate_laws.potential import PotentialSuite


class _Mlp(SurrogateSuite):
    """A suite of the model ``mlp``."""

    surrogate: ClassVar[type[NetworkSurrogate]]
    options: ClassVar[dict[str, Any]] = {"hidden": [20, 20], "learning_rate": 0.1}
    invalid_options = (
        {"hiden": [40]},
        {"hidden": []},
        {"hidden": [40, 0]},
        {"hidden": 40},
        {"activation": "relu"},
        {"epochs": 0},
        {"epochs": True},
        {"learning_rate": 0},
        {"validation_fraction": 0.9},
        {"patience": 1.5},
        {"device": "tpu"},
    )

    @classmethod
    def make_surrogate(cls) -> Surrogate:
        """Return the surrogate with two small layers."""
        return cls.surrogate(epochs=2000, **cls.options)

    def checkpoint_often(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Write a checkpoint at every validation."""
        monkeypatch.setattr(adam, "CHECKPOINT_INTERVAL", 0.0)


class MlpSuite(NetworkTrainings, _Mlp):
    """Laws of the model ``mlp``, those of its training included."""


class TanhMlpSuite(_Mlp):
    """Laws of the model ``mlp`` with the other activation."""

    options: ClassVar[dict[str, Any]] = {"hidden": [16, 16], "learning_rate": 0.05, "activation": "tanh"}


class NetworkPotentialSuite(PotentialSuite):
    """Laws of the model ``potential``."""

    surrogate: ClassVar[type[NetworkSurrogate]]
    options: ClassVar[dict[str, Any]] = {"hidden": [10, 10], "iterations": 150}
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
    def make_surrogate(cls) -> Surrogate:
        """Return the surrogate of a potential."""
        return cls.surrogate(model="potential", **cls.options)

    @classmethod
    def make_invalid(cls, options: dict[str, Any]) -> Surrogate:
        """Return the surrogate of a potential with wrong options."""
        return cls.surrogate(**({"model": "potential"} | options))


class AnchoredPotentialSuite(NetworkPotentialSuite):
    """Laws of the model ``potential`` with one layer on a polynomial."""

    options: ClassVar[dict[str, Any]] = {
        "hidden": [8],
        "iterations": 100,
        "activation": "tanh",
        "anchor": "polynomial",
    }


def network_suites(surrogate: type[NetworkSurrogate], kit_version: str, module: str) -> dict[str, type[Any]]:
    """Return the suites of both models, by the names that they have in a module of a plugin."""
    members = {"surrogate": surrogate, "kit_version": kit_version, "__module__": module}
    suites = {
        "TestMlp": MlpSuite,
        "TestMlpWithTanh": TanhMlpSuite,
        "TestPotential": NetworkPotentialSuite,
        "TestPotentialOnPolynomial": AnchoredPotentialSuite,
    }
    return {name: type(name, (suite,), members) for name, suite in suites.items()}
