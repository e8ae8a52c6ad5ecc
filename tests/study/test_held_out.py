"""Held-out states of a study: between the samples where these do not fill the ranges, and what gives more samples."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.core.inputs import SampledRange
from porocore.sampling.samplers.designs import RandomStates
from porocore.study.config.loading import load_config
from porocore.study.run.composition import drop_misplaced, held_out_states
from porocore.study.run.summary import _more_states
from tests.helpers.campaigns import sample
from tests.helpers.fake_cell import INPUTS

EXAMPLES = Path(__file__).parents[2] / "examples"


def study(sampler: str) -> Any:
    test = SimpleNamespace(count=12, seed=1)
    sampling = SimpleNamespace(test=test, sampler=sampler)
    return SimpleNamespace(sampling=sampling, input_space=lambda: INPUTS, cell=Cell())


def near_rest(path: Path, share: float) -> Any:
    """Samples within a share of the ranges around the undeformed cell."""
    low, high = np.array(INPUTS.lower), np.array(INPUTS.upper)
    small = type(INPUTS)(INPUTS.names, tuple(share * low), tuple(share * high))
    dataset, _ = sample(path, sampler=RandomStates(small, count=8, seed=3))
    return dataset


@pytest.mark.parametrize(("sampler", "between"), [("macro-driven", True), ("sobol", False)])
def test_held_out_states_are_where_the_samples_are(tmp_path: Path, sampler: str, between: bool) -> None:
    samples = near_rest(tmp_path / "samples.h5", 0.2)
    sampled = SampledRange.around(INPUTS, samples.x()[samples.responses().stable])
    asked = np.array([request.x for request in held_out_states(study(sampler), samples).ask()])
    assert len(asked) == 12
    assert bool(sampled.contains(asked).all()) is between


def test_held_out_states_of_other_samples_are_dropped(tmp_path: Path) -> None:
    config = study("macro-driven")
    few = near_rest(tmp_path / "samples.h5", 0.2)
    held_out, _ = sample(tmp_path / "test.h5", sampler=held_out_states(config, few))
    kept = len(held_out)
    drop_misplaced(held_out, held_out_states(config, few))
    assert len(held_out) == kept > 0
    others = near_rest(tmp_path / "others.h5", 0.3)
    drop_misplaced(held_out, held_out_states(config, others))
    assert len(held_out) == 0
    again, _ = sample(tmp_path / "test.h5", sampler=held_out_states(config, others))
    assert len(again) >= 12


def test_a_sampler_that_ended_before_its_budget_needs_another_tolerance() -> None:
    config = load_config(EXAMPLES / "soil-strip.yaml")
    early, late = (SimpleNamespace(config=config, dataset=range(n)) for n in (35, 48))
    assert _more_states(early) == (  # type: ignore[arg-type]
        "lower sampling.tolerance, which ended the sampling after 35 of 48 states"
    )
    assert _more_states(late) == "raise sampling.options.count"  # type: ignore[arg-type]
