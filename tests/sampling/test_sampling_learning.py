"""Samplers that learn: what a committee says, what is left alone, where macro runs lead, and what asking costs."""

from __future__ import annotations

import time
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.interfaces.sampler import Exploration, Sampler, StudyFacts
from porocore.interfaces.surrogate import TrainingSet, least_states
from porocore.sampling.samplers.active import Active
from porocore.sampling.samplers.candidates import most_worth, sobol_points, spread_out
from porocore.sampling.samplers.designs import LatinHypercube, SobolDesign, from_unit
from porocore.sampling.samplers.macro_driven import MacroDriven
from porocore.states import MacroState, Status
from porocore.surrogates.polynomial.surrogate import PolynomialSurrogate, committee, judge
from porocore.testing.synthetic import cell as synthetic_cell
from porocore.testing.synthetic import potential_cell

COLUMN = synthetic_cell.INPUTS
POTENTIAL, MEAN = ("mean_grad", "stress", "fluid_volume"), ("mean_grad",)


def column_study(responses: tuple[str, ...] = POTENTIAL, explore: object = None) -> StudyFacts:
    return StudyFacts(synthetic_cell.respond(MacroState.zeros(1)), "made up", responses, explore, judge)  # type: ignore[arg-type]


def column_data(x: np.ndarray) -> TrainingSet:
    states = COLUMN.scatter(x)
    rest = synthetic_cell.respond(MacroState.zeros(1))
    return TrainingSet(states, synthetic_cell.respond(states), COLUMN, rest, "made up", {})


def solve_all(sampler: Sampler, inputs: InputSpace, cell: object, bad: object = None) -> np.ndarray:
    asked = []
    while requests := sampler.ask():
        x = np.array([request.x for request in requests])
        response = cell.respond(inputs.scatter(x))  # type: ignore[attr-defined]
        if bad is not None:
            response = replace(response, status=np.where(bad(x), int(Status.unstable), response.status))  # type: ignore[operator]
        for i, request in enumerate(requests):
            sampler.tell(request.key, response[i : i + 1])
        asked.append(x)
    assert sampler.done
    return np.concatenate(asked)


# ---- the committee ------------------------------------------------------------------------------


@pytest.mark.parametrize("responses", [POTENTIAL, MEAN], ids=["potential", "mean gradient"])
def test_a_committee_disagrees_where_nothing_was_solved(responses: tuple[str, ...]) -> None:
    """States in the stretched half of the box only: the compressed half is in dispute."""
    unit = sobol_points(2, 64, 3)
    half = 1 - unit * np.array([0.5, 1.0])
    members = committee(column_data(from_unit(COLUMN, half[:12])), responses)
    there = members.judge(COLUMN.scatter(from_unit(COLUMN, unit))).disagreement
    inside = unit[:, 0] > 0.5
    assert there[~inside].mean() > 4 * there[inside].mean()


@pytest.mark.parametrize("responses", [POTENTIAL, MEAN], ids=["potential", "mean gradient"])
def test_a_committee_comes_to_agree(responses: tuple[str, ...]) -> None:
    x = from_unit(COLUMN, sobol_points(2, 128, 5))
    unseen = COLUMN.scatter(from_unit(COLUMN, sobol_points(2, 64, 6)))
    few, many = (committee(column_data(x[:n]), responses).judge(unseen).disagreement for n in (8, 128))
    assert many.max() < 0.02 * few.max()
    assert many.max() < 1e-3


def test_what_was_taken_is_worth_nothing_any_more() -> None:
    unit = sobol_points(2, 64, 5)
    judgement = committee(column_data(from_unit(COLUMN, unit[:12])), POTENTIAL).judge(
        COLUMN.scatter(from_unit(COLUMN, unit[12:]))
    )
    before = judgement.worth()
    assert (before > 0).all()
    best = int(np.argmax(before))
    judgement.take(best)
    after = judgement.worth()
    assert after[best] < 0.5 * before[best]
    # Nothing is learned by forgetting.
    assert (after <= before * (1 + 1e-9)).all()


def test_worth_is_the_variance_that_a_solution_takes() -> None:
    """Against the covariance refitted with the equations of the new state."""
    unit = sobol_points(2, 32, 5)
    members = committee(column_data(from_unit(COLUMN, unit[:16])), POTENTIAL)
    judgement = members.judge(COLUMN.scatter(from_unit(COLUMN, unit[16:])))
    rows, C = judgement._rows, members.covariance
    goal = judgement._goal
    W = np.linalg.lstsq(judgement._known.reshape(len(C), -1).T, goal.reshape(len(C), -1).T, rcond=None)[0].T
    for i in (0, 7):
        refitted = np.linalg.inv(np.linalg.inv(C) + rows[:, :, i] @ rows[:, :, i].T)
        assert np.trace(W @ (C - refitted)) == pytest.approx(judgement.worth()[i], rel=1e-4)


