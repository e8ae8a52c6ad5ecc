"""Suites of the network models ``mlp`` and ``potential``, the same for all libraries.

A plugin names its class and the version of the kit that it passes, see :func:`network_suites`.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from porocore.errors import DataError
from porocore.interfaces.surrogate import Surrogate, TrainingProgress, TrainingSet
from porocore.surrogates.file.file import read_archive
from porocore.surrogates.network import training as adam
from porocore.surrogates.network.surrogate import NetworkSurrogate
from porocore.surrogates.network.training import FORMAT
from porocore.testing.expect import assert_identical, holds, near, refused, require, same
from porocore.testing.surrogate_checks.base import PotentialSuite, SurrogateSuite
from porocore.testing.surrogate_checks.training import Fitting

#: With a learning rate this large the validation loss goes up and down.
PATIENCE = 50
RESTLESS: dict[str, Any] = {"epochs": 3000, "hidden": [10], "learning_rate": 0.5, "patience": PATIENCE}
#: Epochs of a training that ends as planned.
SHORT = 100
#: A network that adds nothing leaves the linear prediction to round-off.
ROUND_OFF = 1e-15


class NetworkTrainings(Fitting):
    """Part of :class:`porocore.testing.surrogate_checks.networks.MlpSuite`."""

    surrogate: ClassVar[type[NetworkSurrogate]]

    def test_the_best_weights_are_kept_and_patience_ends_the_training(
        self, data: TrainingSet, tmp_path: Path
    ) -> None:
        path = tmp_path / "training.h5"
        reports: list[TrainingProgress] = []
        fitted: Any = self.surrogate(**RESTLESS).fit(
            data, seed=1, checkpoint=path, on_progress=reports.append
        )
        header, arrays = read_archive(path, FORMAT, 1, "")
        best, last = int(header["best_epoch"]), reports[-1]
        state = f"a learning rate of {RESTLESS['learning_rate']}, patience {PATIENCE}"
        same("last epoch", header["epoch"], best + PATIENCE, state)
        same("last report", (last.epoch, last.ends, last.left), (best + PATIENCE, best + PATIENCE, 0), state)
        ends = [(each.epoch, each.ends or 0) for each in reports[:-1]]
        holds(
            all(at < end <= at + PATIENCE for at, end in ends),
            state,
            f"ends at most {PATIENCE} epochs ahead",
            ends,
        )
        holds(header["best_loss"] < last.validation_loss, state, "a best loss below the last one", header)
        least = min(each.validation_loss for each in reports)
        holds(header["best_loss"] <= least, state, f"a best loss of at most {least:g}", header["best_loss"])
        network = fitted.fitted.network.as_numpy
        kept = [array.ravel() for pair in zip(network.weights, network.biases, strict=True) for array in pair]
        same("weights", np.concatenate(kept), arrays["best_theta"], state)
        holds(
            (arrays["best_theta"] != arrays["theta"]).any(), state, "other weights than the last", "the same"
        )

    def test_a_finished_training_is_not_repeated(
        self, data: TrainingSet, unseen: TrainingSet, tmp_path: Path
    ) -> None:
        path = tmp_path / "training.h5"
        reports: list[TrainingProgress] = []
        first = self.surrogate(epochs=SHORT).fit(data, seed=1, checkpoint=path)
        again = self.surrogate(epochs=SHORT).fit(data, seed=1, checkpoint=path, on_progress=reports.append)
        state = "the checkpoint of a finished training"
        holds(not reports, state, "no training", f"{len(reports)} reports of one")
        assert_identical(again.predict(unseen.states), first.predict(unseen.states), state)

    def test_a_checkpoint_of_other_options_is_refused(self, data: TrainingSet, tmp_path: Path) -> None:
        path = tmp_path / "training.h5"
        self.surrogate(epochs=SHORT).fit(data, seed=1, checkpoint=path)
        state = f"the checkpoint of {SHORT} epochs, for {2 * SHORT}"
        with refused(DataError, state=state, naming=("other data, options or seed; move it",)):
            self.surrogate(epochs=2 * SHORT).fit(data, seed=1, checkpoint=path)

    def test_a_linear_cell_needs_no_network(self, data: TrainingSet, tmp_path: Path) -> None:
        tangent, path = data.reference.tangent, tmp_path / "linear.h5"
        assert tangent is not None
        assert tangent.mean_grad_grad_u is not None
        assert tangent.mean_grad_p is not None
        by_H, by_p = tangent.mean_grad_grad_u[0], tangent.mean_grad_p[0]
        linear = np.einsum("ijkl,nkl->nij", by_H, data.states.grad_u) + by_p * data.states.p[:, None, None]
        responses = replace(data.responses, mean_grad=linear)
        self.surrogate().fit(replace(data, responses=responses), seed=0).save(path)
        found = self.surrogate.load(path).predict(data.states)
        slopes = require("tangent", found.tangent, "a linear cell")
        near("mean_grad", found.mean_grad, linear, "a linear cell", within=ROUND_OFF)
        found_by_H = require("dmean_grad/dH", slopes.mean_grad_grad_u, "a linear cell")
        same("dmean_grad/dH", found_by_H[7], by_H, "a linear cell")


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
    """Checks of the model ``mlp``, those of its training included."""


class TanhMlpSuite(_Mlp):
    """Checks of the model ``mlp`` with the other activation."""

    options: ClassVar[dict[str, Any]] = {"hidden": [16, 16], "learning_rate": 0.05, "activation": "tanh"}


class NetworkPotentialSuite(PotentialSuite):
    """Checks of the model ``potential``."""

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
    """Checks of the model ``potential`` with one layer on a polynomial."""

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
