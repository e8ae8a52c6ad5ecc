"""Macro solvers that break one law of running a solve each."""

from __future__ import annotations

from dataclasses import replace
from unittest.mock import patch

import numpy as np
from scipy import sparse

from porocore.errors import DataError
from porocore.macro.integration import checkpoint, newton
from porocore.macro.integration.checkpoint import CheckpointFile
from porocore.macro.problem import NewtonSettings
from porocore.testing.synthetic.response import AlteredLaw
from tests.testing.wrong.skfem_macro import (
    Altered,
    Elements,
    Law,
    Loaded,
    TakesAnything,
    with_boundary,
    with_time,
)


class Checkpoints(Altered):
    """Writes or reads checkpoints of its own."""

    def save(self, write, file, stepper, control, predictor, x, memory, record):
        write(file, stepper, control, predictor, x, memory, record)

    def load(self, read, file, stepper, control, predictor, law):
        return read(file, stepper, control, predictor)

    def solve(self, prepared, law, **how):
        write, read = CheckpointFile.save_if_due, CheckpointFile.load
        with (
            patch.object(CheckpointFile, "save_if_due", lambda *words: self.save(write, *words)),
            patch.object(CheckpointFile, "load", lambda *words: self.load(read, *words, law)),
        ):
            return super().solve(prepared, law, **how)


class BeginsAnew(Altered):
    """Where a checkpoint is refused."""

    def solve(self, prepared, law, **how):
        try:
            return super().solve(prepared, law, **how)
        except DataError:
            how["checkpoint"].unlink()
            return super().solve(prepared, law, **how)


def one_system_a_step(solve, prepared, law, **how):
    """Solve; under a law that promises a constant tangent Newton's method ends after one system."""
    if not law.constant_tangent:
        return solve(prepared, law, **how)
    with patch.object(newton, "misfit_of", lambda *words, **how: 1e-20):
        return solve(prepared, law, **how)


class TestFine(Law):
    caught_by = ""


class TestWrongSign(Law):
    caught_by = "test_newtons_iteration_converges_quadratically"
    raises = "StepFailed"

    class elements(Elements):
        def system(self, tangent, dt, surface=None):
            return super().system(replace(tangent, storage_grad_u=-tangent.storage_grad_u), dt, surface)


class TestOldTangent(Law):
    """That of the first iteration for all."""

    caught_by = "test_newtons_iteration_converges_quadratically"
    raises = "StepFailed"

    class elements(Elements):
        first = None

        def system(self, tangent, dt, follower=None):
            self.first = super().system(tangent, dt, follower) if self.first is None else self.first
            return self.first


class TestDamped(Law):
    caught_by = "test_a_linear_law_needs_one_iteration"

    class elements(Elements):
        def solve(self, system, right, jump, **how):
            return 0.9 * super().solve(system, right, jump, **how)


class TestOneLengthForAll(Law):
    """The system of the first step serves steps of every length, and is trusted."""

    caught_by = "test_the_promise_of_a_constant_tangent_changes_no_answer"

    class elements(Elements):
        promised, first = False, None

        def system(self, tangent, dt, follower=None):
            self.first = self.first if self.promised and self.first else super().system(tangent, dt, follower)
            return self.first

    class solver(Altered):
        def solve(self, prepared, law, **how):
            prepared.promised = law.constant_tangent
            return one_system_a_step(super().solve, prepared, law, **how)


class TestTrustsThePromise(Law):
    """No look at what one system leaves of the residual."""

    caught_by = "test_the_promise_of_a_constant_tangent_changes_no_answer"

    class solver(Altered):
        def solve(self, prepared, law, **how):
            return one_system_a_step(super().solve, prepared, law, **how)


class TestNeverHalves(Law):
    caught_by = "test_failed_steps_are_halved_to_the_same_answer"
    slow = True
    raises = "SolveError"

    class solver(Altered):
        def problem(self, problem):
            return with_time(problem, smallest_step=problem.time.ramp_step)


class TestHidesMissingValues(Law):
    caught_by = "test_a_law_without_values_ends_in_an_error_that_says_so"
    slow = True

    class solver(Altered):
        def law(self, law):
            def alter(response, states, memory):
                return replace(response, stress=np.nan_to_num(response.stress))

            return AlteredLaw(law, alter)


class TestItsOwnIterations(Law):
    caught_by = "test_too_few_iterations_end_in_an_error_that_says_so"

    class solver(Altered):
        def problem(self, problem):
            return problem.model_copy(update={"newton": NewtonSettings()})


class TestHoldsEveryBody(Law):
    """By weak springs."""

    caught_by = "test_a_body_that_can_turn_is_an_error"

    class elements(Elements):
        stiffness = 1e-2

        def residual(self, response, dt, loads, x=None):
            found = super().residual(response, dt, loads, x)
            return replace(found, values=found.values + self.stiffness * np.where(self.is_force, x, 0.0))

        def equation_matrix(self, system):
            springs = sparse.diags(self.stiffness * self.is_force[self.free])
            return (super().equation_matrix(system) + springs).tocsr()


