"""Laws of the training of the model ``mlp``: kept weights, patience, checkpoints, a linear cell."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from porocore.errors import DataError
from porocore.interfaces.surrogate import TrainingProgress, TrainingSet
from porocore.surrogates.file.archive import read_archive
from porocore.surrogates.network.surrogate import NetworkSurrogate
from porocore.surrogates.network.training_state import FORMAT
from porocore.testing.compare import assert_identical
from porocore.testing.expect import holds, near, refused, require, same
from porocore.testing.surrogate_laws.fitting import Fitting

#: With a learning rate this large the validation loss goes up and down.
PATIENCE = 50
RESTLESS: dict[str, Any] = {"epochs": 3000, "hidden": [10], "learning_rate": 0.5, "patience": PATIENCE}
#: Epochs of a training that ends as planned.
SHORT = 100
#: A network that adds nothing leaves the linear prediction to round-off.
ROUND_OFF = 1e-15


class NetworkTrainings(Fitting):
    """Part of :class:`porocore.testing.surrogate_laws.networks.MlpSuite`."""

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
        network = fitted._fitted().network.as_numpy
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
