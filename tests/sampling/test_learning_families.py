"""Samplers that learn, of cells with parameters: the committee sees these, and rounds keep to few members."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.interfaces.sampler import Exploration, Sampler, StudyFacts
from porocore.interfaces.surrogate import TrainingSet
from porocore.sampling.samplers.active import Active
from porocore.sampling.samplers.candidates import sobol_points
from porocore.sampling.samplers.designs import from_unit
from porocore.sampling.samplers.macro_driven import MacroDriven
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate, committee, judge
from porocore.testing.synthetic.porous_family import INPUTS, porous_training_set, respond, rest_data

POTENTIAL, MEAN = ("mean_grad", "stress", "fluid_volume"), ("mean_grad",)


def study(explore: Any = None, responses: tuple[str, ...] = POTENTIAL) -> StudyFacts:
    data = porous_training_set(4)
    return StudyFacts(
        data.reference, data.identity, responses, explore, judge, data.symmetry, rests=data.rests
    )


def solve_all(sampler: Sampler) -> list[np.ndarray]:
    """Return the rounds (n, 4) that are asked for."""
    rounds = []
    while requests := sampler.ask():
        x = np.array([request.x for request in requests])
        response = respond(INPUTS.scatter(x))
        for i, request in enumerate(requests):
            sampler.tell(request.key, response[i : i + 1])
        rounds.append(x)
    assert sampler.done
    return rounds


def members_of(x: np.ndarray) -> int:
    return len(np.unique(x[:, 2:], axis=0))


def data_at(x: np.ndarray) -> TrainingSet:
    data = porous_training_set(4)
    states = INPUTS.scatter(x)
    return TrainingSet(
        states, respond(states), INPUTS, data.reference, data.identity, {}, data.symmetry, rests=rest_data(20)
    )


@pytest.mark.parametrize("responses", [POTENTIAL, MEAN], ids=["potential", "mean gradient"])
def test_a_committee_disagrees_at_members_that_were_not_solved(responses: tuple[str, ...]) -> None:
    """Thin pores only: members with thick ones are in dispute, at the same H and p."""
    unit = sobol_points(4, 128, 3)
    thin = unit * [1, 1, 0.25, 1]
    members = committee(data_at(from_unit(INPUTS, thin[:32])), responses)
    known, beyond = (members.judge(INPUTS.scatter(from_unit(INPUTS, at))).disagreement for at in (thin, unit))
    thick = unit[:, 2] > 0.6
    assert beyond[thick].mean() > 2 * known[thick].mean()
    assert (beyond != known).all()


@pytest.mark.parametrize("responses", [POTENTIAL, MEAN], ids=["potential", "mean gradient"])
def test_a_committee_of_a_family_comes_to_agree(responses: tuple[str, ...]) -> None:
    x = from_unit(INPUTS, sobol_points(4, 128, 5))
    unseen = INPUTS.scatter(from_unit(INPUTS, sobol_points(4, 64, 6)))
    few, many = (committee(data_at(x[:n]), responses).judge(unseen).disagreement for n in (16, 128))
    assert many.mean() < 0.3 * few.mean()


@pytest.mark.slow
def test_disagreement_tells_where_the_error_is() -> None:
    """Both as shares of the range of stress: those of the committee are larger, in the same places."""
    data = data_at(from_unit(INPUTS, sobol_points(4, 16, 5)))
    unseen = INPUTS.scatter(from_unit(INPUTS, np.random.default_rng(2).random((100, 4))))
    said = committee(data, POTENTIAL).judge(unseen).disagreement
    found = PolynomialSurrogate().fit(data, seed=0).predict(unseen, tangent=False).stress
    truth, known = respond(unseen).stress, data.responses.stress
    assert found is not None
    assert truth is not None
    assert known is not None
    error = np.abs(found - truth).max(axis=(1, 2)) / np.ptp(known, axis=0).max()
    assert 1 < said.mean() / error.mean() < 25
    ranks = [np.argsort(np.argsort(each)) for each in (said, error)]
    assert np.corrcoef(ranks)[0, 1] > 0.5


def test_active_rounds_keep_to_few_members() -> None:
    active = informed(Active(INPUTS, count=24, batch=4))
    first, *rounds = solve_all(active)
    assert (len(first), members_of(first)) == (16, 4)
    assert all(members_of(each) == 1 for each in rounds)
    x = np.concatenate([first, *rounds])
    assert active.members == 6 >= members_of(x) > 4
    # Of many members the corners of the parameters are the last ones.
    corners = {(a, b) for a in (0, 1) for b in (0, 1)}
    assert {tuple(row) for row in Active(INPUTS, count=32).choice.values[4:]} == corners
    assert not corners & {tuple(row) for row in Active(INPUTS, count=32).choice.values[:4]}
    more = solve_all(informed(Active(INPUTS, count=21, batch=9, states_per_member=3)))
    assert [(len(each), members_of(each)) for each in more] == [(12, 4), (9, 3)]


def informed(sampler: Any, explore: Any = None) -> Any:
    sampler.inform(study(explore))
    return sampler


class GradedColumn:
    """Macro run of a column whose radius grows with the height, compressed as far as a stress of it allows."""

    def __init__(self) -> None:
        self.visited: list[np.ndarray] = []

    def __call__(self, data: TrainingSet, *, elements: int, steps: int) -> Exploration:
        fitted = PolynomialSurrogate(degree=3).fit(data, seed=0)
        radius, H22 = (
            each.ravel() for each in np.meshgrid(np.linspace(0.2, 0.26, 13), -np.linspace(0, 0.1, 60))
        )
        x = np.stack([H22, -0.2 * H22, radius, np.full(len(radius), 0.3)], axis=1)
        stress = fitted.predict(INPUTS.scatter(x), tangent=False).stress
        assert stress is not None
        there = stress[:, 1, 1] > -0.04
        self.visited.append(x[there])
        return Exploration(INPUTS.scatter(x[there]), (float(H22[there].min()), 0.02))


@pytest.mark.slow
def test_macro_driven_states_of_a_family_are_where_the_body_is() -> None:
    column = GradedColumn()
    sampler = informed(MacroDriven(INPUTS, count=60, initial=8, batch=4, tolerance=0.05), column)
    first, *rounds = solve_all(sampler)
    assert sampler.converged
    assert len(first) == 8
    assert all(members_of(each) == 1 for each in rounds)
    x = np.concatenate(rounds)
    near = np.abs(INPUTS.to_unit(x)[:, None] - INPUTS.to_unit(column.visited[-1])).max(axis=2).min(axis=1)
    # Members are those of the whole ranges, to the nearest of which the states are moved.
    assert np.median(near) < 0.2
    assert sampler.study.rests is not None
