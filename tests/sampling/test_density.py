"""The sweep with density check, on functions whose curvature is known."""

from __future__ import annotations

import random
from collections.abc import Callable

import numpy as np
import pytest

from porocore.core.inputs import InputSpace
from porocore.errors import ConfigurationError
from porocore.interfaces.sampler import Request
from porocore.sampling.hooks import porocore_samplers
from porocore.sampling.samplers.density import DensitySweep
from porocore.states import CellResponse, Status

Function = Callable[..., float | np.ndarray | None]


def drive(sampler: DensitySweep, function: Function, shuffle: int | None = None) -> dict[str, Request]:
    """Solve until done; None is a failed state, a number stands in the component 22."""
    pick = random.Random(shuffle)
    seen: dict[str, Request] = {}
    waiting: list[Request] = []
    while True:
        waiting += sampler.ask()
        if not waiting:
            break
        request = waiting.pop(0 if shuffle is None else pick.randrange(len(waiting)))
        assert request.key not in seen
        assert request.start is None or request.start in seen
        seen[request.key] = request
        value = function(*request.x)
        g, status = np.full((1, 3, 3), np.nan), Status.overlap
        if value is not None:
            g, status = np.zeros((1, 3, 3)), Status.converged
            if isinstance(value, np.ndarray):
                g[0] = value
            else:
                g[0, 1, 1] = value
        sampler.tell(request.key, CellResponse(g, np.array([int(status)])))
    assert sampler.done
    assert sampler.expected == len(seen)
    return seen


def one_input(low: float, high: float, step: float, tolerance: float, function: Function) -> list[float]:
    sampler = DensitySweep(InputSpace(("H22",), (low,), (high,)), step={"H22": step}, tolerance=tolerance)
    return sorted(request.x[0] for request in drive(sampler, function).values())


def on_ten(value: float) -> np.ndarray:
    """``value`` in the component 22 of a matrix whose norm is 10 but for a little."""
    g = np.zeros((3, 3))
    g[0, 1], g[1, 1] = 10.0, value
    return g


def test_a_linear_response_needs_only_the_default_steps() -> None:
    points = one_input(-0.4, 0.4, 0.03, 1e-9, lambda x: 0.3 * x)
    grid = [0.03 * i for i in range(14)] + [0.4]
    np.testing.assert_allclose(points, [-x for x in grid[:0:-1]] + grid, atol=1e-15)
    assert (points[0], points[-1]) == (-0.4, 0.4)


@pytest.mark.parametrize(("low", "high"), [(0.0, 0.3), (-0.3, 0.0)])
def test_an_end_on_the_grid_is_hit_once_and_exactly(low: float, high: float) -> None:
    points = one_input(low, high, 0.1, 1e-9, lambda x: x)
    assert len(points) == 4
    assert {points[0], points[-1]} == {low, high}


@pytest.mark.parametrize(
    ("tolerance", "extra"),
    [
        # The secant of g = x² errs by h(h + h'), h' the step before; over ‖g‖ = 10, in 1e-3: both steps
        # 0.1: 2; 0.05 after 0.1: 0.75; both 0.05: 0.5; 0.1 after 0.05: 1.5.
        (2.1e-3, []),
        (1.6e-3, [0.15, 0.35]),
        (1.0e-3, [0.15, 0.25, 0.35, 0.45]),
    ],
)
def test_a_parabola_is_refined_where_the_secant_errs(tolerance: float, extra: list[float]) -> None:
    points = one_input(0.0, 0.5, 0.1, tolerance, lambda x: on_ten(x * x))
    np.testing.assert_allclose(points, sorted([0, 0.1, 0.2, 0.3, 0.4, 0.5, *extra]), atol=1e-14)


def test_no_interval_is_smaller_than_the_smallest() -> None:
    points = one_input(0.0, 0.5, 0.1, 1e-9, lambda x: on_ten(x * x))
    gaps = np.diff(points)
    np.testing.assert_allclose(gaps[0], 0.1)
    np.testing.assert_allclose(gaps[1:], 0.1 / 8)


