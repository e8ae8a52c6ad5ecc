"""Running a macro solve: Newton's iteration, failed steps, errors and checkpoints."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from porocore.errors import ConfigurationError, DataError, SolveError
from porocore.macro.newton import newton_step
from porocore.problem import NewtonSettings
from porocore.solution import History, MacroSolution, Profile, StepReport
from porocore.testing.macro_solving import LINEAR, NONLINEAR, SHORT, Solving
from porocore.testing.synthetic import (
    confined_column,
    cubic_reference,
    mean_gradient_law,
    without_large_steps,
)


class Killed(Exception):
    """A run that ends without warning."""


TIMID = without_large_steps(NONLINEAR, 0.02)
STORM = confined_column(4, load=-0.1, time=SHORT | {"profiles": (0.3, 1.0, 4.0)})


class Runs(Solving):
    """Part of :class:`porocore.testing.macro.MacroSolverSuite`."""

    @classmethod
    def interrupted(cls, path: Path, after: float) -> None:
        """Run until ``after``, with a checkpoint after every step."""

        def stop(report: StepReport) -> None:
            if report.time >= after:
                raise Killed

        solver = cls.make_solver(checkpoint_seconds=0)
        with pytest.raises(Killed):
            solver.solve(solver.prepare(STORM), TIMID, checkpoint=path, on_step=stop)

    @pytest.fixture(scope="class")
    @classmethod
    def whole(cls) -> MacroSolution:
        return cls.solve(STORM, TIMID)

    def test_newtons_iteration_converges_quadratically(self) -> None:
        d = self.prepare(confined_column(6, load=-0.1))
        settings = NewtonSettings(tolerance=1e-13, iterations=12)
        rest = NONLINEAR.initial(d.n_points)
        step = newton_step(d, NONLINEAR, rest, np.zeros(d.mesh.size), 20.0, d.loads(-0.1), settings)
        tail = np.array([m for m in step.misfits if 1e-13 < m < 0.1])
        assert len(tail) >= 3
        assert (np.log(tail[1:]) / np.log(tail[:-1]))[-2:].min() > 1.7
        assert step.iterations == len(step.misfits) - 1 <= 7

    def test_a_linear_law_needs_one_iteration(self) -> None:
        history = self.solve(confined_column(4, time=SHORT), LINEAR).history
        assert set(history.iterations[1:]) == {1.0}

    def test_failed_steps_are_halved_to_the_same_answer(self) -> None:
        problem = confined_column(6, load=-0.1, time=SHORT)
        free = self.solve(problem, NONLINEAR).history
        timid = self.solve(problem, without_large_steps(NONLINEAR, 0.01)).history
        assert len(timid.time) > 1.3 * len(free.time)
        assert np.diff(timid.time).min() < 0.5 * np.diff(free.time).min()
        assert timid.time[-1] == 6.0
        assert timid.settlement[-1] == pytest.approx(free.settlement[-1], rel=0.02)  # finer in time

    def test_a_law_without_values_ends_in_an_error_that_says_so(self) -> None:
        problem = confined_column(3, load=-0.1, time=SHORT | {"smallest_step": 1e-3})
        with pytest.raises(
            SolveError, match=r"from t = 0 failed .*no values at \d+ of 81 points .* lower the load"
        ):
            self.solve(problem, without_large_steps(NONLINEAR, 1e-12))

    def test_too_few_iterations_end_in_an_error_that_says_so(self) -> None:
        problem = confined_column(3, load=-0.1, time=SHORT, newton={"iterations": 1, "tolerance": 1e-12})
        with pytest.raises(SolveError, match=r"stood at .* after 1 iterations \(newton.tolerance = 1e-12\)"):
            self.solve(problem, NONLINEAR)

    def test_a_body_that_can_turn_is_an_error(self) -> None:
        boundary = {
            "y-": {"displacement": (0, None, None), "pressure": 0},
            "x-": {"displacement": (None, 0, None)},
            "z-": {"displacement": (None, None, 0)},
            "x+": {"traction": (0, 1, 0)},
        }
        problem = confined_column(2, load=1e-3, size=(1, 1, 1), boundary=boundary, time=SHORT)
        with pytest.raises(SolveError):
            self.solve(problem, NONLINEAR)

    def test_contradicting_faces_are_refused(self) -> None:
        boundary = {"x-": {"displacement": (0, 0, 0)}, "y+": {"displacement": (None, 1, None)}}
        with pytest.raises(
            ConfigurationError, match=r"boundary.y\+: u_2 = 1 contradicts u_2 = 0 .* where they meet"
        ):
            self.prepare(confined_column(2, boundary=boundary))

    def test_a_body_that_can_slide_is_refused(self) -> None:
        boundary = {"y-": {"displacement": (0, 0, None)}}
        with pytest.raises(ConfigurationError, match="nothing holds the body in direction 3; prescribe u_3"):
            self.prepare(confined_column(2, boundary=boundary))

    @pytest.mark.parametrize("after", [0.01, 0.5, 4.2])
    def test_a_killed_run_continues_to_the_identical_solution(
        self, tmp_path: Any, whole: Any, after: Any
    ) -> None:
        path = tmp_path / "macro.h5"
        reports: list[StepReport] = []
        self.interrupted(path, after)
        assert [p.name for p in tmp_path.iterdir()] == ["macro.h5"]
        resumed = self.solve(STORM, TIMID, checkpoint=path, on_step=reports.append)
        assert min(r.time for r in reports) > after
        for field in fields(History):
            assert np.array_equal(getattr(resumed.history, field.name), getattr(whole.history, field.name))
        assert len(resumed.profiles) == len(whole.profiles) == 4
        for mine, other in zip(resumed.profiles, whole.profiles, strict=True):
            for field in fields(Profile):
                assert np.array_equal(getattr(mine, field.name), getattr(other, field.name)), field.name

    def test_what_is_prepared_serves_several_solves(self) -> None:
        """Whatever was solved before, under this law or another one."""
        solver = self.make_solver()
        prepared = solver.prepare(confined_column(3, load=-0.1, time=SHORT | {"end": 1.0}))
        first, _, again = (solver.solve(prepared, law).history for law in (NONLINEAR, LINEAR, NONLINEAR))
        np.testing.assert_array_equal(again.time, first.time)
        np.testing.assert_allclose(again.settlement, first.settlement, rtol=1e-9)
        np.testing.assert_allclose(again.pressure_max, first.pressure_max, rtol=1e-9)

    def test_unknown_options_are_refused(self) -> None:
        with pytest.raises((ConfigurationError, TypeError), match="no_such_option"):
            self.make_solver(no_such_option=1)

    def test_a_finished_run_is_not_run_again(self, tmp_path: Any, whole: Any) -> None:
        path = tmp_path / "macro.h5"
        reports: list[StepReport] = []
        self.solve(STORM, TIMID, checkpoint=path)
        again = self.solve(STORM, TIMID, checkpoint=path, on_step=reports.append)
        assert reports == []
        assert np.array_equal(again.history.settlement, whole.history.settlement)

    def test_checkpoints_wait_for_their_time(self, tmp_path: Any) -> None:
        def stop(report: StepReport) -> None:
            if report.time > 1:
                raise Killed

        path = tmp_path / "macro.h5"
        solver = self.make_solver(checkpoint_seconds=3600)
        with pytest.raises(Killed):
            solver.solve(solver.prepare(STORM), TIMID, checkpoint=path, on_step=stop)
        assert not path.exists()

    def test_a_checkpoint_of_another_problem_or_law_is_refused(self, tmp_path: Any) -> None:
        path = tmp_path / "macro.h5"
        self.interrupted(path, 0.3)
        before = path.read_bytes()
        for problem, law in ((STORM.model_copy(update={"load": -0.05}), TIMID), (STORM, NONLINEAR)):
            with pytest.raises(DataError, match=r"macro\.h5: .*another macro problem or law; remove it"):
                self.solve(problem, law, checkpoint=path)
        assert path.read_bytes() == before

    def test_a_law_that_answers_differently_under_the_same_name_is_refused(self, tmp_path: Any) -> None:
        path = tmp_path / "macro.h5"
        self.interrupted(path, 0.3)
        other = mean_gradient_law(cubic_reference(normal=-0.2298))
        with pytest.raises(DataError, match="law 'altered' answers differently"):
            self.solve(STORM, without_large_steps(other, 0.02), checkpoint=path)

    @pytest.mark.parametrize("share", [0.0, 0.3, 0.95])
    def test_a_truncated_checkpoint_is_refused(self, tmp_path: Any, share: Any) -> None:
        path = tmp_path / "macro.h5"
        self.interrupted(path, 0.3)
        data = path.read_bytes()
        path.write_bytes(data[: int(share * len(data))])
        with pytest.raises(DataError, match=r"macro\.h5: not a complete macro checkpoint .* remove it"):
            self.solve(STORM, TIMID, checkpoint=path)

    def test_foreign_and_damaged_checkpoints_are_refused(self, tmp_path: Any) -> None:
        path = tmp_path / "macro.h5"
        with h5py.File(path, "w") as file:
            file["x"] = np.zeros(3)
        with pytest.raises(DataError, match="expected a macro checkpoint of version 2"):
            self.solve(STORM, TIMID, checkpoint=path)
        path.unlink()
        self.interrupted(path, 0.3)
        with h5py.File(path, "a") as file:
            del file["x"]
            file["x"] = np.zeros(3)
        with pytest.raises(DataError, match=r"not a complete macro checkpoint \('x' has shape \(3,\)\)"):
            self.solve(STORM, TIMID, checkpoint=path)
