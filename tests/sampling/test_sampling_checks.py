"""The built-in samplers, held to the checks of every sampler, and what those that ask in rounds obey in addition."""

from __future__ import annotations

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.interfaces.sampler import Request
from porocore.plugins.registry import registry
from porocore.testing import SamplerSuite
from porocore.testing.sampler_checks import FAILED, INPUTS, inform, run, solve

SAMPLERS = ("sobol", "latin-hypercube", "active", "macro-driven")


class _Rounds(SamplerSuite):
    kit_version = "5"
    name: str
    options = {"count": 30}  # noqa: RUF012
    budget = 30
    invalid_options = ({"count": 0}, {"seed": -1}, {"colour": 3}, {"step": {"p": 0.1}})

    @classmethod
    def make_sampler(cls, inputs, **options):
        return registry().get("sampler", cls.name)(inputs, **options)


class TestSobol(_Rounds):
    name = "sobol"


class TestLatinHypercube(_Rounds):
    name = "latin-hypercube"


class TestActive(_Rounds):
    name = "active"


class TestMacroDriven(_Rounds):
    name = "macro-driven"


class TestDensitySweep(_Rounds):
    name = "density-sweep"
    options = {"step": {"H22": 0.04, "p": 0.1}, "tolerance": 0.05}  # noqa: RUF012
    budget = None
    invalid_options = ({"colour": 3}, {"tolerance": -1.0})

    @classmethod
    def make_sampler(cls, inputs, **options):
        options = {"step": {name: 0.05 for name in inputs.names}, **options}
        options["step"] = {name: options["step"].get(name, 0.05) for name in inputs.names}
        return super().make_sampler(inputs, **options)


def make(name: str, **options: object):
    return inform(registry().get("sampler", name)(INPUTS, **options))


@pytest.mark.parametrize("name", SAMPLERS)
def test_rounds_are_complete_before_the_next(name: str) -> None:
    """Even the order of asking does not depend on that of completion, and nothing waits for a state of its round."""
    first = run(make(name, count=30)).asked
    assert run(make(name, count=30), order=1).asked == first
    assert len(first) == 30 or name == "macro-driven"
    assert {request.start for request in first} == {None}
    x = np.array([request.x for request in first])
    assert (x >= INPUTS.lower).all()
    assert (x <= INPUTS.upper).all()


@pytest.mark.parametrize("name", SAMPLERS)
def test_what_was_not_asked_for_is_named(name: str) -> None:
    sampler = make(name, count=12)
    first = sampler.ask()[0]
    sampler.tell(first.key, solve(INPUTS, first))
    with pytest.raises(ValueError, match="was not asked for or has been told before"):
        sampler.tell(first.key, solve(INPUTS, first))


@pytest.mark.parametrize("name", ["active", "macro-driven"])
def test_a_cell_without_any_solution_ends_the_sampling_soon(name: str) -> None:
    outcome = run(make(name, count=40), answer=lambda inputs, request: FAILED)
    assert outcome.ended
    assert len(outcome.asked) < 12
    assert outcome.expected == len(outcome.asked)


@pytest.mark.parametrize("name", ["active", "macro-driven"])
def test_who_learns_has_to_know_the_study(name: str) -> None:
    sampler = registry().get("sampler", name)(INPUTS, count=20)
    requests: list[Request] = sampler.ask()
    for request in requests:
        sampler.tell(request.key, solve(INPUTS, request))
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
