"""Macro solvers that break one law of bodies of any shape each."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

from porocore.errors import ConfigurationError
from porocore.macro.integration.checkpoint import CheckpointFile
from porocore.macro.problem import InitialState
from tests.testing.wrong.skfem_macro import Altered, Elements, Law, TakesAnything, with_time


class TestFine(Law):
    caught_by = ""


class TestForgetsFollowers(Law):
    caught_by = "test_the_tangent_is_the_derivative_of_the_residual_on_any_body"

    class elements(Elements):
        def system(self, tangent, dt, surface=None):
            return super().system(tangent, dt)


class TestTransposedGradient(Law):
    caught_by = "test_fields_of_first_order_are_exact_on_any_body"

    class elements(Elements):
        def states_of(self, x):
            states, grad_p = super().states_of(x)
            return replace(states, grad_u=states.grad_u.swapaxes(1, 2)), grad_p


class TestFollowerDoesNotTurn(Law):
    """Nor does it grow with the surface: a dead load."""

    caught_by = "test_a_pressure_all_around_follows_the_surface"
    slow = True

    class elements(Elements):
        def surface_forces(self, x, loads, dt):
            return super().surface_forces(0 * x, loads, dt)

        def surface_tangent(self, x, loads, dt):
            return None


class TestReactionsOfTheBodyOnItsSupport(Law):
    caught_by = "test_reactions_balance_the_loads"

    class solver(Altered):
        def solution(self, solution):
            turned = {name: -force for name, force in solution.reactions.items()}
            return replace(solution, reactions=turned)


class TestLosesTheBodyForce(Law):
    caught_by = "test_reactions_balance_the_loads"
    slow = True

    class solver(Altered):
        def problem(self, problem):
            return problem.model_copy(update={"body_force": (0, 0, 0)})


class TestProbesInAnotherOrder(Law):
    caught_by = "test_probes_say_what_the_fields_say"

    class solver(Altered):
        def solution(self, solution):
            swapped = {name: values[:, [1, 0, 2, 3]] for name, values in solution.probes.items()}
            return replace(solution, probes=swapped)


class TestForgetsFarProbes(Law):
    caught_by = "test_a_probe_outside_is_refused"

    class solver(Altered):
        def solve(self, prepared, law, **how):
            try:
                return super().solve(prepared, law, **how)
            except ConfigurationError:
                bare = prepared.problem.model_copy(update={"probes": {}})
                return super().solve(self.prepare(bare), law, **how)


class TestForgetsTheInitialState(Law):
    caught_by = "test_an_initial_state_is_where_it_begins"

    class solver(Altered):
        def problem(self, problem):
            return problem.model_copy(update={"initial": InitialState()})


class TestCountsStorageFromNoStrain(Law):
    caught_by = "test_an_initial_strain_presses_no_fluid_out"

    class solver(Altered):
        def problem(self, problem):
            return problem.model_copy(update={"initial": InitialState(pressure=problem.initial.pressure)})


class TestStepsOfAnySize(Law):
    caught_by = "test_steps_by_error_meet_the_tolerance"
    slow = True

    class solver(Altered):
        def problem(self, problem):
            return with_time(problem, tolerance=None)


class TestStepsByHundredTimesTheError(Law):
    caught_by = "test_steps_by_error_meet_the_tolerance"
    slow = True

    class solver(Altered):
        def problem(self, problem):
            allowed = problem.time.tolerance
            return with_time(problem, tolerance=allowed and 100 * allowed)


class TestForgetsTheRateOfChange(Law):
    """A checkpoint without it: the error of the first step after it is not known."""

    caught_by = "test_a_killed_run_continues_to_the_identical_history_on_any_body"
    slow = True

    class solver(Altered):
        def solve(self, prepared, law, **how):
            def save(file, stepper, control, *rest):
                write(file, stepper, replace(control, rate=None), *rest)

            write = CheckpointFile.save_if_due
            with patch.object(CheckpointFile, "save_if_due", save):
                return super().solve(prepared, law, **how)


class TestTakesAnySurface(Law):
    caught_by = "test_an_unknown_surface_is_refused"

    class solver(TakesAnything):
        def without(self, problem):
            known = {name: face for name, face in problem.boundary.items() if name != "lid"}
            return problem.model_copy(update={"boundary": known})


class TestTakesEmptyPatches(Law):
    caught_by = "test_an_empty_patch_is_refused"

    class solver(TakesAnything):
        def without(self, problem):
            return problem.model_copy(update={"surfaces": {}})


class TestPromisesEveryBody(Law):
    """It refuses a wedge that it declares to solve."""

    caught_by = "test_probes_say_what_the_fields_say"
    raises = "ConfigurationError"

    class solver(Altered):
        def prepare(self, problem):
            if problem.body.kind == "wedge":
                raise ConfigurationError("macro.body: a wedge cannot be solved")
            return super().prepare(problem)


class TestPromisesProbes(Law):
    """It declares probes and records none."""

    caught_by = "test_probes_say_what_the_fields_say"
    raises = "KeyError"

    class solver(Altered):
        def solution(self, solution):
            return replace(solution, probes={})
