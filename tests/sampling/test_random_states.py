"""Held-out states at random: uniform in the box, reproducible, and as many with values as are asked for."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest

from porocore.core.inputs import InputSpace, SampledRange
from porocore.errors import ConfigurationError, DataError
from porocore.sampling.samplers.designs import MOST_MISSES, RandomStates, random_requests
from porocore.states import CellResponse, Status
from tests.helpers.campaigns import sample
from tests.helpers.fake_cell import INPUTS


def test_random_states_fill_the_box_and_extend_one_another() -> None:
    inputs = InputSpace(("p", "H22"), (-0.1, -0.4), (0.2, 0.1))
    requests = random_requests(inputs, 400, seed=5)
    assert requests[:30] == random_requests(inputs, 30, seed=5)
    assert requests[0].x != random_requests(inputs, 1, seed=6)[0].x
    assert [request.key for request in requests[:2]] == ["test-000", "test-001"]
    assert {request.start for request in requests} == {None}
    x = np.array([request.x for request in requests])
    low, high = np.array(inputs.lower), np.array(inputs.upper)
    assert (x >= low).all()
    assert (x <= high).all()
    scaled = (x - low) / (high - low)
    # Kolmogorov's distance to the uniform distribution, 1 % level.
    for column in np.sort(scaled, axis=0).T:
        assert np.abs(column - (np.arange(400) + 0.5) / 400).max() < 1.63 / np.sqrt(400)
    assert abs(np.corrcoef(scaled.T)[0, 1]) < 0.13


@pytest.mark.parametrize("order", range(5))
def test_random_states_go_on_until_enough_have_values(order: int) -> None:
    """Always the shortest beginning of the draw that holds ``count`` good states."""
    draw = random_requests(INPUTS, 200, seed=1)
    good = [request.x[1] + request.x[0] > -0.1 for request in draw]
    needed = int(np.searchsorted(np.cumsum(good), 20)) + 1
    assert 25 < needed < 100
    sampler = RandomStates(INPUTS, count=20, seed=1)
    rng, waiting, told = random.Random(order), [], set()
    while requests := (sampler.ask() + waiting):
        waiting = requests
        request = waiting.pop(rng.randrange(len(waiting)))
        status = Status.converged if good[int(request.key[5:])] else Status.inverted
        sampler.tell(request.key, CellResponse(np.zeros((1, 3, 3)), np.array([int(status)])))
        told.add(request)
    assert sampler.done
    assert told == set(draw[:needed])
    assert sampler.expected == needed


def test_random_states_give_up_after_so_many_tries() -> None:
    sampler = RandomStates(INPUTS, count=3, seed=1, most_tries=4)
    tried = 0
    while requests := sampler.ask():
        for request in requests:
            sampler.tell(request.key, CellResponse(np.zeros((1, 3, 3)), np.array([int(Status.inverted)])))
            tried += 1
    assert sampler.done
    assert tried == 12


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"count": 0}, "count: must be a whole number of at least 1, got 0"),
        ({"seed": 1.5}, "seed: must be a whole number of at least 0, got 1.5"),
        ({"most_tries": True}, "most_tries: must be"),
        ({"cuont": 3}, "unknown option 'cuont'"),
    ],
)
def test_random_states_name_a_wrong_option(options: dict[str, object], named: str) -> None:
    with pytest.raises(ConfigurationError, match=named):
        RandomStates(INPUTS, **options)


def test_a_test_set_of_another_seed_is_not_mistaken_for_this_one(tmp_path: Path) -> None:
    path = tmp_path / "test.h5"
    dataset, _ = sample(path, sampler=RandomStates(INPUTS, count=5, seed=1))
    assert dataset.responses().valid.sum() == 5
    with pytest.raises(DataError, match=r"test\.h5: holds state 'test-000' at .* is asked for"):
        sample(path, sampler=RandomStates(INPUTS, count=5, seed=2))
    longer, summary = sample(path, sampler=RandomStates(INPUTS, count=8, seed=1))
    assert summary.reused == len(dataset)
    assert longer.responses().valid.sum() == 8
    assert longer.keys[: len(dataset)] == dataset.keys


def test_random_states_lie_within_a_sampled_range() -> None:
    """Of the box the range is a tenth, yet all states lie there; a range that is too thin is given up."""
    inputs = InputSpace(("p", "H22"), (0.0, -1.0), (1.0, 0.0))
    line = np.linspace(0, 0.9, 60)[:, None] * [1.0, -1.0]
    sampled = SampledRange.around(inputs, np.concatenate([line, [[0.5, -0.4]]]))
    asked = np.array([request.x for request in RandomStates(inputs, count=40, seed=2, within=sampled).ask()])
    assert len(asked) == 40
    assert sampled.contains(asked).all()
    whole = np.array([request.x for request in random_requests(inputs, 400, seed=2)])
    assert 0.02 < sampled.contains(whole).mean() < 0.2
    point = SampledRange(inputs, np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([0.5, -0.5]))
    thin = RandomStates(inputs, count=2, seed=2, within=point).ask()
    assert [request.key for request in thin] == ["test-000", "test-001"]
    assert thin[0].x == random_requests(inputs, MOST_MISSES + 1, seed=2)[-1].x