def test_where_the_response_bends_every_accepted_point_passes_the_check_or_is_at_the_floor() -> None:
    def bend(x: float) -> np.ndarray:
        return np.array([[1.0, 0.2 * x, 0], [0, np.tanh(20 * (x - 0.5)), 0], [0, 0, 0]])

    tolerance, step = 0.05, 0.1
    points = one_input(0.0, 1.0, step, tolerance, bend)
    refined = np.diff(points) < 0.9 * step
    assert refined.any()
    # Flat far from the bend, where the first two and the last two default steps stay.
    assert not refined[:2].any()
    assert not refined[-2:].any()
    for a, b, c in zip(points, points[1:], points[2:], strict=False):
        line = np.polyfit([a, b], [bend(a).ravel(), bend(b).ravel()], 1)
        extrapolated = np.array([np.polyval(line[:, i], c) for i in range(9)])
        residual = np.abs(bend(c).ravel() - extrapolated).max() / np.sqrt((bend(c) ** 2).sum())
        assert residual <= tolerance or c - b < 2 * step / 8 - 1e-12


def test_a_zero_of_the_response_is_no_reason_to_refine() -> None:
    def crossing(x: float) -> float:
        return x - 0.2 + 1e-3 * x * x

    # The plain residual at 0.2 is a half: 2e-5 over 4e-5.
    secant = 2 * crossing(0.1) - crossing(0.0)
    assert abs(crossing(0.2) - secant) / abs(crossing(0.2)) > 0.4
    assert len(one_input(0.0, 0.5, 0.1, 0.05, crossing)) == 6


def test_round_off_of_a_cell_without_response_is_no_reason_to_refine() -> None:
    noise = np.random.default_rng(3)
    assert len(one_input(0.0, 0.5, 0.1, 0.05, lambda x: 1e-15 * noise.standard_normal())) == 6


def test_the_edge_of_the_computable_region_is_resolved_and_the_grid_goes_on_beyond_it() -> None:
    sampler = DensitySweep(InputSpace(("H22",), (-0.5,), (0.0,)), step={"H22": 0.1}, tolerance=0.05)
    seen = drive(sampler, lambda x: None if x < -0.23 else 0.3 * x)
    order = [request.x[0] for request in seen.values()]
    np.testing.assert_allclose(order, [0, -0.1, -0.2, -0.3, -0.25, -0.225, -0.2375, -0.4, -0.5], atol=1e-14)
    starts = [request.start and float(request.start.removeprefix("H22=")) for request in seen.values()]
    assert starts == [None, 0.0, -0.1, -0.2, -0.2, -0.2, -0.225, -0.225, -0.225]


def test_good_states_beyond_the_edge_are_data_and_are_not_checked() -> None:
    def island(x: float) -> float | None:
        return None if 0.23 < x < 0.35 else 0.3 * x + (100 * (x - 0.4) ** 2 if x > 0.4 else 0)

    points = one_input(0.0, 0.8, 0.1, 0.01, island)
    edge = [0.25, 0.225, 0.2375]
    np.testing.assert_allclose(points, sorted([0.1 * i for i in range(9)] + edge), atol=1e-14)


def test_a_failure_between_a_good_point_and_one_that_failed_the_check() -> None:
    """0.2 is good but too far off, with nothing solvable on the way: it stays data and starts sweeps."""
    inputs = InputSpace(("p", "H22"), (0.0, 0.0), (0.3, 0.1))
    sampler = DensitySweep(inputs, step={"p": 0.1, "H22": 0.1}, tolerance=0.05)
    seen = drive(sampler, lambda p, h: None if 0.11 < p < 0.19 else p + 50 * max(p - 0.1, 0) ** 2)
    values = [request.x for request in seen.values()]
    assert {round(p, 9) for p, h in values if h == 0} == {0, 0.1, 0.1125, 0.125, 0.15, 0.2, 0.3}
    assert {round(p, 9) for p, h in values if h != 0} == {0, 0.1, 0.2, 0.3}


def test_nested_sweeps_start_from_every_accepted_value() -> None:
    inputs = InputSpace(("p", "H22", "H12"), (-0.2, -0.3, 0.0), (0.2, 0.1, 0.2))
    sampler = DensitySweep(inputs, step={"p": 0.1, "H22": 0.1, "H12": 0.1}, tolerance=0.1)
    assert sampler.expected == 5 * 5 * 3
    seen = drive(sampler, lambda p, h, g: 0.1 * p - 0.2 * h + 0.3 * g)
    grid = {
        (p, h, g)
        for p in (-0.2, -0.1, 0.0, 0.1, 0.2)
        for h in (-0.3, -0.2, -0.1, 0.0, 0.1)
        for g in (0.0, 0.1, 0.2)
    }
    assert {tuple(round(v, 9) for v in request.x) for request in seen.values()} == grid
    assert len(seen) == len(grid)
    key = "p=+0.1000000000 H22=-0.1000000000 H12=+0.0000000000"
    assert seen[key].start == "p=+0.1000000000 H22=+0.0000000000 H12=+0.0000000000"


