"""Samplers that break one law each; the class attribute says which."""

from __future__ import annotations

import itertools
import random as global_random
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from porocore.core.inputs import InputSpace
from porocore.errors import ConfigurationError
from porocore.interfaces.sampler import Request, Sampler
from porocore.testing import SamplerSuite


class Fine(Sampler):
    """``count`` random states, which obeys all checks."""

    seeded = True

    def __init__(self, inputs: InputSpace, count: int = 12, seed: int = 0, **unknown: Any) -> None:
        if unknown:
            raise ConfigurationError(f"unknown option {min(unknown)}")
        draw = np.random.default_rng(seed).random((count, len(inputs)))
        low, high = np.array(inputs.lower), np.array(inputs.upper)
        points = low + (high - low) * draw
        for point, used in zip(points, itertools.cycle(inputs.used), strict=False):
            point[len(inputs) - len(used) :] = used
        self.ready = [Request(f"state-{i}", tuple(map(float, x))) for i, x in enumerate(points)]
        self.count, self.waiting, self.told = count, set[str](), 0

    def ask(self) -> list[Request]:
        ready, self.ready = self.ready, []
        self.waiting |= {request.key for request in ready}
        return ready

    def tell(self, key: str, response: Any) -> None:
        if key not in self.waiting:
            raise ValueError(key)
        self.waiting.remove(key)
        self.told += 1

    @property
    def done(self) -> bool:
        return self.told == self.count

    @property
    def expected(self) -> int:
        return self.count


class _Law(SamplerSuite):
    kit_version = "5"
    budget = 12
    caught_by: ClassVar[str]
    sampler: ClassVar[type[Sampler]] = Fine

    @classmethod
    def make_sampler(cls, inputs, **options):
        return cls.sampler(inputs, **options)


class TestFine(_Law):
    caught_by = ""


class TestOtherKit(_Law):
    kit_version = "9"
    caught_by = "test_version_of_the_kit"


class TestNoKit(_Law):
    kit_version = ""
    caught_by = "test_version_of_the_kit"


class TestOutsideTheBox(_Law):
    caught_by = "test_requests_are_what_they_should_be"

    class sampler(Fine):
        def ask(self):
            return [Request(r.key, (r.x[0] - 0.3, *r.x[1:])) for r in super().ask()]


class TestSameStateTwice(_Law):
    caught_by = "test_requests_are_what_they_should_be"

    class sampler(Fine):
        def ask(self):
            asked = super().ask()
            return [Request(r.key, asked[0].x) for r in asked]


class TestTooMany(_Law):
    caught_by = "test_it_keeps_to_its_budget"

    class sampler(Fine):
        def __init__(self, inputs, count=12, **options):
            super().__init__(inputs, count=count + 1, **options)


class TestDoneTooEarly(_Law):
    caught_by = "test_it_says_when_it_is_done"

    class sampler(Fine):
        @property
        def done(self):
            return not self.ready


class TestNeverDone(_Law):
    caught_by = "test_it_says_when_it_is_done"

    class sampler(Fine):
        done = False


class TestStartsFromNothing(_Law):
    caught_by = "test_starts_are_solved_states"

    class sampler(Fine):
        def ask(self):
            asked = super().ask()
            return [asked[0], *(Request(r.key, r.x, asked[0].key) for r in asked[1:])] if asked else []


class TestChance(_Law):
    caught_by = "test_it_is_deterministic"

    class sampler(Fine):
        def __init__(self, inputs, **options):
            super().__init__(inputs, **{**options, "seed": np.random.SeedSequence().entropy})


class TestGlobalRandomNumbers(_Law):
    caught_by = "test_it_is_deterministic"

    class sampler(Fine):
        def __init__(self, inputs, **options):
            super().__init__(inputs, **options)
            global_random.random()


class TestSeedIsIgnored(_Law):
    caught_by = "test_the_seed_decides"

    class sampler(Fine):
        def __init__(self, inputs, seed=0, **options):
            super().__init__(inputs, **options)


