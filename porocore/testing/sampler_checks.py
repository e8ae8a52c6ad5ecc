"""Suite of samplers (SamplerSuite): budget, determinism, interruption, refused options.

.. code-block:: python

    class TestMySampler(SamplerSuite):
        kit_version = "5"

        @classmethod
        def make_sampler(cls, inputs, **options):
            return MySampler(inputs, **options)

The cell that is sampled is :mod:`porocore.testing.synthetic.cell`, without a solution where it is squeezed hard.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.errors import ConfigurationError
from porocore.interfaces.records import failed_response
from porocore.interfaces.sampler import Exploration, Request, Sampler, StudyFacts, StudySampler
from porocore.interfaces.surrogate import TrainingSet
from porocore.states import CellResponse, MacroState, Status
from porocore.surrogates.polynomial.surrogate import judge
from porocore.testing import other_process
from porocore.testing.expect import RESPONSES, global_random_state, holds, options, refused, same
from porocore.testing.suite import Suite
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


#: Boxes of other numbers of inputs.
BOXES = {
    "one input": InputSpace(("H22",), (-0.12,), (0.04,)),
    "three inputs": InputSpace(("H11", "H22", "p"), (-0.05, -0.1, 0.0), (0.05, 0.02, 0.1)),
}
#: Values of the parameter of a family of cells that a body uses, far apart.
USED_RADII = (0.12, 0.28)
USED = InputSpace.from_ranges(
    {"H22": (-0.12, 0.04), "p": (0.0, 0.1)}, {"radius": (0.1, 0.3)}, tuple((r,) for r in USED_RADII)
)


class SamplerSuite(Suite):
    """Subclass it, name the class ``Test…`` and give it ``make_sampler``."""

    #: With which a sampling takes some ten to sixty states.
    options: ClassVar[Mapping[str, Any]] = {}
    #: Most states that it may ask for with these; None: it decides by itself when it knows enough.
    budget: ClassVar[int | None] = None
    #: Options that the constructor must refuse by name, one after the other.
    invalid_options: ClassVar[tuple[dict[str, Any], ...]] = ({"no_such_option": 1},)

    @classmethod
    def make_sampler(cls, inputs: InputSpace, **options: Any) -> Sampler:
        """A new sampler of the box."""
        raise cls.undefined(
            "make_sampler(cls, inputs, **options)",
            "MySampler(inputs, **options)",
            "a new porocore.Sampler of the box of the inputs",
        )

    @classmethod
    def ready(cls, inputs: InputSpace = INPUTS, **options: Any) -> Sampler:
        """A new sampler with :attr:`options`, told what it may know of the study."""
        return inform(cls.make_sampler(inputs, **{**cls.options, **options}))

    @pytest.fixture(scope="class")
    @classmethod
    def whole(cls) -> SamplingRecord:
        """A sampling from its beginning to its end. Not to be changed."""
        return run(cls.ready())

    def test_requests_are_what_they_should_be(self, whole: SamplingRecord) -> None:
        """Unique keys, finite numbers within the box, no state twice."""
        asked, state = whole.asked, "all requests"
        holds(asked, state, "at least one", "none")
        for request in asked:
            holds(isinstance(request, Request), state, "a porocore.Request", repr(request))
            is_text = isinstance(request.key, str) and request.key
            holds(is_text, state, "a text as key", repr(request.key))
            _is_inside(request, INPUTS)
        for what, values in (("keys", [r.key for r in asked]), ("states", [r.x for r in asked])):
            count = len(set(values))
            holds(count == len(asked), state, f"{len(asked)} different {what}", f"{count}")

    def test_it_keeps_to_its_budget(self, whole: SamplingRecord) -> None:
        if self.budget is None:
            pytest.skip("budget = None: it decides by itself when it knows enough")
        count = len(whole.asked)
        holds(count <= self.budget, "a whole sampling", f"at most {self.budget} states", f"{count} states")

    def test_it_says_when_it_is_done(self, whole: SamplingRecord) -> None:
        holds(whole.ended, "nothing is left to ask or to wait for", "done = True", "done = False")
        state = "while states were being solved"
        holds(
            not whole.early,
            state,
            "done = False",
            f"it was done while {whole.early} states were being solved",
        )
        count = len(whole.asked)
        holds(whole.expected == count, "at the end", f"expected = {count}", whole.expected)

    def test_starts_are_solved_states(self, whole: SamplingRecord) -> None:
        """A field to start from must exist when the state is asked for."""
        bad = whole.bad_starts
        holds(
            not bad,
            "all requests",
            "starts that were solved before",
            f"{', '.join(bad[:3])} start from others",
        )

    def test_it_is_deterministic(self, whole: SamplingRecord) -> None:
        """Two samplings agree, and no global random number generator is used."""
        before = global_random_state()
        _same_states(run(self.ready()).asked, whole.asked, "sampled twice")
        untouched = before == global_random_state()
        holds(untouched, "a whole sampling", "no draw from a global random number generator", "one")

    def test_another_process_asks_for_the_same_states(self, whole: SamplingRecord, tmp_path: Path) -> None:
        """A process with another PYTHONHASHSEED, such as a resumed run, asks for the same states."""
        question = "porocore.testing.sampler_checks:requests_of_suite"
        state = "in another process, with another PYTHONHASHSEED"
        rows = other_process.ask(type(self), question, state, tmp_path)
        _same_states([Request(key, tuple(x), start) for key, x, start in rows], whole.asked, state)

    def test_the_seed_decides(self, whole: SamplingRecord) -> None:
        """Another seed gives other states, where the class declares ``seeded``."""
        self.needs(type(self.ready()).seeded, "seeded = False: nothing in this sampler is random")
        other = run(self.ready(seed=7)).states
        holds(other != whole.states, "seed=7, seeded = True", "other states", "the same states")

    @pytest.mark.parametrize("order", [1, 2])
    def test_the_same_states_whatever_the_order_of_completion(
        self, whole: SamplingRecord, order: int
    ) -> None:
        """Keys and starts do not depend on the order in which workers finish."""
        found = run(self.ready(), order=order).asked
        _same_states(found, whole.asked, f"told in another order ({order})", ordered=False)

    def test_an_interrupted_sampling_goes_on_by_telling_again(self, whole: SamplingRecord) -> None:
        """A new sampler is told what is known as it asks for it, in another order."""
        half = run(self.ready(), most=(len(whole.asked) + 1) // 2)
        known = {request.key: request for request in half.observed}
        resumed = run(self.ready(), order=3)
        again = [request for request in resumed.asked if request.key in known]
        state = "interrupted half-way, and told again in another order"
        _same_states(again, list(known.values()), state, ordered=False)
        _same_states(resumed.asked, whole.asked, state, ordered=False)

    def test_asking_again_gives_nothing_twice(self) -> None:
        sampler = self.ready()
        first = {request.key for request in sampler.ask()}
        twice = sorted(first & {request.key for request in sampler.ask()})
        holds(not twice, "asked twice, with nothing told between", "no key again", twice)

    def test_what_was_not_asked_for_cannot_be_told(self) -> None:
        sampler = self.ready()
        first = sampler.ask()[0]
        sampler.tell(first.key, solve(INPUTS, first))
        for key in (first.key, "never asked for"):
            state = "told twice" if key == first.key else f"told '{key}'"
            with refused(ValueError, state=state):
                sampler.tell(key, solve(INPUTS, first))

    def test_a_cell_without_any_solution_ends_the_sampling(self) -> None:
        """Failed states are outcomes like others; a sampler must not ask for ever."""
        record = run(self.ready(), answer=lambda inputs, request: FAILED, most=2000)
        state = "no state can be solved"
        holds(record.ended, state, "an end", f"{len(record.asked)} requests and no end")

    def test_outcomes_are_not_changed(self) -> None:
        sampler = self.ready()
        for request in sampler.ask():
            response = solve(INPUTS, request)
            kept = [array.copy() for array in (response.mean_grad, response.status)]
            sampler.tell(request.key, response)
            same("mean_grad", response.mean_grad, kept[0], f"told {request.key}")
            same("status", response.status, kept[1], f"told {request.key}")

    @pytest.mark.parametrize("box", BOXES)
    def test_any_number_of_inputs(self, box: str) -> None:
        inputs = BOXES[box]
        asked = self.ready(inputs).ask()
        holds(asked, f"a box of {box}", "at least one request", "none")
        for request in asked:
            _is_inside(request, inputs)

    def test_states_are_where_the_body_is(self) -> None:
        """No state is solved at other values of the parameters than a body uses, if the inputs name these.

        Of samplers that learn the states before the first round are seen, since the made-up study has no parameters.
        """
        kind = type(self.ready())
        self.needs(kind.samples_parameters, "samples_parameters = False: a study of such a cell refuses it")
        sampler = self.ready(USED)
        asked = sampler.ask() if isinstance(sampler, StudySampler) else run(sampler, inputs=USED).asked
        state = f"a box with the parameter 'radius', of which the body uses {USED_RADII[0]:g} and {USED_RADII[1]:g}"
        holds(asked, state, "at least one request", "none")
        for request in asked:
            _is_inside(request, USED)
            away = bool(USED.not_used(np.array([request.x[-1:]]))[0])
            holds(not away, state, "requests at these values (InputSpace.used)", f"one at {request.x[-1]:g}")

    def test_invalid_options_are_refused(self) -> None:
        for given in self.invalid_options:
            with refused(ConfigurationError, state=options(given), naming=(next(iter(given)),)):
                self.make_sampler(INPUTS, **{**self.options, **given})


def _is_inside(request: Request, inputs: InputSpace) -> None:
    """One finite float for each input, within its range but for round-off."""
    state, n = f"the request {request.key!r}", len(inputs)
    floats = isinstance(request.x, tuple) and all(isinstance(value, float) for value in request.x)
    holds(floats and len(request.x) == n, state, f"a tuple of {n} floats", repr(request.x))
    for name, value, low, high in zip(inputs.names, request.x, inputs.lower, inputs.upper, strict=True):
        slack = 1e-12 * (high - low)
        inside = low - slack <= value <= high + slack
        holds(inside, state, f"{name} from {low:g} to {high:g}", value)


def _same_states(found: list[Request], expected: list[Request], state: str, *, ordered: bool = True) -> None:
    """The same keys with the same inputs and starts; in the same order if so."""
    known, asked = {r.key: r for r in expected}, {r.key: r for r in found}
    new = [r.key for r in found if r.key not in known]
    what = f"the same {len(expected)} states"
    holds(not new, state, what, f"{len(new)} other keys, such as {', '.join(map(repr, new[:2]))}")
    for key, request in known.items():
        holds(
            asked.get(key) == request, state, f"{what}, such as {request}", asked.get(key, "none of that key")
        )
    holds(not ordered or found == expected, state, f"{what} in the same order", "another order")
