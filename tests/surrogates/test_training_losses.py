"""Losses of a training: told and kept as they are, with a validation only where states are kept for it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from porocore.interfaces.surrogate import TrainingProgress
from porocore.study.run.training import TrainingCurveFile, read_training_curve
from porocore.surrogates.network.sobolev import train


class Bowl:
    """A problem of one weight layer whose loss is a quadratic function; also its automatic differentiation."""

    x = np.zeros((1, 2))
    xp = np

    def loss(self, xp, shapes, activation):
        return None

    def constants(self):
        return {}

    def compile(self, loss, constants):
        curvature = 10.0 ** np.arange(3)
        return lambda theta: (float(curvature @ theta**2) + 1.0, 2 * curvature * theta)


@pytest.mark.parametrize(
    ("iterations", "ended"), [(1, "stopped by the limit of iterations"), (500, "converged")]
)
def test_a_potential_counts_iterations_and_tells_how_they_ended(iterations, ended):
    reports = []
    options = {"hidden": (), "activation": "tanh", "seed": 0, "iterations": iterations}
    train(Bowl(), Bowl(), **options, on_progress=reports.append)
    last = reports[-1]
    assert (last.unit, last.ended, last.left) == ("iterations", ended, 0.0)
    assert math.isnan(last.validation_loss)
    assert last.words.startswith("loss ")
    assert last.words.endswith(f", {ended}")
    assert "validation" not in last.words


def test_the_words_have_a_validation_where_there_is_one():
    assert TrainingProgress(1, 2, 1e-3, 2e-3).words == "loss 1.00e-03, validation 2.00e-03"
    assert TrainingProgress(1, 1, math.nan).words == ""


def test_a_file_without_validation_is_read_and_continued(tmp_path):
    path = tmp_path / "training.csv"
    TrainingCurveFile(path).add(TrainingProgress(25, 100, 1e-3))
    again = TrainingCurveFile(path)
    again.add(TrainingProgress(25, 100, 1e-3))
    again.add(TrainingProgress(50, 100, 1e-4))
    assert path.read_text().splitlines()[1] == "25,1.000000e-03,nan"
    np.testing.assert_array_equal(read_training_curve(path), [[25, 1e-3, np.nan], [50, 1e-4, np.nan]])


def test_a_file_with_validation_of_an_older_run_is_read(tmp_path):
    path = tmp_path / "training.csv"
    path.write_text("epoch,loss,validation_loss\n10,1e-3,2e-3\n")
    np.testing.assert_array_equal(read_training_curve(path), [[10, 1e-3, 2e-3]])
