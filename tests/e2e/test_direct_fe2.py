"""The surrogate of the potential against direct FE², step by step: the judge of every surrogate."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.mark.slow
def test_a_polynomial_settles_as_the_cells_themselves_do(monkeypatch):
    """Ten elements, ten steps, P = −0.1; the mean-gradient closure shows what a gap looks like."""
    monkeypatch.setattr(sys, "path", [str(BENCHMARKS), *sys.path])
    from direct_fe2 import ELEMENTS, LOAD, compare

    assert (ELEMENTS, LOAD) == (10, -0.1)
    found = compare()
    assert len(found.time) == 11
    assert found.direct[-1] > 1.3
    assert np.abs(found.gaps).max() < 0.05  # per cent; 0.5 is asked for
    assert np.abs(found.mean_gradient[1:] / found.direct[1:] - 1).max() > 0.03
    assert found.work.failed == 0
    assert found.work.solves < found.work.points / 5
    assert found.seconds["direct"] > 20 * found.seconds["surrogate"]
