"""The laws that every sampler obeys, as tests that a plugin author subclasses.

.. code-block:: python

    class TestMySampler(SamplerSuite):
        kit_version = "2"

        @classmethod
        def make_sampler(cls, inputs, **options):
            return MySampler(inputs, **options)

The cell that is sampled is :mod:`porocore.testing.synthetic_cell`, without a solution where it is squeezed hard.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.inputs import InputSpace
from porocore.interfaces.sampler import Request, Sampler
from porocore.testing.compare import global_random_state
from porocore.testing.sampling import FAILED, INPUTS, Outcome, inform, run, solve
from porocore.testing.suite import Suite

#: Boxes of other numbers of inputs.
BOXES = {
    "one input": InputSpace(("H22",), (-0.12,), (0.04,)),
    "three inputs": InputSpace(("H11", "H22", "p"), (-0.05, -0.1, 0.0), (0.05, 0.02, 0.1)),
}


class SamplerSuite(Suite):
    """Subclass it, name the class ``Test…`` and give it ``make_sampler``."""

    #: With which a sampling takes some ten to sixty states.
    options: ClassVar[Mapping[str, Any]] = {}
    #: Most states that it may ask for with these; None: it decides by itself when it knows enough.
    budget: ClassVar[int | None] = None
    #: Whether other seeds give other states; it then takes the option ``seed``.
    random = False
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
    def whole(cls) -> Outcome:
        """A sampling from its beginning to its end. Not to be changed."""
        return run(cls.ready())

    def test_requests_are_what_they_should_be(self, whole: Outcome) -> None:
        """Unique keys, finite numbers within the box, no state twice."""
        asked = whole.asked
        assert asked, "nothing was asked for"
        for request in asked:
            assert isinstance(request, Request)
            assert isinstance(request.key, str)
            assert request.key
            assert len(request.x) == len(INPUTS)
            assert all(isinstance(value, float) for value in request.x), request.x
        assert len({request.key for request in asked}) == len(asked), "a key was asked for twice"
        assert len({request.x for request in asked}) == len(asked), "a state was asked for twice"
        x = np.array([request.x for request in asked])
        slack = 1e-12 * (np.array(INPUTS.upper) - np.array(INPUTS.lower))
        assert np.isfinite(x).all()
        assert (x >= np.array(INPUTS.lower) - slack).all(), "a state lies outside the box"
        assert (x <= np.array(INPUTS.upper) + slack).all(), "a state lies outside the box"

    def test_it_keeps_to_its_budget(self, whole: Outcome) -> None:
        if self.budget is not None:
            assert len(whole.asked) <= self.budget

    def test_it_says_when_it_is_done(self, whole: Outcome) -> None:
        assert whole.ended, "it asks for nothing, waits for nothing and is not done"
        assert not whole.early, f"it was done while {whole.early} states were being solved"
        assert whole.expected == len(whole.asked)

    def test_starts_are_solved_states(self, whole: Outcome) -> None:
        """A field to start from must exist when the state is asked for."""
        assert not whole.bad_starts, f"{whole.bad_starts[0]} starts from what has no field yet"

    def test_it_is_deterministic(self, whole: Outcome) -> None:
        """Without drawing from a global random number generator."""
        before = global_random_state()
        assert run(self.ready()).asked == whole.asked
        assert before == global_random_state(), "it drew from a global random number generator"

    def test_the_seed_decides(self, whole: Outcome) -> None:
        """Another seed gives other states, where ``random`` says so."""
        if not self.random:
            pytest.skip("nothing in this sampler is random")
        assert run(self.ready(seed=7)).states != whole.states

    @pytest.mark.parametrize("order", [1, 2])
    def test_the_same_states_whatever_the_order_of_completion(self, whole: Outcome, order: int) -> None:
        """Under the same keys, from the same starts; workers finish in any order."""
        assert run(self.ready(), order=order).states == whole.states

    def test_an_interrupted_sampling_goes_on_by_telling_again(self, whole: Outcome) -> None:
        """A new sampler is told what is known as it asks for it, in another order."""
        half = run(self.ready(), most=(len(whole.asked) + 1) // 2)
        known = {request.key: request for request in half.told}
        resumed = run(self.ready(), order=3)
        assert {request.key: request for request in resumed.asked if request.key in known} == known
        assert resumed.states == whole.states

    def test_asking_again_gives_nothing_twice(self) -> None:
        sampler = self.ready()
        first = {request.key for request in sampler.ask()}
        assert not first & {request.key for request in sampler.ask()}

    def test_what_was_not_asked_for_cannot_be_told(self) -> None:
        sampler = self.ready()
        first = sampler.ask()[0]
        sampler.tell(first.key, solve(INPUTS, first))
        for key in (first.key, "never asked for"):
            with pytest.raises(ValueError):
                sampler.tell(key, solve(INPUTS, first))

    def test_a_cell_without_any_solution_ends_the_sampling(self) -> None:
        """Failed states are outcomes like others; a sampler must not ask for ever."""
        outcome = run(self.ready(), answer=lambda inputs, request: FAILED, most=2000)
        assert outcome.ended, "it goes on although no state can be solved"

    def test_outcomes_are_not_changed(self) -> None:
        sampler = self.ready()
        for request in sampler.ask():
            response = solve(INPUTS, request)
            kept = [array.copy() for array in (response.mean_grad, response.status)]
            sampler.tell(request.key, response)
            np.testing.assert_array_equal(response.mean_grad, kept[0])
            np.testing.assert_array_equal(response.status, kept[1])

    @pytest.mark.parametrize("box", BOXES)
    def test_any_number_of_inputs(self, box: str) -> None:
        inputs = BOXES[box]
        asked = self.ready(inputs).ask()
        assert asked
        x = np.array([request.x for request in asked])
        assert x.shape == (len(asked), len(inputs))
        assert (x >= np.array(inputs.lower) - 1e-12).all()
        assert (x <= np.array(inputs.upper) + 1e-12).all()

    def test_invalid_options_are_refused(self) -> None:
        for options in self.invalid_options:
            with pytest.raises(ConfigurationError, match=next(iter(options))):
                self.make_sampler(INPUTS, **{**self.options, **options})
