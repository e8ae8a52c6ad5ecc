"""Made-up cell and study over which the suite drives a sampler (SamplingRecord, run)."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from porocore.core.inputs.input_space import InputSpace
from porocore.interfaces.records import failed_response
from porocore.interfaces.sampler import Exploration, Request, Sampler, StudyFacts, StudySampler
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import CellResponse, MacroState, Status
from porocore.surrogates.polynomial.committee import judge
from porocore.testing.compare import RESPONSES
from porocore.testing.synthetic import cell as synthetic_cell

INPUTS = synthetic_cell.INPUTS
#: What is answered for a state that has no solution.
FAILED = failed_response(Status.inverted, names=RESPONSES)
Answer = Callable[[InputSpace, Request], CellResponse]


def solve(inputs: InputSpace, request: Request) -> CellResponse:
    """Return the response in closed form; no solution under strong compression with little pressure."""
    states = inputs.scatter(np.array(request.x))
    if states.grad_u[0, 1, 1] < -0.15 and states.p[0] < 0.05:
        return FAILED
    return synthetic_cell.respond(states)


def explore(data: TrainingSet, *, elements: int, steps: int) -> Exploration:
    """A path whose end depends on what was learned."""
    reached = -0.14 - 0.01 / len(data.states)
    s = np.linspace(0, 1, steps)
    H = np.zeros((steps, 3, 3))
    H[:, 1, 1] = reached * s
    return Exploration(MacroState(H, 0.2 * s * (1 - s) * elements / 20), (reached, 0.05))


def requests_of_suite(suite: Any) -> list[tuple[str, tuple[float, ...], str | None]]:
    """Return key, inputs and start of all that the sampler of a suite asks for, in its order."""
    return [(request.key, request.x, request.start) for request in run(suite.ready()).asked]


def inform(sampler: Sampler, responses: tuple[str, ...] = ("stress", "fluid_volume")) -> Sampler:
    """Tell a sampler that learns what it may know of the study; returns it."""
    if isinstance(sampler, StudySampler):
        rest = synthetic_cell.respond(MacroState.zeros(1))
        sampler.inform(StudyFacts(rest, "made up", responses, explore, judge))
    return sampler


@dataclass
class SamplingRecord:
    """Record of a sampling.

    Attributes
    ----------
    asked, observed
        Requests in the order of asking and of telling.
    ended
        The sampler was done when nothing was left to be solved.
    early
        How many states were being solved when it said so too early.
    expected
        What it expected in the end.
    bad_starts
        Keys of states that were to start from one without a field.
    """

    asked: list[Request] = field(default_factory=list)
    observed: list[Request] = field(default_factory=list)
    ended: bool = False
    early: int = 0
    expected: int = 0
    bad_starts: list[str] = field(default_factory=list)

    @property
    def states(self) -> dict[str, tuple[tuple[float, ...], str | None]]:
        """Inputs and start of each key."""
        return {request.key: (request.x, request.start) for request in self.asked}


def run(
    sampler: Sampler,
    order: int | None = None,
    *,
    inputs: InputSpace = INPUTS,
    answer: Answer = solve,
    most: int = 10_000,
) -> SamplingRecord:
    """Ask, solve and tell until nothing is left, or ``most`` states were told.

    ``order`` is the seed by which the states that wait are shuffled; None: they are told in the order of asking.
    """
    draw, waiting, record = random.Random(order), list[Request](), SamplingRecord()
    solved: set[str] = set()
    while len(record.observed) < most:
        new = sampler.ask()
        record.bad_starts += [r.key for r in new if r.start is not None and r.start not in solved]
        record.asked += new
        waiting += new
        if not waiting:
            record.ended = sampler.done
            break
        if sampler.done:
            record.early = record.early or len(waiting)
        request = waiting.pop(0 if order is None else draw.randrange(len(waiting)))
        response = answer(inputs, request)
        if Status(int(response.status[0])).has_values:
            solved.add(request.key)
        sampler.tell(request.key, response)
        record.observed.append(request)
    record.expected = sampler.expected
    return record
