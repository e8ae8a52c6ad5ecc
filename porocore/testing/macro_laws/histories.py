"""Laws of histories: orders of convergence, balance of fluid, linear limit; a discrete Terzaghi."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from porocore.interfaces.solution import MacroSolution
from porocore.macro.analytic.terzaghi import Terzaghi
from porocore.testing.expect import holds, near, same
from porocore.testing.macro_laws.solving import (
    COEFFICIENTS,
    HELD,
    LINEAR,
    NONLINEAR,
    PHI_S,
    SHORT,
    SIDES,
    Solving,
)
from porocore.testing.synthetic.response import AlteredLaw, confined_column


def discrete_terzaghi(layer: Terzaghi, depth: Any, steps: int, dT: float) -> Any:
    """Backward Euler in time, exact in space: each mode M decays by 1/(1 + M² ΔT) a step; depth from the top."""
    M = np.pi / 2 * (2 * np.arange(400) + 1)
    modes = 2 / M * np.sin(M * depth[:, None]) / (1 + M**2 * dT) ** steps
    return layer.initial_pressure * modes.sum(axis=1)


class Histories(Solving):
    """Part of :class:`porocore.testing.macro_laws.base.MacroSolverSuite`."""

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
            LINEAR, lambda r, states, memory: replace(r, outside_training_range=states.p > 5e-4)
        )
        solution = self.solve(confined_column(40, load=-1e-3, time=SHORT), narrow)
        layer = Terzaghi.from_coefficients(COEFFICIENTS, 7.5, 1e-3)
        y = np.linspace(0, 7.5, 4001)
        share = (layer.pressure(y, 6.0 - 0.1) > 5e-4).mean()
        state, found = "a law that flags p > 5e-4", solution.history.outside_training_range
        near("outside", found[-1], share, state, within=0.02)
        near(
            "outside, the mean of the profile,",
            found[-1],
            solution.profiles[-1].outside_training_range.mean(),
            state,
            within=1e-12,
        )
        same("outside at rest", found[0], 0.0, state)
