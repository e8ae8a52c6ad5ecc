"""Time steps by their error: also the first after each bend of the load, of which no rate is known."""

from itertools import pairwise, starmap

import numpy as np
import pytest

from porocore.interfaces.law import InternalVariable, Interval
from porocore.macro.integration.newton import newton_step
from porocore.macro.integration.stepping import ErrorControl, Reached, TimeState
from porocore.testing.synthetic.response import confined_column, linear_law

Solver = pytest.importorskip("porocore_fem_skfem.macro").SkfemMacroSolver
SIDES = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
BENDS = (0.0, 0.5, 4.0, 4.5)
TABLE = [[0, 0], [0.5, -0.01], [4, -0.01], [4.5, -0.02], [8, -0.02]]


def column(**plan):
    faces = {
        **SIDES,
        "y-": {"displacement": (0, 0, 0)},
        "y+": {"traction": (0, {"table": TABLE}, 0), "pressure": 0},
    }
    time = {"end": 8.0, "step": 1.0, "ramp_increments": 1, "ramp_step": 0.1, "profiles": BENDS[1:], **plan}
    return confined_column(6, 1.0, size=(0.1, 2.0, 0.1), boundary=faces, time=time)


def end_of(d, law, x, begin, end, count):
    """Unknowns after ``count`` equal steps."""
    states, grad_p = d.states(x)
    memory = law.respond(states, grad_p, law.initial(d.n_points)).memory
    times = np.linspace(begin, end, count + 1)
    for interval in starmap(Interval, pairwise(times)):
        loads = d.loads(d.boundary.amplitudes(d.problem, interval.end))
        step = newton_step(d, law, memory, x, interval, loads, d.problem.newton)
        x, memory = step.x, step.response.memory
    return x


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
def test_the_first_step_after_each_bend_meets_the_tolerance(tolerance):
    """Its error against a hundred steps over the same time, as a share of the largest values."""
    solver, law = Solver(), linear_law()
    d = solver.prepare(column(tolerance=tolerance))
    found = solver.solve(d, law)
    time = found.history.time
    starts = {0.0: np.zeros(d.mesh.size)}
    for profile in found.profiles:
        starts[profile.time] = np.concatenate([profile.u.ravel(), profile.p[d.mesh.p_nodes]])
    for bend in BENDS:
        first = float(time[time > bend + 1e-9][0])
        so_far = time <= max(first, BENDS[1])
        scales = (abs(getattr(found.history, name)[so_far]).max() for name in ("settlement", "pressure_max"))
        one, many = (end_of(d, law, starts[bend], bend, first, count) for count in (1, 100))
        for block, scale in zip((d.is_force, ~d.is_force), scales, strict=True):
            assert abs(one - many)[block].max() < 3 * tolerance * scale, (bend, first - bend)
    assert len(time) < 1000


def test_two_half_steps_tell_the_error_of_one():
    """Of ẋ = −x, to a fifth, and half of it of a step of half the length squared."""
    problem = column(tolerance=1e-3)
    d = Solver().prepare(problem)
    old, control = at(np.ones(d.mesh.size)), ErrorControl(d)
    for dt in (0.1, 0.05):
        one, two = old.x / (1 + dt), old.x / (1 + dt / 2) ** 2
        error = control.error(old, at(one), dt, at(two))
        assert error == pytest.approx((one - np.exp(-dt))[0] / one[0], rel=0.2)
    assert control.error(old, old, 0.1) is None
    assert control.scales == (0.0, 0.0)


def at(x, internal=()):
    return TimeState(x, np.array(internal, float).reshape(1, -1))


def test_internal_variables_of_a_group_are_measured_by_its_largest():
    """Of ẋ = −x beside a small one of the same group, one of another group, and one that does not count."""
    d = Solver().prepare(column(tolerance=1e-3))
    groups = [InternalVariable("a", (), "stress"), InternalVariable("b", (), "stress")]
    groups += [InternalVariable("c", (), "pressure"), InternalVariable("d")]
    control, still, dt = ErrorControl(d, groups), np.zeros(d.mesh.size), 0.1
    found = {}
    for name, row in {"small": (1, 2, 1, 1), "large": (2, 1, 1, 1), "free": (1, 1, 1, 2)}.items():
        old = at(still, (1.0, 1e-3, 1e-3, 1.0))
        factor = np.array(row, float)
        one, two = old.internal / (1 + dt) ** factor, old.internal / (1 + dt / 2) ** (2 * factor)
        found[name] = control.error(old, TimeState(still, one), dt, TimeState(still, two))
    assert found["small"] == found["free"] == pytest.approx(0.1**2 / 2, rel=0.2)
    assert found["large"] > 1.5 * found["small"]


def test_the_share_of_the_first_load_never_falls_and_is_one_from_its_bend_on():
    d = Solver().prepare(column(tolerance=1e-3, ramp_step=0.4))
    reached = Reached(d.boundary, d.problem)
    assert [reached(t) for t in (0.1, 0.2, 0.4, 2.0)] == pytest.approx([0.25, 0.5, 1, 1])
    swinging = {"displacement": (None, {"expression": "0.1*sin(pi*t)"}, None)}
    faces = {**SIDES, "y-": {"displacement": (0, 0, 0)}, "y+": swinging}
    plan = {"end": 4.0, "ramp_increments": 1, "ramp_step": 3.0, "profiles": ()}
    d = Solver().prepare(confined_column(1, 1.0, boundary=faces, time=plan))
    reached = Reached(d.boundary, d.problem)
    assert [reached(t) for t in (0.25, 0.5, 1.0, 2.0)] == pytest.approx([2**-0.5, 1, 1, 1], rel=1e-3)
    still = confined_column(1, 0.0, time={"end": 4.0, "profiles": ()})
    assert Reached(Solver().prepare(still).boundary, still)(0.1) == 1.0
