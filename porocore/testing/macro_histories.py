"""Histories: orders of convergence, laws against each other, balances."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from porocore.solution import MacroSolution
from porocore.terzaghi import Terzaghi
from porocore.testing.macro_solving import (
    COEFFICIENTS,
    HELD,
    LINEAR,
    NONLINEAR,
    PHI_S,
    SHORT,
    SIDES,
    Solving,
)
from porocore.testing.synthetic import AlteredLaw, confined_column


def discrete_terzaghi(layer: Terzaghi, depth: Any, steps: int, dT: float) -> Any:
    """Backward Euler in time, exact in space: each mode M decays by 1/(1 + M² ΔT) a step; depth from the top."""
    M = np.pi / 2 * (2 * np.arange(400) + 1)
    modes = 2 / M * np.sin(M * depth[:, None]) / (1 + M**2 * dT) ** steps
    return layer.initial_pressure * modes.sum(axis=1)


class Histories(Solving):
    """Part of :class:`porocore.testing.macro.MacroSolverSuite`."""

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
        assert len(solution.history.time) == steps + 1
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
            y, first = np.unique(np.rint(solution.points[:, 1] / 7.5 * 2 * elements), return_index=True)
            p = np.interp(1 - depth, y / (2 * elements), solution.profiles[-1].p[first])
            exact = discrete_terzaghi(layer, depth, steps, T / steps)
            errors.append(np.sqrt(np.mean((p - exact) ** 2)) / layer.initial_pressure)
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        np.testing.assert_allclose(orders, 2, atol=0.1)
        assert errors[-1] < 1e-4

    def test_time_steps_converge_with_order_one(self) -> None:
        """Backward Euler against the continuous series, on a mesh so fine that the error is that of time."""
        errors = []
        for steps in (10, 20, 40):
            layer, end, solution = self.linear_column(20, steps, 0.3)
            errors.append(
                abs(solution.history.pressure_max[-1] - layer.pressure(0.0, end)) / layer.initial_pressure
            )
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        np.testing.assert_allclose(orders, 1, atol=0.1)

    # --- laws against each other, balances --------------------------------------------------------------

    @pytest.mark.parametrize("load", [-1e-4, -1e-6])
    def test_a_small_load_gives_linear_poroelasticity(self, load: Any) -> None:
        problem = confined_column(4, load=load, time=SHORT | {"end": 10.0})
        nonlinear, linear = self.solve(problem, NONLINEAR).history, self.solve(problem, LINEAR).history
        np.testing.assert_allclose(nonlinear.settlement[1:], linear.settlement[1:], rtol=1e-3)
        np.testing.assert_allclose(nonlinear.pressure_max[1:], linear.pressure_max[1:], rtol=1e-3)
        np.testing.assert_allclose(nonlinear.drained[1:], linear.drained[1:], rtol=2e-3)
        assert nonlinear.settlement[-1] != linear.settlement[-1]

    def test_axial_stress_is_uniform(self, large: Any) -> None:
        assert large.history.stress_spread.max() < 1e-6 * 0.2
        np.testing.assert_allclose(large.profiles[0].stress[:, 1, 1], -0.2, rtol=1e-6)

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
        assert large.history.settlement[-1] == pytest.approx(-7.5 * low, rel=1e-6)
        assert abs(large.profiles[-1].p).max() < 1e-6

    def test_histories_are_what_they_say(self, large: Any) -> None:
        history, last = large.history, large.profiles[-1]
        assert [p.time for p in large.profiles] == [1.0, 10.0, 400.0]
        assert history.time[0] == 0
        assert history.settlement[0] == 0
        np.testing.assert_allclose(history.ramp, np.minimum(1, history.time / 0.5), rtol=1e-12)
        assert history.settlement[-1] == -last.u[:, 1].min()
        assert (np.diff(history.settlement) > -1e-9).all()
        assert history.iterations[1:20].min() >= 1
        assert last.deformation.shape == (10, 3, 3)
        det = np.linalg.det(last.deformation)
        assert history.drained[-1] > history.drained_flux[-1] * 1.05 > 0  # 1/det F̄ > 1 weighs it up
        np.testing.assert_allclose(
            last.conductivity[:, 1, 1], 1.94 / last.deformation[:, 1, 1] ** 2, rtol=1e-6
        )
        assert (det < 1).all()

    @pytest.mark.parametrize("law", [LINEAR, NONLINEAR], ids=["linear", "nonlinear"])
    def test_fluid_is_conserved(self, law: Any) -> None:
        """What leaves through the boundary is what the body no longer stores."""
        undivided = AlteredLaw(law, lambda r, states, memory: replace(r, volume_ratio=np.ones(len(states))))
        boundary = {**SIDES, "y-": {**HELD, "flux": 0.05}, "y+": {"traction": (0, 1, 0), "pressure": 0}}
        problem = confined_column(8, load=-0.1, boundary=boundary, time=SHORT, newton={"tolerance": 1e-12})
        history = self.solve(problem, undivided).history
        assert abs(history.drained_flux).max() > 1e-5
        np.testing.assert_allclose(history.drained, history.drained_flux, rtol=1e-10, atol=1e-14)

    def test_share_outside_the_trained_range_is_a_volume(self) -> None:
        narrow = AlteredLaw(LINEAR, lambda r, states, memory: replace(r, outside=states.p > 5e-4))
        solution = self.solve(confined_column(40, load=-1e-3, time=SHORT), narrow)
        layer = Terzaghi.from_coefficients(COEFFICIENTS, 7.5, 1e-3)
        y = np.linspace(0, 7.5, 4001)
        share = (layer.pressure(y, 6.0 - 0.1) > 5e-4).mean()
        assert 0.2 < share < 0.9
        assert solution.history.outside[-1] == pytest.approx(share, abs=0.02)
        assert solution.history.outside[-1] == pytest.approx(solution.profiles[-1].outside.mean(), abs=1e-12)
        assert solution.history.outside[0] == 0
