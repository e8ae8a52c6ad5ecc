"""The time stepping: stops that are hit exactly, halving and growing back."""

from __future__ import annotations

from itertools import pairwise

import pytest
from pydantic import ValidationError

from porocore.errors import SolveError
from porocore.macro.integration.stepping import STUCK, Stepper
from porocore.macro.problem import TimePlan


def run(stepper, fails=lambda time, dt: False):
    times = [stepper.time]
    while not stepper.done:
        time = stepper.next()
        if fails(time, time - stepper.time):
            stepper.reject("no reason")
        else:
            stepper.accept()
            times.append(time)
    return times


def test_papers_plan_is_ten_tenths_and_then_whole_steps():
    times = run(Stepper(TimePlan(end=100, step=0.5, ramp_increments=10, ramp_step=0.05)))
    assert len(times) == 1 + 10 + 199
    assert times[1:11] == pytest.approx([0.05 * k for k in range(1, 11)], rel=1e-15)
    assert {0.5, 1.0, 10.0, 40.0, 100.0} <= set(times)
    assert max(b - a for a, b in pairwise(times[10:])) == pytest.approx(0.5, rel=1e-12)


def test_odd_profile_times_are_hit_exactly_and_leave_no_sliver():
    plan = TimePlan(end=7, step=1, ramp_increments=3, ramp_step=0.1, profiles=(0.17, 2.05, 6.999))
    stepper = Stepper(plan)
    times = run(stepper)
    assert {0.1, 0.17, 0.2, 0.30000000000000004, 2.05, 6.999, 7} <= set(times)
    assert [t for t in times if stepper.is_profile(t)] == [0.17, 2.05, 6.999, 7]
    steps = [b - a for a, b in pairwise(times)]
    assert max(steps) <= 1
    between = [b - a for a, b in pairwise(times) if a >= 0.3 and b <= 2.05]
    assert between == pytest.approx([0.875, 0.875])


def test_a_profile_at_the_end_of_the_ramp_is_one_time():
    times = run(Stepper(TimePlan(end=2, step=0.5, ramp_increments=10, ramp_step=0.05, profiles=(0.5,))))
    assert len(times) == len(set(times)) == 1 + 10 + 3


def test_failed_steps_are_halved_and_grow_back():
    stepper = Stepper(TimePlan(end=20, step=1, ramp_increments=1, ramp_step=1, profiles=()))
    times = run(stepper, lambda time, dt: 5 <= time <= 8 and dt > 0.25)
    steps = {round(a, 6): b - a for a, b in pairwise(times)}
    assert max(b - a for a, b in pairwise(times) if 5 <= b <= 8) <= 0.25
    assert sum(b - a > 0.25 for a, b in pairwise(times)) > 10
    assert steps[19.0] == pytest.approx(1)
    assert stepper.halvings == 0
    assert times[-1] == 20


def test_a_rejected_step_is_at_most_half_as_long_even_before_a_stop():
    stepper = Stepper(TimePlan(end=2.4, step=1, ramp_increments=1, ramp_step=1, profiles=()))
    stepper.accept()
    before = stepper.next() - stepper.time
    assert before == pytest.approx(0.7)
    stepper.reject("no reason")
    assert stepper.next() - stepper.time <= before / 2


def test_the_smallest_step_ends_in_an_error_with_the_reason():
    stepper = Stepper(TimePlan(end=2, step=1, ramp_increments=1, ramp_step=1, profiles=(), smallest_step=0.1))
    for _ in range(3):
        stepper.reject("it folds")
    message = r"from t = 0 failed at its smallest length 0.125 .*0.1\): it folds; lower"
    with pytest.raises(SolveError, match=message):
        stepper.reject("it folds")


def test_a_restored_stepper_continues_with_the_same_times():
    plan = TimePlan(end=9, step=0.7, ramp_increments=3, ramp_step=0.1, profiles=(3.3,))

    def fails(time, dt):
        return 2 < time < 4 and dt > 0.2

    whole = run(Stepper(plan), fails)
    stepper = Stepper(plan)
    while stepper.time < 3:
        stepper.reject("no reason") if fails(
            stepper.next(), stepper.next() - stepper.time
        ) else stepper.accept()
    restored = Stepper(plan, (), stepper.time, stepper.halvings, stepper.streak)
    assert stepper.halvings > 0
    assert run(restored, fails) == [t for t in whole if t >= stepper.time]


def test_a_load_curve_takes_the_place_of_the_ramp_and_its_corners_are_hit():
    plan = TimePlan(
        end=10,
        step=4,
        ramp_increments=1,
        ramp_step=0.5,
        profiles=(),
        load_curve=((1.25, 2.0), (3, -1), (9, 0)),
    )
    assert {0.5, 1.25, 3, 9, 10} <= set(run(Stepper(plan)))
    shares = {0: 0, 0.5: 0.8, 1.25: 2.0, 2.125: 0.5, 3: -1, 6: -0.5, 9: 0, 10: 0}
    for time, share in shares.items():
        assert plan.share(time) == pytest.approx(share, abs=1e-15)
    assert TimePlan(ramp_increments=4, ramp_step=0.5).share(0.5) == 0.25
    assert TimePlan(ramp_increments=4, ramp_step=0.5).share(7) == 1


@pytest.mark.parametrize(
    ("curve", "message"),
    [
        (((2, 1), (1, 1)), "times of load_curve do not ascend: entry 2 is not after entry 1"),
        (((1, 1), (1, 2)), "do not ascend"),
        (((200, 1),), "lies behind end = 100"),
        (((0, 1),), "greater than 0"),
    ],
)
def test_a_load_curve_out_of_order_is_refused(curve, message):
    with pytest.raises(ValidationError, match=message):
        TimePlan(load_curve=curve)


def test_steps_that_shrink_without_end_are_an_error():
    """A body that was turned inside out proposed a step of zero, which ended in a ZeroDivisionError."""
    plan = TimePlan(
        end=2, step=1, ramp_increments=1, ramp_step=1, profiles=(), smallest_step=0.01, tolerance=1e-3
    )
    stepper = Stepper(plan)

    def step(error):
        while not stepper.tolerates(error):
            pass
        stepper.accept(error)

    for _ in range(STUCK - 1):
        step(5.0)
        assert stepper.next() > stepper.time
    assert stepper.proposed == plan.smallest_step
    step(0.0)  # so it begins to count anew
    for _ in range(STUCK // 4):
        step(5.0)
    stepper.stuck = STUCK - 1
    with pytest.raises(
        SolveError, match=r"smallest length 0\.01 \(smallest_step\), 100 of them .*'until' of its ramp"
    ):
        step(5.0)