# ---- choosing -----------------------------------------------------------------------------------


def test_chosen_states_are_apart() -> None:
    unit = sobol_points(2, 256, 1)
    known, candidates = unit[:16], unit[16:]
    judgement = committee(column_data(from_unit(COLUMN, known)), POTENTIAL).judge(
        COLUMN.scatter(from_unit(COLUMN, candidates))
    )
    for count in (6, 40):
        chosen = most_worth(candidates, judgement, np.ones(len(candidates), dtype=bool), known, count, 0.05)
        assert len(chosen) == len(set(chosen)) <= count
        both = np.concatenate([known, candidates[chosen]])
        gaps = np.linalg.norm(both[:, None] - both, axis=2) + 9 * np.eye(len(both))
        if count == 6:
            assert len(chosen) == 6
            assert gaps[16:].min() > 0.05


def test_spread_out_takes_the_farthest() -> None:
    line = np.array([0.0, 0.1, 0.2, 0.3, 0.5, 1.0])[:, None]
    assert spread_out(line, np.ones(6), line[:1], 3) == [5, 4, 2]
    assert spread_out(line, np.array([1, 1, 1, 1, 1, 0.1]), line[:1], 1) == [4]
    assert spread_out(line, np.zeros(6), line[:1], 3) == []
    assert spread_out(line, np.ones(6), line, 3) == []


# ---- active -------------------------------------------------------------------------------------


@pytest.mark.parametrize("responses", [POTENTIAL, MEAN], ids=["potential", "mean gradient"])
def test_active_sampling_needs_fewer_states_than_a_sobol_sequence(responses: tuple[str, ...]) -> None:
    active = Active(COLUMN, count=24)
    active.inform(column_study(responses))
    states = from_unit(COLUMN, np.random.default_rng(0).random((200, 2)))
    truth = synthetic_cell.respond(COLUMN.scatter(states))

    def error(x: np.ndarray) -> float:
        found = (
            PolynomialSurrogate().fit(column_data(x), seed=0).predict(COLUMN.scatter(states), tangent=False)
        )
        if responses is MEAN:
            return float(np.abs(found.mean_grad - truth.mean_grad).max())
        assert found.stress is not None
        assert truth.stress is not None
        return float(np.abs(found.stress - truth.stress).max())

    chosen = solve_all(active, COLUMN, synthetic_cell)
    design = solve_all(SobolDesign(COLUMN, count=48), COLUMN, synthetic_cell)
    assert error(chosen) < error(design)


def test_the_neighbourhood_of_unstable_states_is_left_alone() -> None:
    def bad(x: np.ndarray) -> np.ndarray:
        return x[:, 0] < -0.1

    active = Active(COLUMN, count=60)
    active.inform(column_study())
    asked = solve_all(active, COLUMN, synthetic_cell, bad)
    # Half of the box is unstable: an even design would put 30 states there.
    deep = COLUMN.to_unit(asked)[:, 0] < 0.3
    assert len(asked) == 60
    assert deep.sum() <= 6
    assert bad(asked).sum() <= 18
    kept = active.training_set()
    assert kept is not None
    assert (kept.states.grad_u[:, 1, 1] >= -0.1).all()


@pytest.mark.parametrize("kind", [Active, MacroDriven])
def test_the_corners_come_first_in_up_to_three_inputs(kind: type[Active | MacroDriven]) -> None:
    names = ("H11", "H22", "H33", "p")
    for d in (1, 2, 3, 4):
        inputs = InputSpace(names[:d], (-0.1,) * d, (0.1,) * d)
        sampler = kind(inputs, count=20)
        asked = {request.x for request in sampler.ask()}
        corners = set(product((-0.1, 0.1), repeat=d))
        assert len(asked) == sampler.initial
        assert (corners <= asked) == (d <= 3)
        assert d <= 3 or not corners & asked


def test_active_sampling_ends_when_the_committee_agrees() -> None:
    active = Active(COLUMN, count=300, tolerance=0.01)
    active.inform(column_study())
    assert len(solve_all(active, COLUMN, synthetic_cell)) < 60
    assert active.expected < 60


def test_no_tolerance_ends_a_sampling_before_a_surrogate_can_be_trained() -> None:
    """Of seven inputs the committee agrees after 11 states; training refuses fewer than 16."""
    inputs = InputSpace(potential_cell.INPUTS.names[:7], (-0.01,) * 7, (0.01,) * 7)
    active = Active(inputs, count=60, tolerance=10.0)
    active.inform(StudyFacts(potential_cell.respond(MacroState.zeros(1)), "made up", POTENTIAL, None, judge))  # type: ignore[arg-type]
    asked = len(solve_all(active, inputs, potential_cell))
    assert least_states(7) == 16 <= asked < 30


