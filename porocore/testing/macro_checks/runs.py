"""Checks of a macro run: Newton's convergence, histories, orders, checkpoints, refused files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from porocore.errors import ConfigurationError, DataError, SolveError
from porocore.interfaces.law import Interval, LawMemory, MacroLaw, MacroResponse
from porocore.interfaces.macro import MacroSolver
from porocore.interfaces.solution import History, MacroSolution, StepReport
from porocore.macro.analytic import Terzaghi
from porocore.macro.integration.newton import newton_step
from porocore.macro.problem import MacroProblem, NewtonSettings
from porocore.states import MacroState
from porocore.study.notes.abilities import lacking
from porocore.testing.expect import Violation, holds, near, options, refused, same
from porocore.testing.suite import Suite
from porocore.testing.synthetic.response import (
    CONDUCTIVITY,
    SOLID_FRACTION,
    AlteredLaw,
    confined_column,
    cubic_reference,
    linear_law,
    mean_gradient_law,
    without_large_steps,
)

LINEAR, NONLINEAR = linear_law(), mean_gradient_law()
COEFFICIENTS, PHI_S, K = LINEAR.coefficients, SOLID_FRACTION, CONDUCTIVITY
C22, ALPHA = COEFFICIENTS.stiffness[1, 1, 1, 1], COEFFICIENTS.biot[1, 1]
SHORT: dict[str, Any] = {"end": 6.0, "step": 0.5, "ramp_increments": 4, "ramp_step": 0.05, "profiles": (1.0,)}
SIDES: dict[str, Any] = {face: {"displacement": (0, None, 0)} for face in ("x-", "x+", "z-", "z+")}
HELD: dict[str, Any] = {"displacement": (0, 0, 0)}


class Killed(Exception):
    """A run that ends without warning."""


class Solving(Suite):
    """A suite that solves macro problems with the solver under test."""

    @classmethod
    def make_solver(cls, **options: Any) -> MacroSolver:
        """The solver under test with the options: ``checkpoint_seconds``, and one that it has to refuse."""
        raise cls.undefined(
            "make_solver(cls, **options)", "MyMacroSolver(**options)", "a new porocore.MacroSolver"
        )

    @classmethod
    def offered(cls, problem: MacroProblem) -> MacroSolver:
        """A new solver; the check is skipped where it does not declare what the problem needs."""
        solver = cls.make_solver()
        missing = lacking(type(solver), problem)
        cls.needs(not missing, f"the solver does not offer {missing}")
        return solver

    @classmethod
    def prepare(cls, problem: MacroProblem) -> Any:
        """Prepare a problem with a new solver."""
        return cls.offered(problem).prepare(problem)

    @classmethod
    def solve(cls, problem: MacroProblem, law: Any, **how: Any) -> MacroSolution:
        """Solve a problem with a new solver."""
        solver = cls.offered(problem)
        return solver.solve(solver.prepare(problem), law, **how)

    @classmethod
    def stopped(
        cls,
        problem: MacroProblem,
        law: MacroLaw,
        seconds: float,
        path: Path,
        stop: Callable[[StepReport], None],
    ) -> None:
        """Run with a checkpoint every so many seconds until ``stop`` raises :class:`Killed`."""
        cls.needs_checkpoints()
        cls.offered(problem)
        solver = cls.make_solver(checkpoint_seconds=seconds)
        try:
            solver.solve(solver.prepare(problem), law, checkpoint=path, on_step=stop)
        except Killed:
            return
        raise Violation("on_step raises an error", "that the run ends with it", "a run to its end")

    @classmethod
    def discretise(cls, problem: MacroProblem) -> Any:
        """Return the ``porocore.macro`` discretisation of a new solver; skip the check where it has none."""
        cls.needs_core_mesh()
        return cls.prepare(problem)

    @staticmethod
    def tangent_and_slope(d: Any, load: float, law: MacroLaw = NONLINEAR) -> tuple[Any, Any, Any]:
        """Return the system of the tangent, the slope of the residual along a random direction, and the direction.

        All unknowns are free to move, the ``law`` is nonlinear, and the state has no symmetry.
        """
        rng = np.random.default_rng(0)
        x, old = 0.02 * rng.standard_normal((2, d.mesh.size))
        states, _ = d.states(old)
        memory = law.respond(states, np.zeros((len(states), 3)), law.initial(len(states))).memory
        loads = d.loads(load)

        def residual(x: Any) -> Any:
            states, grad_p = d.states(x)
            response = law.respond(states, grad_p, memory)
            return d.residual(response, 0.3, loads, x).values, response

        tangent = residual(x)[1].tangent
        direction, h = rng.standard_normal(d.mesh.size), 1e-5
        slope = (residual(x + h * direction)[0] - residual(x - h * direction)[0]) / (2 * h)
        return d.coupled(tangent, 0.3, x, loads).system, slope, direction

    @classmethod
    def needs_core_mesh(cls) -> None:
        """Skip where the solver has a mesh of its own."""
        cls.needs(
            type(cls.make_solver()).meshes == "core",
            "meshes = 'own': it prepares no discretisation of porocore.macro",
        )

    @classmethod
    def needs_checkpoints(cls) -> None:
        """Skip where the solver writes no checkpoints."""
        cls.needs(type(cls.make_solver()).checkpoints, "checkpoints = False: it writes none")

    @classmethod
    def within(cls, exact: float) -> float:
        """``exact`` on the core's mesh, whose elements reproduce the solution; on another the declared accuracy."""
        solver = type(cls.make_solver())
        return exact if solver.meshes == "core" else max(exact, solver.accuracy)