class TestTheLastFaceWins(Law):
    caught_by = "test_contradicting_faces_are_refused"

    class solver(TakesAnything):
        def without(self, problem):
            top = problem.boundary["y+"].model_copy(update={"displacement": (None, None, None)})
            return with_boundary(problem, **{"y+": top})


class TestHoldsWhatSlides(Law):
    caught_by = "test_a_body_that_can_slide_is_refused"

    class solver(TakesAnything):
        def without(self, problem):
            base = problem.boundary["y-"].model_copy(update={"displacement": (0, 0, 0)})
            return with_boundary(problem, **{"y-": base})


class TestForgetsTheMemoryOfTheLaw(Law):
    caught_by = "test_a_killed_run_continues_to_the_identical_solution"
    raises = "SolveError"
    slow = True

    class solver(Checkpoints):
        def load(self, read, file, stepper, control, predictor, law):
            if (found := read(file, stepper, control, predictor)) is None:
                return None
            x, memory, record = found
            return x, law.initial(len(memory.states)), record


class TestForgetsEarlierProfiles(Law):
    caught_by = "test_a_killed_run_continues_to_the_identical_solution"
    slow = True

    class solver(Checkpoints):
        def save(self, write, file, stepper, control, predictor, x, memory, record):
            kept, record.profiles = record.profiles, []
            write(file, stepper, control, predictor, x, memory, record)
            record.profiles = kept


class TestForgetsHalvings(Law):
    caught_by = "test_a_killed_run_continues_to_the_identical_solution"
    slow = True

    class solver(Checkpoints):
        def load(self, read, file, stepper, control, predictor, law):
            found = read(file, stepper, control, predictor)
            stepper.halvings = 0
            return found


class TestForgetsThePredictor(Law):
    """A checkpoint without earlier states: the next step begins elsewhere."""

    caught_by = "test_a_killed_run_continues_to_the_identical_solution"
    slow = True

    class solver(Checkpoints):
        def load(self, read, file, stepper, control, predictor, law):
            found = read(file, stepper, control, predictor)
            predictor.times, predictor.states = predictor.times[-1:], predictor.states[-1:]
            return found


class TestKeepsWhatItSolvedBefore(Law):
    caught_by = "test_what_is_prepared_serves_several_solves"

    class elements(Loaded):
        solves = 0

        def alter(self, loads):
            return replace(loads, external=(1 + 1e-3 * self.solves) * loads.external)

    class solver(Altered):
        def solve(self, prepared, law, **how):
            prepared.solves += 1
            return super().solve(prepared, law, **how)


class TestSwallowsOptions(Law):
    caught_by = "test_unknown_options_are_refused"

    class solver(Altered):
        def __init__(self, *, checkpoint_seconds=5.0, **ignored):
            super().__init__(checkpoint_seconds=checkpoint_seconds)


class TestRunsAgain(Law):
    caught_by = "test_a_finished_run_is_not_run_again"
    slow = True

    class solver(Altered):
        def solve(self, prepared, law, *, checkpoint=None, on_step=None):
            return super().solve(prepared, law, on_step=on_step)


class TestWritesTooOften(Law):
    caught_by = "test_checkpoints_wait_for_their_time"
    slow = True

    class solver(Altered):
        def __init__(self, **options):
            super().__init__(checkpoint_seconds=0.0)


class TestTakesOthersCheckpoints(Law):
    caught_by = "test_a_checkpoint_of_another_problem_or_law_is_refused"
    raises = "SolveError"
    slow = True

    class solver(Checkpoints):
        def solve(self, prepared, law, **how):
            with patch.object(checkpoint, "stable_hash", lambda *parts: "any"):
                return super().solve(prepared, law, **how)


class TestRemovesOthersCheckpoints(Law):
    caught_by = "test_a_checkpoint_of_another_problem_or_law_is_refused"
    slow = True

    class solver(BeginsAnew):
        pass


class TestDoesNotAskTheLawAgain(Law):
    caught_by = "test_a_law_that_answers_differently_under_the_same_name_is_refused"
    slow = True

    class solver(Altered):
        def solve(self, prepared, law, **how):
            with patch.object(checkpoint, "SAME_LAW", np.inf):
                return super().solve(prepared, law, **how)


class TestBeginsAnewWithoutAWord(Law):
    caught_by = "test_a_truncated_checkpoint_is_refused"
    slow = True

    class solver(BeginsAnew):
        pass


class TestTakesForeignFiles(Law):
    caught_by = "test_foreign_and_damaged_checkpoints_are_refused"
    slow = True

    class solver(BeginsAnew):
        pass


class TestNoise(Law):
    """Of 1e-9."""

    caught_by = "test_two_solves_give_the_same_to_the_last_bit"

    class solver(Altered):
        noise = np.random.default_rng(0)

        def problem(self, problem):
            return problem.model_copy(update={"load": (1 + 1e-9 * self.noise.normal()) * problem.load})


class TestPromisesCheckpoints(Law):
    """It declares checkpoints and writes none."""

    caught_by = "test_a_truncated_checkpoint_is_refused"

    class solver(Altered):
        def solve(self, prepared, law, *, checkpoint=None, **how):
            return super().solve(prepared, law, **how)
