"""Macro solvers that treat the internal variables of a law wrongly."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np

from porocore.interfaces.law import LawWrapper
from porocore.macro.integration import solver, stepping
from porocore.macro.integration.discretisation import StepFailed
from porocore.macro.integration.stepping import TimeState
from tests.testing.wrong.macro_runs import Checkpoints
from tests.testing.wrong.skfem_macro import Altered, Law


class Timeless(LawWrapper):
    """A law that is asked as for a state that has stood for long."""

    def respond_to_each(self, states, gradients, memory, *, step=None, tangent=True):
        return super().respond_to_each(states, gradients, memory, tangent=tangent)


class TestFine(Law):
    caught_by = ""


class TestForgetsTheTime(Law):
    """The law is not told the step in time."""

    caught_by = "test_internal_variables_follow_those_of_a_point"

    class solver(Altered):
        def law(self, law):
            return Timeless(law)


class TestProfilesWithoutInternalVariables(Law):
    caught_by = "test_internal_variables_follow_those_of_a_point"
    slow = True

    class solver(Altered):
        def solution(self, solution):
            return replace(solution, profiles=tuple(replace(each, internal={}) for each in solution.profiles))


class TestInternalVariablesOneStepLate(Law):
    """Those of a profile are those of the state before."""

    caught_by = "test_internal_variables_follow_those_of_a_point"
    slow = True

    class solver(Altered):
        def solution(self, solution):
            first, *others = solution.profiles
            pairs = zip(others, solution.profiles, strict=False)
            late = (replace(each, internal=before.internal) for each, before in pairs)
            return replace(solution, profiles=(first, *late))


class TestFailedStepsLeaveTheirMemory(Law):
    """A step that fails leaves a hundredth of the internal variables less."""

    caught_by = "test_rejected_steps_leave_no_trace"
    slow = True

    class solver(Altered):
        def solve(self, prepared, law, **how):
            step = solver.newton_step

            def leaving(d, law, memory, *given, **named):
                try:
                    return step(d, law, memory, *given, **named)
                except StepFailed:
                    memory.internal[:] *= 0.99
                    raise

            with patch.object(solver, "newton_step", leaving):
                return super().solve(prepared, law, **how)


class TestStepsInErrorLeaveTheirMemory(Law):
    """A step that is rejected for its error leaves the internal variables that it reached."""

    caught_by = "test_rejected_steps_leave_no_trace"
    slow = True

    class solver(Altered):
        def solve(self, prepared, law, **how):
            error, tolerates = solver.ErrorControl.error, solver.Stepper.tolerates
            states = []

            def kept(control, old, new, *given):
                states[:] = [old.internal, new.internal]
                return error(control, old, new, *given)

            def leaving(stepper, found):
                if not (accepted := tolerates(stepper, found)):
                    states[0][:] = states[1]
                return accepted

            with (
                patch.object(solver.ErrorControl, "error", kept),
                patch.object(solver.Stepper, "tolerates", leaving),
            ):
                return super().solve(prepared, law, **how)


class TestCheckpointsWithoutInternalVariables(Law):
    """They are at rest where a run goes on."""

    caught_by = "test_a_killed_run_continues_with_its_internal_variables"
    slow = True

    class solver(Checkpoints):
        def load(self, read, file, stepper, control, predictor, law):
            if (found := read(file, stepper, control, predictor)) is None:
                return None
            x, memory, record = found
            return x, replace(memory, internal=law.initial(len(memory.internal)).internal), record


class TestCheckpointsWithoutTheirRates(Law):
    """The error of the first step is estimated as if internal variables had stood still before."""

    caught_by = "test_a_killed_run_continues_with_its_internal_variables"
    slow = True

    class solver(Checkpoints):
        def load(self, read, file, stepper, control, predictor, law):
            found = read(file, stepper, control, predictor)
            if control.rate is not None:
                control.rate = TimeState(control.rate.x, np.zeros_like(control.rate.internal))
            return found


class TestErrorOfTheUnknownsAlone(Law):
    """Steps grow while the body stands still, although its solid relaxes."""

    caught_by = "test_steps_follow_the_error_of_internal_variables"
    slow = True

    class solver(Altered):
        def solve(self, prepared, law, **how):
            with patch.object(stepping, "_columns_of_groups", lambda variables: []):
                return super().solve(prepared, law, **how)