class _OneByOne(Fine):
    """The next is chosen by the last outcome that was told, so that its order matters."""

    def __init__(self, inputs, **options):
        super().__init__(inputs, **options)
        self.rest, self.ready = self.ready[2:], self.ready[:2]

    def tell(self, key, response):
        super().tell(key, response)
        if self.rest:
            self.ready.append(self.rest.pop(int(key[-1]) % len(self.rest)))


class TestOrderMatters(_Law):
    """Keys are numbers in the order of asking, and that depends on what was told last."""

    caught_by = "test_the_same_states_whatever_the_order_of_completion"

    class sampler(_OneByOne):
        asked = 0

        def ask(self):
            found = []
            for request in super().ask():
                self.waiting.remove(request.key)
                found.append(Request(f"n-{self.asked}", request.x))
                self.waiting.add(found[-1].key)
                self.asked += 1
            return found


class TestCannotBeResumed(_Law):
    """Keys count how often it was asked, which is another number when told again in another order."""

    caught_by = "test_an_interrupted_sampling_goes_on_by_telling_again"

    class sampler(_OneByOne):
        asks = 0

        def ask(self):
            self.asks += 1
            renamed = [Request(f"{self.asks}-{r.key}", r.x) for r in super().ask()]
            self.waiting = {f"{self.asks}-{k}" if "-" not in k[1:2] else k for k in self.waiting} | {
                r.key for r in renamed
            }
            return renamed

        def tell(self, key, response):
            self.waiting.add(key)
            super().tell(key, response)


class TestAsksAgain(_Law):
    caught_by = "test_asking_again_gives_nothing_twice"

    class sampler(Fine):
        def ask(self):
            return list(self.ready)


class TestTakesAnyKey(_Law):
    caught_by = "test_what_was_not_asked_for_cannot_be_told"

    class sampler(Fine):
        def tell(self, key, response):
            self.waiting.discard(key)
            self.told += 1


class TestNeverGivesUp(_Law):
    caught_by = "test_a_cell_without_any_solution_ends_the_sampling"

    class sampler(Fine):
        def tell(self, key, response):
            super().tell(key, response)
            if np.isnan(response.mean_grad).any():
                self.count += 1
                x = self.count / 1e6
                self.ready.append(Request(f"again-{self.count}", (x - 0.1, x)))


class TestChangesOutcomes(_Law):
    caught_by = "test_outcomes_are_not_changed"

    class sampler(Fine):
        def tell(self, key, response):
            super().tell(key, response)
            response.mean_grad[:] = 0


class TestTwoInputsOnly(_Law):
    caught_by = "test_any_number_of_inputs"

    class sampler(Fine):
        def ask(self):
            return [Request(r.key, (r.x[0], 0.0)) for r in super().ask()]


class TestWholeRangesOfParameters(_Law):
    """Solves cells that the body does not have."""

    caught_by = "test_states_are_where_the_body_is"

    class sampler(Fine):
        def __init__(self, inputs, **options):
            super().__init__(replace(inputs, used=()), **options)


class TestSwallowsOptions(_Law):
    caught_by = "test_invalid_options_are_refused"

    class sampler(Fine):
        def __init__(self, inputs, count=12, seed=0, **ignored):
            super().__init__(inputs, count, seed)


class TestKeysFromHash(_Law):
    """A resumed run solves every state again: ``hash()`` of a text is another in each process."""

    caught_by = "test_another_process_asks_for_the_same_states"
    slow = True

    class sampler(Fine):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            self.ready = [Request(f"{hash(request.key):x}", request.x) for request in self.ready]


class TestOrderOfASet(_Law):
    """Numbers its states in the order of a set."""

    caught_by = "test_another_process_asks_for_the_same_states"
    slow = True

    class sampler(Fine):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            by_key = {request.key: request.x for request in self.ready}
            self.ready = [Request(f"state-{i}", by_key[key]) for i, key in enumerate(set(by_key))]


class TestOrderOfTheInputs(_Law):
    """Draws for the inputs in the order of a set of two names."""

    caught_by = "test_another_process_asks_for_the_same_states"
    slow = True

    class sampler(Fine):
        def __init__(self, inputs, **options):
            super().__init__(inputs, **options)
            if list(set(inputs.names)) != list(inputs.names):
                self.ready = self.ready[::-1]
