"""Laws of a macro run: Newton's convergence, halved steps, errors, checkpoints, refused files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from porocore.errors import ConfigurationError, DataError, SolveError
from porocore.interfaces.law import LawMemory, MacroResponse
from porocore.interfaces.solution import History, MacroSolution, Profile, StepReport
from porocore.macro.integration.newton import newton_step
from porocore.macro.problem import NewtonSettings
from porocore.states import MacroState
from porocore.testing.expect import Violation, holds, near, options, refused, same
from porocore.testing.macro_laws.solving import LINEAR, NONLINEAR, SHORT, Solving
from porocore.testing.synthetic.response import (
    AlteredLaw,
    confined_column,
    cubic_reference,
    mean_gradient_law,
    without_large_steps,
)


class Killed(Exception):
    """A run that ends without warning."""


def _unaltered(response: MacroResponse, states: MacroState, memory: LawMemory) -> MacroResponse:
    return response


TIMID = without_large_steps(NONLINEAR, 0.02)
STORM = confined_column(4, load=-0.1, time=SHORT | {"profiles": (0.3, 1.0, 4.0)})


class Runs(Solving):
    """Part of :class:`porocore.testing.macro_laws.base.MacroSolverSuite`."""

    @classmethod
    def interrupted(cls, path: Path, after: float) -> None:
        """Run until ``after``, with a checkpoint after every step."""

        def stop(report: StepReport) -> None:
            if report.time >= after:
                raise Killed

        cls.stopped(0, path, stop)
        holds(path.exists(), "checkpoint_seconds=0, killed after a step", "a checkpoint", "none")

    @classmethod
    def stopped(cls, seconds: float, path: Path, stop: Callable[[StepReport], None]) -> None:
        """Run with a checkpoint every so many seconds until ``stop`` raises."""
        cls.needs_checkpoints()
        cls.offered(STORM)
        solver = cls.make_solver(checkpoint_seconds=seconds)
        try:
            solver.solve(solver.prepare(STORM), TIMID, checkpoint=path, on_step=stop)
        except Killed:
            return
        raise Violation("on_step raises an error", "that the run ends with it", "a run to its end")

    @pytest.fixture(scope="class")
    @classmethod
    def whole(cls) -> MacroSolution:
        return cls.solve(STORM, TIMID)

    def test_newtons_iteration_converges_quadratically(self) -> None:
        d = self.discretise(confined_column(6, load=-0.1))
        settings = NewtonSettings(tolerance=1e-13, iterations=12)
        rest = NONLINEAR.initial(d.n_points)
        step = newton_step(d, NONLINEAR, rest, np.zeros(d.mesh.size), 20.0, d.loads(-0.1), settings)
        tail = np.array([m for m in step.misfits if 1e-13 < m < 0.1])
        state = f"a step of a nonlinear column, misfits {', '.join(f'{m:.1e}' for m in step.misfits)}"
        holds(len(tail) >= 3, state, "at least three misfits between 0.1 and 1e-13", len(tail))
        order = (np.log(tail[1:]) / np.log(tail[:-1]))[-2:].min()
        holds(order > 1.7, state, "an order of convergence above 1.7", order)
        count = step.iterations
        holds(
            count == len(step.misfits) - 1 <= 7, state, "at most 7 iterations, one less than misfits", count
        )

    def test_a_linear_law_needs_one_iteration(self) -> None:
        history = self.solve(confined_column(4, time=SHORT), LINEAR).history
        same("iterations", history.iterations[1:], 1.0, "a linear law")

    @pytest.mark.parametrize("kept", [True, False])
    def test_the_promise_of_a_constant_tangent_changes_no_answer(self, kept: Any) -> None:
        """Steps of several lengths, under a law that keeps ``constant_tangent`` and under one that breaks it."""
        problem, law = confined_column(4, load=-0.1, time=SHORT), LINEAR if kept else NONLINEAR
        promised, plain = AlteredLaw(law, _unaltered), AlteredLaw(law, _unaltered)
        promised.constant_tangent = True
        found, wanted = (self.solve(problem, each).history for each in (promised, plain))
        state = f"constant_tangent = True of a {'linear' if kept else 'nonlinear'} law"
        for name in ("settlement", "pressure_max", "drained"):
            expected = getattr(wanted, name)
            within = self.within(1e-7) * float(np.abs(expected).max())
            near(name, getattr(found, name), expected, state, within=within)

    def test_failed_steps_are_halved_to_the_same_answer(self) -> None:
        problem = confined_column(6, load=-0.1, time=SHORT)
        free = self.solve(problem, NONLINEAR).history
        timid = self.solve(problem, without_large_steps(NONLINEAR, 0.01)).history
        state = "a law without values where H changes by more than 0.01 in a step"
        more = len(timid.time) / len(free.time)
        holds(more > 1.3, state, "more steps by 1.3 than without that", f"{more:.3g} times as many")
        share = np.diff(timid.time).min() / np.diff(free.time).min()
        holds(share < 0.5, state, "a smallest step of less than half", f"{share:.3g} of it")
        same("the end", timid.time[-1], 6.0, state)
        near("settlement, finer in time,", timid.settlement[-1], free.settlement[-1], state, rel=0.02)

    def test_a_law_without_values_ends_in_an_error_that_says_so(self) -> None:
        problem = confined_column(3, load=-0.1, time=SHORT | {"smallest_step": 1e-3})
        state = "a law without values at any deformation"
        with refused(SolveError, state=state, naming=("from t = 0 failed", "no values at", "lower the load")):
            self.solve(problem, without_large_steps(NONLINEAR, 1e-12))

    def test_too_few_iterations_end_in_an_error_that_says_so(self) -> None:
        problem = confined_column(3, load=-0.1, time=SHORT, newton={"iterations": 1, "tolerance": 1e-12})
        state, naming = (
            "newton.iterations = 1 with a tolerance of 1e-12",
            ("after 1 iterations", "newton.tolerance"),
        )
        with refused(SolveError, state=state, naming=naming):
            self.solve(problem, NONLINEAR)

    def test_a_body_that_can_turn_is_an_error(self) -> None:
        boundary = {
            "y-": {"displacement": (0, None, None), "pressure": 0},
            "x-": {"displacement": (None, 0, None)},
            "z-": {"displacement": (None, None, 0)},
            "x+": {"traction": (0, 1, 0)},
        }
        problem = confined_column(2, load=1e-3, size=(1, 1, 1), boundary=boundary, time=SHORT)
        with refused(SolveError, state="a body that can turn about an edge, under a force"):
            self.solve(problem, NONLINEAR)

    def test_contradicting_faces_are_refused(self) -> None:
        boundary = {"x-": {"displacement": (0, 0, 0)}, "y+": {"displacement": (None, 1, None)}}
        state = "u_2 = 0 on x- and u_2 = 1 on y+, which meet"
        with refused(ConfigurationError, state=state, naming=("boundary.y+", "u_2 = 1", "u_2 = 0")):
            self.prepare(confined_column(2, boundary=boundary))

    def test_a_body_that_can_slide_is_refused(self) -> None:
        boundary = {"y-": {"displacement": (0, 0, None)}}
        with refused(ConfigurationError, state="u_3 is free everywhere", naming=("prescribe u_3",)):
            self.prepare(confined_column(2, boundary=boundary))

    @pytest.mark.parametrize("after", [0.01, 0.5, 4.2])
    def test_a_killed_run_continues_to_the_identical_solution(
        self, tmp_path: Any, whole: Any, after: Any
    ) -> None:
        path = tmp_path / "macro.h5"
        reports: list[StepReport] = []
        self.interrupted(path, after)
        state, names = f"killed after t = {after:g}", [p.name for p in tmp_path.iterdir()]
        holds(names == ["macro.h5"], state, "one file, macro.h5", names)
        resumed = self.solve(STORM, TIMID, checkpoint=path, on_step=reports.append)
        first = min((r.time for r in reports), default=None)
        holds(first is not None and first > after, state, f"to go on after t = {after:g}", first)
        for field in fields(History):
            mine, other = getattr(resumed.history, field.name), getattr(whole.history, field.name)
            same(f"history.{field.name}", mine, other, f"{state} and resumed, against a whole run")
        same("the number of profiles", [len(resumed.profiles), len(whole.profiles)], 5, state)
        for one, profile in zip(resumed.profiles, whole.profiles, strict=True):
            for field in fields(Profile):
                mine, other = getattr(one, field.name), getattr(profile, field.name)
                same(field.name, mine, other, f"{state} and resumed, the profile at t = {profile.time:g}")

    def test_two_solves_give_the_same_to_the_last_bit(self, whole: Any) -> None:
        """Two new solvers agree."""
        again = self.solve(STORM, TIMID)
        for field in fields(History):
            mine, other = getattr(again.history, field.name), getattr(whole.history, field.name)
            same(f"history.{field.name}", mine, other, "solved twice")
        same("u at the end", again.profiles[-1].u, whole.profiles[-1].u, "solved twice")

    def test_what_is_prepared_serves_several_solves(self) -> None:
        """Whatever was solved before, under this law or another one."""
        problem = confined_column(3, load=-0.1, time=SHORT | {"end": 1.0})
        solver = self.offered(problem)
        prepared = solver.prepare(problem)
        first, _, again = (solver.solve(prepared, law).history for law in (NONLINEAR, LINEAR, NONLINEAR))
        state = "solved again after another law"
        same("time", again.time, first.time, state)
        for name in ("settlement", "pressure_max"):
            near(name, getattr(again, name), getattr(first, name), state, rel=1e-9)

    def test_unknown_options_are_refused(self) -> None:
        state, naming = options({"no_such_option": 1}), ("no_such_option",)
        with refused(ConfigurationError, TypeError, state=state, naming=naming):
            self.make_solver(no_such_option=1)

    def test_a_finished_run_is_not_run_again(self, tmp_path: Any, whole: Any) -> None:
        self.needs_checkpoints()
        path = tmp_path / "macro.h5"
        reports: list[StepReport] = []
        self.solve(STORM, TIMID, checkpoint=path)
        again = self.solve(STORM, TIMID, checkpoint=path, on_step=reports.append)
        state = "a checkpoint of a finished run"
        holds(not reports, state, "no further step", f"{len(reports)} steps")
        same("settlement", again.history.settlement, whole.history.settlement, state)

    def test_checkpoints_wait_for_their_time(self, tmp_path: Any) -> None:
        def stop(report: StepReport) -> None:
            if report.time > 1:
                raise Killed

        path = tmp_path / "macro.h5"
        self.stopped(3600, path, stop)
        holds(not path.exists(), "checkpoint_seconds=3600, killed after a step", "no checkpoint yet", "one")

    def test_a_checkpoint_of_another_problem_or_law_is_refused(self, tmp_path: Any) -> None:
        path = tmp_path / "macro.h5"
        self.interrupted(path, 0.3)
        before = path.read_bytes()
        for problem, law in ((STORM.model_copy(update={"load": -0.05}), TIMID), (STORM, NONLINEAR)):
            state = f"the checkpoint of another {'law' if problem is STORM else 'problem'}"
            with refused(DataError, state=state, naming=("macro.h5", "another", "move it")):
                self.solve(problem, law, checkpoint=path)
        after = path.read_bytes() if path.exists() else b""
        holds(after == before, "a refused checkpoint", "the file as it was", "another content")

    def test_a_law_that_answers_differently_under_the_same_name_is_refused(self, tmp_path: Any) -> None:
        path = tmp_path / "macro.h5"
        self.interrupted(path, 0.3)
        other = mean_gradient_law(cubic_reference(normal=-0.2298))
        state = "a law of the same identity with other answers"
        with refused(DataError, state=state, naming=("'altered'", "answers differently")):
            self.solve(STORM, without_large_steps(other, 0.02), checkpoint=path)

    @pytest.mark.parametrize("share", [0.0, 0.3, 0.95])
    def test_a_truncated_checkpoint_is_refused(self, tmp_path: Any, share: Any) -> None:
        path = tmp_path / "macro.h5"
        self.interrupted(path, 0.3)
        data = path.read_bytes()
        path.write_bytes(data[: int(share * len(data))])
        state = f"the first {100 * share:g} % of a checkpoint"
        with refused(DataError, state=state, naming=("macro.h5", "not a complete", "move it")):
            self.solve(STORM, TIMID, checkpoint=path)

    def test_foreign_and_damaged_checkpoints_are_refused(self, tmp_path: Any) -> None:
        self.needs_checkpoints()
        path = tmp_path / "macro.h5"
        with h5py.File(path, "w") as file:
            file["x"] = np.zeros(3)
        with refused(DataError, state="a foreign HDF5 file", naming=("expected a macro checkpoint",)):
            self.solve(STORM, TIMID, checkpoint=path)
        path.unlink()
        self.interrupted(path, 0.3)
        with h5py.File(path, "a") as file:
            del file["x"]
            file["x"] = np.zeros(3)
        state = "a checkpoint whose unknowns have another shape"
        with refused(DataError, state=state, naming=("macro.h5", "'x'")):
            self.solve(STORM, TIMID, checkpoint=path)
