"""What every sampler that asks in rounds obeys, whatever it chooses by."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.inputs import InputSpace
from porocore.interfaces.sampler import Exploration, Request, Sampler, StudyFacts, StudySampler
from porocore.interfaces.surrogate import TrainingSet
from porocore.registry import registry
from porocore.states import CellResponse, MacroState, Status
from porocore.testing import synthetic_cell

INPUTS = InputSpace(("H22", "p"), (-0.20, -0.02), (0.04, 0.24))
SAMPLERS = ("sobol", "latin-hypercube", "active", "macro-driven")
Solve = Callable[[Request], CellResponse]


def solve(request: Request) -> CellResponse:
    """In closed form, without a solution where the pores are squeezed hard under little pressure."""
    x = np.array(request.x)
    response = synthetic_cell.respond(INPUTS.scatter(x))
    if x[0] < -0.15 and x[1] < 0.05:
        return CellResponse(
            np.full((1, 3, 3), np.nan),
            np.array([int(Status.inverted)]),
            *(np.full_like(a, np.nan) for a in (response.potential, response.stress, response.fluid_volume)),
            tangent=None,
        )
    return response


def explore(data: TrainingSet, *, elements: int, steps: int) -> Exploration:
    """A path whose end depends on what was learned."""
    reached = -0.14 - 0.01 / len(data.states)
    s = np.linspace(0, 1, steps)
    H = np.zeros((steps, 3, 3))
    H[:, 1, 1] = reached * s
    return Exploration(MacroState(H, 0.2 * s * (1 - s) * elements / 20), (reached, 0.05))


def make(name: str, responses: tuple[str, ...] = ("stress", "fluid_volume"), **options: object) -> Sampler:
    sampler = registry().get("sampler", name)(INPUTS, **options)
    if isinstance(sampler, StudySampler):
        sampler.inform(StudyFacts(synthetic_cell.respond(MacroState.zeros(1)), "made up", responses, explore))
    return sampler


def run(
    sampler: Sampler, order: int | None = None, known: dict[str, tuple[float, ...]] | None = None
) -> list[Request]:
    """All requests in the order of asking; told in the order of asking, or shuffled."""
    rng, waiting, asked = random.Random(order), [], []
    while True:
        new = sampler.ask()
        asked += new
        waiting += new
        if not waiting:
            assert sampler.done
            assert sampler.expected == len(asked)
            return asked
        assert not sampler.done
        request = waiting.pop(0 if order is None else rng.randrange(len(waiting)))
        if known is not None and request.key in known:
            assert known[request.key] == request.x
        sampler.tell(request.key, solve(request))


@pytest.mark.parametrize("name", SAMPLERS)
def test_the_same_states_whatever_the_order_of_completion(name: str) -> None:
    first = run(make(name, count=30))
    assert run(make(name, count=30), order=1) == first
    assert run(make(name, count=30, seed=7)) != first


@pytest.mark.parametrize("name", SAMPLERS)
def test_the_budget_is_kept_and_the_box(name: str) -> None:
    requests = run(make(name, count=30))
    assert (
        len(requests)
        == len({request.key for request in requests})
        == len({request.x for request in requests})
    )
    assert len(requests) <= 30
    assert len(requests) == 30 or name == "macro-driven"
    x = np.array([request.x for request in requests])
    assert (x >= INPUTS.lower).all()
    assert (x <= INPUTS.upper).all()
    # Nothing waits for another state of its round.
    assert {request.start for request in requests} == {None}


@pytest.mark.parametrize("name", SAMPLERS)
def test_an_interrupted_sampling_goes_on_by_telling_again(name: str) -> None:
    whole = run(make(name, count=24))
    interrupted = make(name, count=24)
    known: dict[str, tuple[float, ...]] = {}
    while len(known) < 13:
        for request in interrupted.ask():
            known[request.key] = request.x
            interrupted.tell(request.key, solve(request))
    assert run(make(name, count=24), order=3, known=known) == whole


@pytest.mark.parametrize("name", SAMPLERS)
def test_what_was_not_asked_for_cannot_be_told(name: str) -> None:
    sampler = make(name, count=12)
    first = sampler.ask()[0]
    assert sampler.ask() == []
    sampler.tell(first.key, solve(first))
    for key in (first.key, "another"):
        with pytest.raises(ValueError, match="was not asked for or has been told before"):
            sampler.tell(key, solve(first))


@pytest.mark.parametrize("name", ["active", "macro-driven"])
def test_a_cell_without_any_solution_ends_the_sampling(name: str) -> None:
    sampler = make(name, count=40)
    failed = solve(Request("", (-0.2, 0.0)))
    asked = 0
    while requests := sampler.ask():
        for request in requests:
            sampler.tell(request.key, failed)
        asked += len(requests)
    assert sampler.done
    assert asked < 12
    assert sampler.expected == asked


@pytest.mark.parametrize("name", ["active", "macro-driven"])
def test_who_learns_has_to_know_the_study(name: str) -> None:
    sampler = registry().get("sampler", name)(INPUTS, count=20)
    requests = sampler.ask()
    for request in requests:
        sampler.tell(request.key, solve(request))
    with pytest.raises(RuntimeError, match="call inform before ask"):
        sampler.ask()


@pytest.mark.parametrize("name", SAMPLERS)
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"count": 0}, "sampling.options.count: must be a whole number"),
        ({"seed": -1}, "sampling.options.seed: must be a whole number of at least 0, got -1"),
        ({"colour": 3}, "sampling.options: unknown option 'colour'"),
        ({"step": {"p": 0.1}}, "sampling.inputs.p.step: .* takes no steps"),
    ],
)
def test_bad_options_are_named(name: str, options: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        registry().get("sampler", name)(INPUTS, **options)