def test_five_thousand_asks_in_ten_dimensions_cost_the_same_each() -> None:
    """CPU time for each state, the solving of the made-up cell left out."""
    inputs = potential_cell.INPUTS
    assert len(inputs) == 10
    for design in (SobolDesign, LatinHypercube):
        began = time.process_time()
        assert len(design(inputs, count=5000).ask()) == 5000
        assert time.process_time() - began < 5000 * 1e-3
    active = Active(inputs, count=5000, batch=1000)
    active.inform(StudyFacts(potential_cell.respond(MacroState.zeros(1)), "made up", POTENTIAL, None, judge))  # type: ignore[arg-type]
    costs: list[tuple[int, float]] = []
    while True:
        began = time.process_time()
        requests = active.ask()
        spent = time.process_time() - began
        if not requests:
            break
        costs.append((len(requests), spent))
        response = potential_cell.respond(inputs.scatter([request.x for request in requests]))
        for i, request in enumerate(requests):
            active.tell(request.key, response[i : i + 1])
    asked = np.cumsum([n for n, _ in costs])
    assert asked[-1] == 5000

    def each(low: int, high: int) -> float:
        rounds = [(n, t) for (n, t), at in zip(costs, asked, strict=True) if low < at <= high]
        return sum(t for _, t in rounds) / sum(n for n, _ in rounds)

    assert each(2500, 5000) < 2 * each(1000, 2500) + 1e-3


# ---- macro-driven -------------------------------------------------------------------------------


class Column:
    """A macro run that goes along a curve to where the stress of a fitted polynomial meets a load."""

    def __init__(self) -> None:
        self.sizes: list[int] = []

    def __call__(self, data: TrainingSet, *, elements: int, steps: int) -> Exploration:
        self.sizes.append(len(data.states))
        fitted = PolynomialSurrogate().fit(data, seed=0)
        H = np.zeros((400, 3, 3))
        H[:, 1, 1] = np.linspace(0, -0.2, 400)
        p = 0.1 * np.sin(np.linspace(0, np.pi, 400))
        stress = fitted.predict(MacroState(H, p), tangent=False).stress
        assert stress is not None
        end = int(np.argmax(stress[:, 1, 1] < -0.12))
        return Exploration(MacroState(H[: end + 1], p[: end + 1]), (float(H[end, 1, 1]), 0.1))


def test_macro_driven_sampling_follows_the_macro_run_until_it_stays() -> None:
    column = Column()
    sampler = MacroDriven(COLUMN, count=60, initial=8, batch=4)
    sampler.inform(column_study(explore=column))
    x = solve_all(sampler, COLUMN, synthetic_cell)
    assert sampler.converged
    assert len(x) < 60
    assert len(column.sizes) >= 3
    assert column.sizes == sorted(set(column.sizes))
    # What was asked for after the opening lies on the path, up to the lattice.
    share = x[8:, 0] / -0.2
    assert np.abs(x[8:, 1] - 0.1 * np.sin(np.pi * share)).max() < 0.003


def test_macro_runs_that_do_not_reach_their_end_never_settle() -> None:
    def explore(data: TrainingSet, *, elements: int, steps: int) -> Exploration:
        return Exploration(MacroState.zeros(1), (np.nan, np.nan))

    sampler = MacroDriven(COLUMN, count=26)
    sampler.inform(column_study(explore=explore))
    x = solve_all(sampler, COLUMN, synthetic_cell)
    assert len(x) == 26
    assert not sampler.converged
    # At rest alone nothing is new: the box is filled instead.
    unit = COLUMN.to_unit(x)
    gaps = np.linalg.norm(unit[:, None] - unit, axis=2) + 9 * np.eye(26)
    assert gaps.min() > 0.05


def test_visited_states_outside_the_box_are_moved_to_its_faces() -> None:
    def explore(data: TrainingSet, *, elements: int, steps: int) -> Exploration:
        H = np.zeros((50, 3, 3))
        H[:, 1, 1] = np.linspace(0, -0.5, 50)
        return Exploration(MacroState(H, np.full(50, 0.05)), (float(len(data.states)),))

    sampler = MacroDriven(COLUMN, count=14)
    sampler.inform(column_study(explore=explore))
    x = solve_all(sampler, COLUMN, synthetic_cell)
    assert (x >= COLUMN.lower).all()
    on_face = x[8:, 0] == COLUMN.lower[0]
    assert on_face.any()
    assert np.abs(x[8:][on_face][:, 1] - 0.05).max() < 0.001