def _unaltered(response: MacroResponse, states: MacroState, memory: LawMemory) -> MacroResponse:
    return response


TIMID = without_large_steps(NONLINEAR, 0.02)
STORM = confined_column(4, load=-0.1, time=SHORT | {"profiles": (0.3, 1.0, 4.0)})


class Runs(Solving):
    """Part of :class:`porocore.testing.macro_checks.states.MacroSolverSuite`."""

    @classmethod
    def interrupted(cls, path: Path, after: float) -> None:
        """Run until ``after``, with a checkpoint after every step."""

        def stop(report: StepReport) -> None:
            if report.time >= after:
                raise Killed

        cls.stopped(STORM, TIMID, 0, path, stop)
        holds(path.exists(), "checkpoint_seconds=0, killed after a step", "a checkpoint", "none")

    @pytest.fixture(scope="class")
    @classmethod
    def whole(cls) -> MacroSolution:
        return cls.solve(STORM, TIMID)

    def test_newtons_iteration_converges_quadratically(self) -> None:
        d = self.discretise(confined_column(6, load=-0.1))
        settings = NewtonSettings(tolerance=1e-13, iterations=12)
        rest = NONLINEAR.initial(d.n_points)
        step = newton_step(
            d, NONLINEAR, rest, np.zeros(d.mesh.size), Interval(0.0, 20.0), d.loads(-0.1), settings
        )
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
            there = f"{state} and resumed, the profile at t = {profile.time:g}"
            same("the internal variables", len(one.internal), len(profile.internal), there)
            theirs = profile.arrays()
            for name, mine in one.arrays().items():
                same(name, mine, theirs[name], there)

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
        self.stopped(STORM, TIMID, 3600, path, stop)
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


def discrete_terzaghi(layer: Terzaghi, depth: Any, steps: int, dT: float) -> Any:
    """Backward Euler in time, exact in space: each mode M decays by 1/(1 + M² ΔT) a step; depth from the top."""
    M = np.pi / 2 * (2 * np.arange(400) + 1)
    modes = 2 / M * np.sin(M * depth[:, None]) / (1 + M**2 * dT) ** steps
    return layer.initial_pressure * modes.sum(axis=1)


