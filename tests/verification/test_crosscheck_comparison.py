"""How a difference is measured: scales, tolerances, and what cannot be compared."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from porocore.commands.crosscheck.bodies import (
    HISTORIES,
    BodyRun,
    CellRun,
    compare_bodies,
    compare_cells,
    compare_responses,
    history_difference,
    node_orders,
    relative,
    scales,
)
from porocore.commands.crosscheck.comparison import BODY, CELL, Comparison
from porocore.states import MacroState, Status
from porocore.testing.synthetic.cell import respond

STATE = MacroState.single(np.diag([0.0, -0.1, 0.0]), 0.05)


def lines(a, b):
    return {line.quantity: line for line in compare_responses("somewhere", "one", a, "other", b)}


def test_a_tensor_is_measured_by_its_largest_component():
    a = np.array([[2.0, 0.0], [0.0, -4.0]])
    b = a + np.array([[0.0, 1e-6], [0.0, 0.0]])
    assert relative(a, b, 0.0) == pytest.approx(2.5e-7)
    assert relative(a, b, 40.0) == pytest.approx(2.5e-8)
    assert relative(b, a, 0.0) == relative(a, b, 0.0)


def test_nothing_differs_from_nothing_by_nothing():
    assert relative(np.zeros(3), np.zeros(3), 0.0) == 0.0
    assert relative(np.zeros(3), np.full(3, 1e-20), 0.0) == 1.0


@pytest.mark.parametrize("bad", [np.array([1.0, np.nan]), np.array([1.0, np.inf]), np.ones(3)])
def test_what_is_no_number_or_has_another_shape_is_infinitely_far(bad):
    assert relative(np.ones(2), bad, 1.0) == math.inf
    assert not Comparison("cell", "", "W", "a", "b", relative(np.ones(2), bad, 1.0), CELL).passed


def test_at_rest_an_average_is_measured_by_an_ordinary_deformation():
    rest = respond(MacroState.zeros(1))
    assert np.abs(rest.stress).max() < 1e-15
    found = scales(rest)
    assert found["stress"] == pytest.approx(0.1 * np.abs(rest.tangent.stress_grad_u).max())
    assert found["potential"] == pytest.approx(0.01 * np.abs(rest.tangent.stress_grad_u).max())
    shifted = replace(rest, stress=rest.stress + 2 * CELL * found["stress"])
    line = lines(rest, shifted)["P_E"]
    assert not line.passed
    assert line.difference == pytest.approx(2 * CELL)
    assert lines(rest, replace(rest, stress=rest.stress + 0.5 * CELL * found["stress"]))["P_E"].passed


@pytest.mark.parametrize("name", ["mean_grad", "potential", "stress", "fluid_volume"])
def test_every_average_is_compared(name):
    a = respond(STATE)
    b = replace(a, **{name: getattr(a, name) * (1 + 1e-5)})
    assert [line.quantity for line in lines(a, b).values() if not line.passed] == [
        {"mean_grad": "⟨∇u¹⟩", "potential": "W", "stress": "P_E", "fluid_volume": "φ"}[name]
    ]


@pytest.mark.parametrize(
    "name", [name for name, value in vars(respond(STATE).tangent).items() if value is not None]
)
def test_every_derivative_is_compared(name):
    a = respond(STATE)
    value = getattr(a.tangent, name).copy()
    value.flat[-1] += 1e-5 * np.abs(value).max()
    b = replace(a, tangent=replace(a.tangent, **{name: value}))
    (line,) = [line for line in lines(a, b).values() if not line.passed]
    assert line.quantity.startswith("∂")
    assert line.difference == pytest.approx(1e-5, rel=1e-3)


def test_what_only_one_provides_is_a_failure():
    a = respond(STATE)
    line = lines(a, replace(a, potential=None))["W"]
    assert not line.passed
    assert line.reason == "not provided by other"
    assert "W" not in lines(replace(a, potential=None), replace(a, potential=None))


def test_other_statuses_are_a_failure_and_the_only_line():
    a = respond(STATE)
    b = replace(a, status=np.array([int(Status.overlap)]))
    (line,) = lines(a, b).values()
    assert (line.quantity, line.reason, line.passed) == ("status", "converged against overlap", False)
    (line,) = lines(b, b).values()
    assert line.passed


def test_every_pair_of_three_is_compared():
    runs = [
        CellRun(name, {}, (1 + shift) * np.eye(3)) for name, shift in (("a", 0), ("b", 1e-9), ("c", 1e-3))
    ]
    found = {line.pair: line.passed for line in compare_cells(runs)}
    assert found == {"a – b": True, "a – c": False, "b – c": False}


def test_a_history_is_measured_at_every_time():
    a = np.array([0.0, 1.0, 10.0, 0.5, 0.001])
    b = a + np.array([0.0, 1e-3, 1e-3, 1e-3, 1e-3])
    # The last values are small beside a hundredth of the largest, 0.1.
    np.testing.assert_allclose(
        history_difference(a, b), [0, 1e-3 / 1.001, 1e-3 / 10.001, 1e-3 / 0.501, 1e-2], rtol=1e-3
    )
    assert history_difference(a, np.where(a == 1, np.nan, a)).max() == math.inf
    assert history_difference(0 * a, 0 * a).max() == 0


def test_nodes_are_matched_in_any_order():
    rng = np.random.default_rng(1)
    points = rng.integers(0, 5, (20, 3)) / 4 + np.arange(20)[:, None]
    order = rng.permutation(20)
    first, second = node_orders(points, points[order] + 1e-13)
    np.testing.assert_allclose(points[first], points[order][second], atol=1e-12)
    assert node_orders(points, points[:-1]) is None
    assert node_orders(points, points + 0.01) is None


def test_bodies_are_compared_by_histories_and_fields(column):
    a = column()
    same = compare_bodies([BodyRun("one", "x", a, 1.0), BodyRun("other", "x", column(), 1.0)])
    assert all(line.passed and line.difference == 0 for line in same)
    assert [line.quantity for line in same[: len(HISTORIES)]] == [*HISTORIES.values()]
    assert [line.quantity for line in same[len(HISTORIES) :]] == [
        f"{field} at t = {time:g}" for time in (1, 10, 40, 100) for field in "up"
    ]
    order = np.random.default_rng(0).permutation(len(a.points))
    shuffled = replace(
        a,
        points=a.points[order],
        profiles=tuple(replace(p, u=p.u[order] * (1 + 1e-5), p=p.p[order]) for p in a.profiles),
    )
    found = compare_bodies([BodyRun("one", "x", a, 1.0), BodyRun("other", "x", shuffled, 1.0)])
    wrong = [line for line in found if not line.passed]
    assert [line.quantity for line in wrong] == [f"u at t = {time}" for time in (1, 10, 40, 100)]
    assert wrong[0].difference == pytest.approx(1e-5, rel=1e-3)
    assert wrong[0].tolerance == BODY


def test_bodies_of_other_laws_or_without_a_solution_are_not_compared(column):
    runs = [
        BodyRun("one", "x", column(), 1.0),
        BodyRun("other", "y", column(), 1.0),
        BodyRun("third", "x", None, 1.0, "no"),
    ]
    (line,) = compare_bodies(runs)
    assert line.describe() == "solution, law x, third: no"


def test_the_excess_orders_failures_before_differences():
    failure = Comparison.failure("cell", "", "solution", "a", "raised")
    large = Comparison("cell", "", "W", "a", "b", 1e-2, CELL)
    small = Comparison("body", "", "u", "a", "b", 1e-2, BODY)
    assert failure.excess > large.excess > small.excess > 1
    assert Comparison("surrogate", "", "W", "a", "b", 1e-9, 0.0).excess == math.inf
    assert Comparison("surrogate", "", "W", "a", "b", 0.0, 0.0).passed
