"""What the pipeline decides by itself; whole studies are in tests/e2e."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.benchmark import benchmark_path
from porocore.config import load_config
from porocore.pipeline import undrained
from porocore.problem import Boundary
from porocore.reference import CellReference
from porocore.testing.synthetic import cubic_reference


@pytest.fixture
def config():
    return load_config(benchmark_path())


def reference(diagonal):
    return CellReference("", cubic_reference(), np.diag(diagonal), {})


def test_a_body_that_drains_is_not_warned_of(config):
    assert undrained(config, reference([1.0, 1.0, 1.0])) == []


def test_no_conductivity_towards_the_drained_face(config):
    (warning,) = undrained(config, reference([1.0, 1e-9, 1.0]))
    assert "y+" in warning


def test_no_drained_face(config):
    boundary = {**config.macro.boundary, "y+": Boundary(traction=(0.0, 1.0, 0.0))}
    closed = config.model_copy(update={"macro": config.macro.model_copy(update={"boundary": boundary})})
    (warning,) = undrained(closed, reference([1.0, 1.0, 1.0]))
    assert "no face has a prescribed pressure" in warning