class Histories(Solving):
    """Part of :class:`porocore.testing.macro_checks.states.MacroSolverSuite`."""

    def linear_column(self, elements: int, steps: int, T: float) -> tuple[Terzaghi, float, MacroSolution]:
        """A linear column in ``steps`` equal steps up to T = c_v t/h²; its closed form, its solution."""
        layer = Terzaghi.from_coefficients(COEFFICIENTS, 7.5, 1e-3)
        end = T * layer.height**2 / layer.consolidation_coefficient
        plan = {
            "end": end,
            "step": end / steps,
            "ramp_increments": 1,
            "ramp_step": end / steps,
            "profiles": (),
        }
        solution = self.solve(confined_column(elements, load=-1e-3, time=plan), LINEAR)
        found = len(solution.history.time) - 1
        holds(found == steps, f"a linear column in {steps} equal steps", f"{steps} steps", found)
        return layer, end, solution

    @pytest.fixture(scope="class")
    @classmethod
    def large(cls) -> MacroSolution:
        """Strong compression of a column of ten elements up to its steady state."""
        plan = {"end": 400.0, "step": 8.0, "ramp_increments": 10, "ramp_step": 0.05, "profiles": (1.0, 10.0)}
        return cls.solve(confined_column(10, load=-0.2, time=plan), NONLINEAR)

    def test_pressure_converges_with_the_square_of_the_element_size(self) -> None:
        """Linear pressure: order 2 in the L2 norm, against the modes of the equations discrete in time only."""
        depth, steps, T = np.linspace(0, 1, 2001), 10, 0.2
        errors = []
        for elements in (4, 8, 16, 32):
            layer, _, solution = self.linear_column(elements, steps, T)
            y, first = np.unique(np.round(solution.points[:, 1] / 7.5, 9), return_index=True)
            p = np.interp(1 - depth, y, solution.profiles[-1].p[first])
            exact = discrete_terzaghi(layer, depth, steps, T / steps)
            errors.append(np.sqrt(np.mean((p - exact) ** 2)) / layer.initial_pressure)
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        state = "a linear column of 4, 8, 16 and 32 elements"
        near("the order of convergence", orders, 2.0, state, within=self.within(0.1))
        least = self.within(1e-4)
        holds(errors[-1] < least, state, f"an error of the pressure below {least:g} at 32", errors[-1])

    def test_time_steps_converge_with_order_one(self) -> None:
        """Backward Euler against the continuous series, on a mesh so fine that the error is that of time.

        On a mesh of the solver's own by the differences of its answers, from which the error of the mesh cancels.
        """
        exact = type(self.make_solver()).meshes == "core"
        errors = []
        for steps in (10, 20, 40) if exact else (20, 40, 80):
            layer, end, solution = self.linear_column(20, steps, 0.3)
            errors.append(
                (solution.history.pressure_max[-1] - layer.pressure(0.0, end)) / layer.initial_pressure
            )
        sizes = np.abs(errors[:-1]) if exact else np.abs(np.diff(errors))
        orders = np.log2(sizes[:-1] / sizes[1:])
        near("the order of convergence", orders, 1.0, "time steps twice as many each time", within=0.1)

    # --- laws against each other, balances --------------------------------------------------------------

    @pytest.mark.parametrize("load", [-1e-4, -1e-6])
    def test_a_small_load_gives_linear_poroelasticity(self, load: Any) -> None:
        problem = confined_column(4, load=load, time=SHORT | {"end": 10.0})
        nonlinear, linear = self.solve(problem, NONLINEAR).history, self.solve(problem, LINEAR).history
        state = f"a nonlinear law under the load {load:g}, against linear poroelasticity"
        for name, rel in (
            ("settlement", 1e-3),
            ("pressure_max", 1e-3),
            ("drained", 2e-3),
            ("drained_paper", 2e-3),
        ):
            near(name, getattr(nonlinear, name)[1:], getattr(linear, name)[1:], state, rel=rel)
        end = nonlinear.settlement[-1]
        holds(end != linear.settlement[-1], state, "another settlement, if only by a little", end)

    def test_axial_stress_is_uniform(self, large: Any) -> None:
        state = "a column under the load 0.2"
        near("stress_spread", large.history.stress_spread, 0.0, state, within=self.within(1e-6) * 0.2)
        near("P_E,22", large.after_rest[0].stress[:, 1, 1], -0.2, state, rel=self.within(1e-6))

    def test_steady_state_is_the_drained_uniaxial_one(self, large: Any) -> None:
        """P_E,22(H_22) = −0.2 at p = 0, by bisection of the scalar formula."""

        def stress(H22: float) -> Any:
            a, b = 1 - 0.0754 * H22 / PHI_S, 1 + H22 - 0.2297 * H22 / PHI_S
            mu, lam = 1 / 2.7, 0.35 / (1.35 * 0.3)
            return PHI_S * (mu * (b - 1 / b) + lam * np.log(a * a * b) / b)

        low, high = -0.6, 0.0
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if stress(middle) < -0.2 else (low, middle)
        state = "the steady state under the load 0.2"
        near("settlement", large.history.settlement[-1], -7.5 * low, state, rel=self.within(1e-6))
        near("p", large.profiles[-1].p, 0.0, state, within=1e-6)

    def test_histories_are_what_they_say(self, large: Any) -> None:
        history, last, state = large.history, large.profiles[-1], "a column under the load 0.2"
        same("the times of the profiles", [p.time for p in large.profiles], [0.0, 1.0, 10.0, 400.0], state)
        same("the first time", history.time[0], 0.0, state)
        same("the first settlement", history.settlement[0], 0.0, state)
        near("ramp", history.ramp, np.minimum(1, history.time / 0.5), state, rel=1e-12)
        near("settlement, the largest −u_2,", history.settlement[-1], -last.u[:, 1].min(), state)
        back = np.diff(history.settlement).min()
        holds(back > -1e-9, state, "a settlement that grows", f"a step of {back:.3g}")
        fewest = history.iterations[1:20].min()
        holds(fewest >= 1, state, "at least one iteration a step", fewest)
        shape, wanted = last.deformation.shape, (len(large.cells), 3, 3)
        holds(shape == wanted, state, f"F̄ of shape {wanted}, one an element", f"shape {shape}")
        # 1/det F̄ > 1 weighs it up.
        drained, paper = history.drained[-1], history.drained_paper[-1]
        holds(paper > drained * 1.05 > 0, state, "drained_paper to exceed a positive drained by 5 %", paper)
        expected = 1.94 / last.deformation[:, 1, 1] ** 2
        near("K_t,22 = K/F̄₂₂²", last.conductivity[:, 1, 1], expected, state, rel=self.within(1e-6))
        largest = np.linalg.det(last.deformation).max()
        holds(largest < 1, state, "det F̄ below 1", largest)

    @pytest.mark.parametrize("law", [LINEAR, NONLINEAR], ids=["linear", "nonlinear"])
    def test_fluid_is_conserved(self, law: Any) -> None:
        """The outflow through the boundary is the loss of stored fluid."""
        undivided = AlteredLaw(law, lambda r, states, memory: replace(r, volume_ratio=np.ones(len(states))))
        boundary = {**SIDES, "y-": {**HELD, "flux": 0.05}, "y+": {"traction": (0, 1, 0), "pressure": 0}}
        problem = confined_column(8, load=-0.1, boundary=boundary, time=SHORT, newton={"tolerance": 1e-12})
        history = self.solve(problem, undivided).history
        state, most = "a column with an inflow at its base", abs(history.drained).max()
        holds(most > 1e-5, state, "a drained volume beyond 1e-5", most)
        near("drained_paper", history.drained_paper, history.drained, state, rel=1e-10, within=1e-14)

    def test_share_outside_the_trained_range_is_a_volume(self) -> None:
        narrow = AlteredLaw(
            LINEAR, lambda r, states, memory: replace(r, doubt=(states.p > 5e-4).astype(np.int64))
        )
        solution = self.solve(confined_column(40, load=-1e-3, time=SHORT), narrow)
        layer = Terzaghi.from_coefficients(COEFFICIENTS, 7.5, 1e-3)
        y = np.linspace(0, 7.5, 4001)
        share = (layer.pressure(y, 6.0 - 0.1) > 5e-4).mean()
        state, found = "a law that flags p > 5e-4", solution.history.flagged
        near("flagged", found[-1], share, state, within=0.02)
        near(
            "outside, the mean of the profile,",
            found[-1],
            solution.profiles[-1].flagged.mean(),
            state,
            within=1e-12,
        )
        same("outside at rest", found[0], 0.0, state)
