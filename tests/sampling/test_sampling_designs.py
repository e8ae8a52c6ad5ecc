"""Sobol sequences and Latin hypercubes."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.errors import ConfigurationError
from porocore.sampling.samplers.designs import Design, LatinHypercube, SobolDesign

INPUTS = InputSpace(("H11", "H22", "p"), (-0.1, -0.4, 0.0), (0.1, 0.0, 0.2))


def points(design: Design) -> np.ndarray:
    design.ask()
    return design.points


def test_a_larger_sobol_design_begins_with_the_smaller() -> None:
    assert (points(SobolDesign(INPUTS, count=50))[:20] == points(SobolDesign(INPUTS, count=20))).all()


@pytest.mark.parametrize("power", [3, 5, 7])
def test_sobol_points_are_balanced(power: int) -> None:
    """Every half, quarter, … of an input's range holds its share of 2^k points."""
    x = points(SobolDesign(INPUTS, count=2**power, seed=4))
    for column in x.T:
        assert (np.sort(np.floor(column * 2**power)) == np.arange(2**power)).all()


@pytest.mark.parametrize("count", [1, 17, 1500])
def test_each_slice_of_a_latin_hypercube_holds_one_state(count: int) -> None:
    x = points(LatinHypercube(INPUTS, count=count, seed=2))
    for column in x.T:
        assert (np.sort(np.floor(column * count)) == np.arange(count)).all()


@pytest.mark.parametrize("design", [SobolDesign, LatinHypercube])
def test_the_corners_come_first_if_they_are_wanted(design: type[Design]) -> None:
    requests = design(INPUTS, count=20, corners=True).ask()
    assert len(requests) == 20
    corners = {request.x for request in requests[:8]}
    assert corners == {(a, b, c) for a in (-0.1, 0.1) for b in (-0.4, 0.0) for c in (0.0, 0.2)}
    assert len(design(INPUTS, count=8, corners=True).ask()) == 8
    with pytest.raises(ConfigurationError, match="7 states are fewer than the 8 corners of 3 inputs"):
        design(INPUTS, count=7, corners=True)


def test_too_many_corners_are_refused() -> None:
    nine = InputSpace.from_ranges({f"H{i}{j}": (-0.1, 0.1) for i in (1, 2, 3) for j in (1, 2, 3)})
    with pytest.raises(ConfigurationError, match=r"sampling.options.corners: 9 inputs have 512 corners"):
        SobolDesign(nine, count=600, corners=True)
    with pytest.raises(ConfigurationError, match="must be true or false"):
        SobolDesign(INPUTS, corners=1)


@pytest.mark.parametrize("design", [SobolDesign, LatinHypercube])
def test_designs_take_no_tolerance(design: type[Design]) -> None:
    with pytest.raises(ConfigurationError, match=r"sampling.tolerance: .* takes no tolerance"):
        design(INPUTS, tolerance=0.1)
