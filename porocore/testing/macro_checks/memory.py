"""Checks of runs with a law that has internal variables: steps, rejected steps, checkpoints, profiles."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore.interfaces.law import Interval, LawMemory, MacroResponse, columns_of
from porocore.interfaces.solution import History, MacroSolution, Profile, StepReport
from porocore.states import MacroState
from porocore.testing.expect import holds, near, same
from porocore.testing.macro_checks.runs import HELD, SHORT, SIDES, Killed, Solving
from porocore.testing.synthetic.response import (
    AlteredLaw,
    confined_column,
    relaxing_law,
    without_large_steps,
)

#: Strength and time of the branches of the solid, of which one relaxes within a step and one during the run.
RELAXING = relaxing_law((1.0, 0.1), (0.5, 3.0))
CREEP = confined_column(3, load=-0.1, time=SHORT | {"profiles": (1.0,)})
#: The same by steps of the length that their error allows.
ADAPTIVE = confined_column(3, load=-0.1, time=SHORT | {"profiles": (1.0,), "tolerance": 0.02})
#: A body that is held: its solid of one branch, the time of that, in what time it is loaded, and time.tolerance.
FADING, FADING_TIME, RAMP, TOLERANCE = relaxing_law((1.0, 1.0)), 1.0, 0.05, 4e-3
#: An error of a step, by its closed form, that none exceeds whose estimate is accepted.
LARGEST_ERROR = 3 * TOLERANCE


class Memories(Solving):
    """Part of :class:`porocore.testing.macro_checks.states.MacroSolverSuite`."""

    @pytest.fixture(scope="class")
    @classmethod
    def adaptive(cls) -> MacroSolution:
        return cls.solve(ADAPTIVE, RELAXING)

    def test_internal_variables_follow_those_of_a_point(self) -> None:
        """Profiles of a body in a uniform state, against the law along the steps of the run."""
        boundary = {**SIDES, "y-": HELD, "y+": {"displacement": (None, 1, None)}}
        plan = {"end": 2.0, "step": 0.3, "ramp_increments": 2, "ramp_step": 0.1}
        problem = confined_column(2, load=-0.3, boundary=boundary, time=plan | {"profiles": ()})
        times = self.solve(problem, RELAXING).history.time
        problem = confined_column(
            2, load=-0.3, boundary=boundary, time=plan | {"profiles": tuple(times[1:-1].tolist())}
        )
        solution = self.solve(problem, RELAXING)
        columns, memory, before = columns_of(RELAXING.internal), RELAXING.initial(1), None
        for profile in solution.profiles:
            state = f"a sealed column, displaced on top, at t = {profile.time:g}"
            at = MacroState(profile.grad_u[:1], profile.element_p[:1])
            step = None if before is None else Interval(before, profile.time)
            response = RELAXING.respond(at, np.zeros((1, 3)), memory, step=step, tangent=False)
            memory, before = response.memory, profile.time
            names = [each.name for each in RELAXING.internal]
            holds([*profile.internal] == names, state, f"internal variables {names}", [*profile.internal])
            for each in RELAXING.internal:
                wanted = memory.internal[0, columns[each.name]].reshape(each.shape)
                within = 1e-8 + self.within(1e-8) * float(np.abs(wanted).max())
                near(each.name, profile.internal[each.name], wanted, state, within=within)
            within = 1e-8 + self.within(1e-8) * float(np.abs(response.stress).max())
            near("P_E", profile.stress, response.stress[0], state, within=within)

    @pytest.mark.parametrize("rejected", ["without values", "for their error"])
    def test_rejected_steps_leave_no_trace(self, rejected: Any, request: Any) -> None:
        """Steps that are rejected or halved, against a run that goes to the accepted times at once."""
        if rejected == "for their error":
            found: MacroSolution = request.getfixturevalue("adaptive")
        else:
            law = without_large_steps(RELAXING, 0.02)
            failed: list[bool] = []

            def note(response: MacroResponse, states: MacroState, memory: LawMemory) -> MacroResponse:
                failed.append(bool(np.isnan(response.stress).any()))
                return response

            found = self.solve(CREEP, AlteredLaw(law, note))
            state = "a law without values where H changes by more than 0.02 in a step"
            holds(any(failed), state, "steps that fail", "none")
        times = tuple(found.history.time[1:-1].tolist())
        plan = CREEP.time.model_copy(update={"profiles": times})
        direct = self.solve(CREEP.model_copy(update={"time": plan}), RELAXING)
        state = f"steps that were rejected {rejected}, against a run through the accepted ones"
        steps, wanted_steps = len(found.history.time), len(direct.history.time)
        holds(steps == wanted_steps, state, f"{wanted_steps} steps", steps)
        same("time", found.history.time, direct.history.time, state)
        for name in ("settlement", "pressure_max", "drained"):
            wanted = getattr(direct.history, name)
            near(name, getattr(found.history, name), wanted, state, within=1e-9 * float(np.abs(wanted).max()))
        _alike(found.profiles[-1], direct.profiles[-1], state, share=1e-9)

    @pytest.mark.parametrize("after", [0.08, 2.0])
    def test_a_killed_run_continues_with_its_internal_variables(
        self, tmp_path: Any, adaptive: Any, after: Any
    ) -> None:
        """The lengths of the steps follow from their errors, too; to the last bit."""
        path: Path = tmp_path / "macro.h5"

        def stop(report: StepReport) -> None:
            if report.time >= after:
                raise Killed

        self.stopped(ADAPTIVE, RELAXING, 0, path, stop)
        resumed = self.solve(ADAPTIVE, RELAXING, checkpoint=path)
        state = f"a solid that relaxes, killed after t = {after:g} and resumed, against a whole run"
        for field in fields(History):
            mine, other = getattr(resumed.history, field.name), getattr(adaptive.history, field.name)
            same(f"history.{field.name}", mine, other, state)
        _alike(resumed.profiles[-1], adaptive.profiles[-1], state)

    def test_steps_follow_the_error_of_internal_variables(self) -> None:
        """A drained body that is held stands still while its overstress Q fades with exp(−t/τ).

        The error Δt² Q̈/2 of each step, as a share of the largest Q.
        """
        dry = {"pressure": 0}
        boundary = {**SIDES, "y-": HELD | dry, "y+": {"displacement": (None, 1, None)} | dry}
        plan = {"end": 2.0, "step": 0.5, "ramp_increments": 1, "ramp_step": RAMP, "profiles": ()}
        problem = confined_column(
            2, load=-0.01, size=(0.1, 0.2, 0.1), boundary=boundary, time=plan | {"tolerance": TOLERANCE}
        )
        time = self.solve(problem, FADING).history.time
        time = time[time >= RAMP * (1 - 1e-9)]
        lengths, left = np.diff(time), np.exp(-(time[1:] - time[0]) / FADING_TIME)
        largest = float((lengths**2 / 2 / FADING_TIME**2 * left).max())
        state = f"a drained body that is held while it relaxes, time.tolerance = {TOLERANCE:g}"
        holds(largest < LARGEST_ERROR, state, f"steps in error by less than {LARGEST_ERROR:g}", largest)


def _alike(found: Profile, wanted: Profile, state: str, *, share: float = 0.0) -> None:
    """Expect the same arrays, up to a share of the largest entry of each."""
    theirs, mine = wanted.arrays(), found.arrays()
    holds(mine.keys() == theirs.keys(), state, f"fields {', '.join(theirs)}", ", ".join(mine))
    for name, values in theirs.items():
        if share:
            near(name, mine[name], values, state, within=share * max(float(np.abs(values).max()), 1e-6))
        else:
            same(name, mine[name], values, state)