def test_a_value_that_fails_starts_no_sweeps() -> None:
    inputs = InputSpace(("p", "H22"), (-0.2, -0.2), (0.2, 0.2))
    sampler = DensitySweep(inputs, step={"p": 0.1, "H22": 0.1}, tolerance=0.1, smallest=1.0)
    seen = drive(sampler, lambda p, h: None if p < -0.05 else p + h)
    assert {round(r.x[0], 9) for r in seen.values() if r.x[1] != 0} == {0, 0.1, 0.2}
    assert {round(r.x[0], 9) for r in seen.values()} == {-0.2, -0.1, 0, 0.1, 0.2}


def test_a_cell_that_cannot_be_solved_at_rest_ends_the_sampling() -> None:
    sampler = DensitySweep(InputSpace(("p",), (-1.0,), (1.0,)), step={"p": 0.1})
    assert list(drive(sampler, lambda p: None)) == ["p=+0.0000000000"]


@pytest.mark.parametrize("order", range(6))
def test_the_order_of_completion_changes_nothing(order: int) -> None:
    inputs = InputSpace(("p", "H22"), (-0.3, -0.4), (0.3, 0.2))

    def response(p: float, h: float) -> float | None:
        return None if h + 0.3 * p < -0.27 else 0.1 * p - 0.2 * h / (1 + 2 * h) + np.sin(9 * p) * h

    def asked(shuffle: int | None) -> dict[str, Request]:
        sampler = DensitySweep(inputs, step={"p": 0.1, "H22": 0.1}, tolerance=0.05)
        return drive(sampler, response, shuffle)

    first = asked(None)
    assert len(first) > 60
    assert asked(order) == first


def test_independent_sweeps_are_asked_for_together() -> None:
    inputs = InputSpace(("p", "H22"), (-0.1, -0.1), (0.1, 0.1))
    sampler = DensitySweep(inputs, step={"p": 0.1, "H22": 0.1})
    (root,) = sampler.ask()
    assert sampler.ask() == []
    sampler.tell(root.key, CellResponse(np.zeros((1, 3, 3)), np.array([0])))
    assert {request.x for request in sampler.ask()} == {(0.1, 0.0), (-0.1, 0.0), (0.0, 0.1), (0.0, -0.1)}
    with pytest.raises(ValueError, match="told before"):
        sampler.tell(root.key, CellResponse(np.zeros((1, 3, 3)), np.array([0])))


@pytest.mark.parametrize(
    ("ranges", "options", "named"),
    [
        ((-0.1, 0.1), {}, "sampling.inputs.H22.step: missing"),
        ((-0.1, 0.1), {"step": {"H22": 0.1, "H23": 0.1}}, "step.H23: names no sampled input"),
        ((-0.1, 0.1), {"step": {"H22": -0.1}}, "inputs.H22.step: must be a positive number, got -0.1"),
        ((-0.1, 0.1), {"step": {"H22": "wide"}}, "inputs.H22.step: must be a positive number, got 'wide'"),
        ((-0.1, 0.1), {"step": {"H22": float("nan")}}, "inputs.H22.step: must be a positive number"),
        ((-0.1, 0.1), {"step": {"H22": 1e-9}}, "allows intervals below"),
        (
            (-0.1, 0.1),
            {"step": {"H22": 0.1}, "tolerance": 0},
            "sampling.tolerance: must be a positive number",
        ),
        ((-0.1, 0.1), {"step": {"H22": 0.1}, "smallest": 2}, "sampling.options.smallest: must be a fraction"),
        ((-0.1, 0.1), {"step": {"H22": 0.1}, "tolerence": 0.1}, "unknown option 'tolerence'"),
        ((0.1, 0.2), {"step": {"H22": 0.1}}, "sampling.inputs.H22.range: must include 0"),
    ],
)
def test_options_that_cannot_be_used_are_named(
    ranges: tuple[float, float], options: dict[str, object], named: str
) -> None:
    with pytest.raises(ConfigurationError, match=named.replace(".", r"\.")):
        DensitySweep(InputSpace(("H22",), ranges[:1], ranges[1:]), **options)


def test_the_sweep_enters_through_the_plugin_door() -> None:
    (offer,) = [offer for offer in porocore_samplers() if offer.name == "density-sweep"]
    assert offer.name == "density-sweep"
    assert offer.load() is DensitySweep
