"""Laws on the discrete equations and on states that are known exactly."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.interfaces.solution import History
from porocore.macro.laws import LinearCellLaw
from porocore.states import MacroState
from porocore.testing.expect import holds, near, same
from porocore.testing.macro_laws.solving import (
    ALPHA,
    C22,
    COEFFICIENTS,
    HELD,
    LINEAR,
    NONLINEAR,
    PHI_S,
    SHORT,
    SIDES,
    K,
    Solving,
)
from porocore.testing.synthetic.response import confined_column, cubic_reference


class KnownStates(Solving):
    """Part of :class:`porocore.testing.macro_laws.base.MacroSolverSuite`."""

    @pytest.mark.parametrize("elements", [(1, 2, 1), (2, 1, 2)])
    def test_tangent_is_the_derivative_of_the_residual(self, elements: Any) -> None:
        """All unknowns free to move, a nonlinear law, a state without any symmetry."""
        problem = confined_column(elements, size=(0.7, 1.1, 0.9))
        d = self.discretise(problem)
        system, slope, direction = self.tangent_and_slope(d, -0.2)
        # Solving with the slope gives the direction back, if the tangent is the slope.
        found = d.solve(system, slope, direction[d.prescribed])
        state = f"random unknowns of {elements} elements, along a random direction"
        near(
            "what the tangent makes of the slope", found, direction, state, within=1e-5 * abs(direction).max()
        )
        sizes = d.magnitudes(system, direction)[d.free]
        least = (sizes - abs(slope[d.free]) * (1 - 1e-6)).min()
        holds(least >= 0, state, "magnitudes that are no smaller than the sums of what they measure", least)

    def test_gradients_of_a_quadratic_displacement_and_a_linear_pressure_are_exact(self) -> None:
        d = self.discretise(confined_column((2, 3, 2), size=(1, 2, 3)))
        mesh = d.mesh
        rng = np.random.default_rng(2)
        A, B, g = rng.standard_normal((3, 3)), rng.standard_normal((3, 3, 3)), rng.standard_normal(3)
        u = mesh.points @ A.T + np.einsum("ijk,nj,nk->ni", B, mesh.points, mesh.points)
        p = 0.3 + mesh.points[mesh.p_nodes] @ g
        states, grad_p = d.states(d.from_mesh(np.concatenate([u.ravel(), p])))
        near("grad_p", grad_p, g, "a linear pressure", rel=1e-11)
        linear, _ = d.states(d.from_mesh(np.concatenate([(mesh.points @ A.T).ravel(), p])))
        near("H", linear.grad_u, A, "a linear displacement", within=1e-12, rel=1e-7)
        # A pressure that is a coordinate says where the quadrature points lie.
        at = np.stack([self._pressures(d, mesh.points[mesh.p_nodes, i]) for i in range(3)], axis=1)
        expected = A + np.einsum("ijk,nk->nij", B + B.transpose(0, 2, 1), at)
        near("H", states.grad_u, expected, "a quadratic displacement", within=1e-11, rel=1e-7)
        centre = d.weights @ at / d.weights.sum()
        near("the centre of the quadrature points", centre, [0.5, 1, 1.5], "a box of 1 × 2 × 3", rel=1e-11)
        near("the volume", d.weights.sum(), 6.0, "a box of 1 × 2 × 3", rel=1e-13)

    @staticmethod
    def _pressures(d: Any, p: Any) -> Any:
        """Return the pressures at the quadrature points from those at the nodes."""
        return d.states(d.from_mesh(np.concatenate([np.zeros(d.mesh.n_u), p])))[0].p

    def test_cells_are_triquadratic_hexahedra_in_vtk_order(self) -> None:
        self.needs_core_mesh()
        solution = self.solve(confined_column((1, 2, 1), size=(2, 4, 6), time=SHORT), LINEAR)
        nodes = solution.points[solution.cells]
        first = nodes[np.argmin(nodes[:, :, 1].mean(axis=1))] / np.array([1, 1, 3])
        corners = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
        edges = ["01", "12", "23", "30", "45", "56", "67", "74", "04", "15", "26", "37"]
        faces = ["0473", "1265", "0154", "3762", "0123", "4567"]  # x-, x+, y-, y+, z-, z+
        expected = np.array(
            corners + [np.mean([corners[int(c)] for c in e], axis=0) for e in edges + faces] + [(1, 1, 1)]
        )
        near("nodes of the first cell", first, expected, "a box of two elements", within=1e-12, rel=1e-7)

    # --- states that are known exactly ------------------------------------------------------------------

    def test_uniform_drained_strain_is_reproduced(self) -> None:
        """Two faces displaced, one free: H is uniform and P_E,33 = 0, whatever the mesh."""
        roller: list[list[float | None]] = [[None] * 3 for _ in range(3)]
        for i in range(3):
            roller[i][i] = 0
        dry: dict[str, Any] = {"pressure": 0}
        boundary: dict[str, Any] = {
            f"{axis}-": {"displacement": tuple(roller[i]), **dry} for i, axis in enumerate("xyz")
        }
        boundary |= {
            "x+": {"displacement": (0.1, None, None), **dry},
            "y+": {"displacement": (None, -0.3, None), **dry},
            "z+": dry,
        }
        problem = confined_column((2, 3, 2), load=1.0, size=(1, 2, 1.5), boundary=boundary, time=SHORT)
        profile = self.solve(problem, NONLINEAR).profiles[-1]
        H = profile.grad_u
        state, exact = "two faces displaced, drained", self.within(1e-10)
        near("H, the same everywhere,", H, H[0], state, within=exact)
        near("H11, H22", np.diag(H[0])[:2], [0.1, -0.15], state, within=self.within(1e-12))
        near("shear of H", H[0] - np.diag(np.diag(H[0])), 0.0, state, within=exact)
        near("p", profile.p, 0.0, state, within=1e-14)
        # The stress by the strain energy of the mean deformation, differentiated numerically.
        law = LinearCellLaw(cubic_reference())
        mean = law.predict(MacroState.single(H[0])).mean_grad[0]
        F, h = np.eye(3) + H[0] + mean / PHI_S, 1e-5
        energy = [NeoHookean().energy_density(F + s * h * np.diag(e)) for e in np.eye(3) for s in (1, -1)]
        stress = PHI_S * (np.array(energy[::2]) - np.array(energy[1::2])) / (2 * h)
        near("P_E,ii", np.diag(profile.stress[0]), stress, state, within=self.within(1e-9))
        near("P_E,33 of the free face", profile.stress[0, 2, 2], 0.0, state, within=self.within(1e-8))

    def test_undrained_column_keeps_its_fluid(self) -> None:
        """Displaced on top and sealed: p = −α ε M_B at once and everywhere, P_E,22 = (C + α² M_B) ε."""
        boundary = {**SIDES, "y-": HELD, "y+": {"displacement": (None, 1, None)}}
        solution = self.solve(confined_column(5, load=-0.03, boundary=boundary, time=SHORT), LINEAR)
        strain = -0.03 / 7.5
        p = -ALPHA * strain * COEFFICIENTS.biot_modulus
        last, history, state = solution.profiles[-1], solution.history, "a sealed column, displaced on top"
        near("p", last.p, p, state, rel=self.within(1e-10))
        near("P_E,22", last.stress[:, 1, 1], C22 * strain - ALPHA * p, state, rel=self.within(1e-10))
        near("drained", history.drained, 0.0, state, within=1e-16)
        ramp = np.minimum(1, history.time / 0.2)
        near("settlement", history.settlement, 0.03 * ramp, state, rel=1e-12)
        near("pressure_max", history.pressure_max, p * ramp, state, rel=self.within(1e-9))
        # The prescribed jump is part of the linear system.
        most = history.iterations.max()
        holds(most == 1, state, "one iteration a step", most)

    def test_prescribed_inflow_ends_in_a_linear_pressure(self) -> None:
        """Fluid pressed in at the base and let out on top: p = q̄ (h − y)/K, σ = 0, swelling α p/C."""
        flux, h = 0.02, 7.5
        boundary = {**SIDES, "y-": {**HELD, "flux": -flux}, "y+": {"pressure": 0}}
        plan = {"end": 4000, "step": 200, "ramp_increments": 2, "ramp_step": 10, "profiles": ()}
        solution = self.solve(confined_column(6, load=1.0, boundary=boundary, time=plan), LINEAR)
        profile, y = solution.profiles[-1], solution.points[:, 1]
        p = flux * (h - y) / K[1, 1]
        exact, state = self.within(1e-8), f"steady, an inflow of {flux} at the base"
        near("p", profile.p, p, state, within=exact * p.max(), rel=1e-7)
        near("flux", profile.flux, [0, flux, 0], state, within=exact * flux, rel=1e-7)
        swelling = ALPHA / C22 * flux * (h * y - y**2 / 2) / K[1, 1]
        near("u_2", profile.u[:, 1], swelling, state, within=self.within(1e-7) * swelling.max(), rel=1e-7)
        stored = (COEFFICIENTS.storage + ALPHA**2 / C22) * 0.01 * flux * h**2 / 2 / K[1, 1]
        near("drained", solution.history.drained[-1], -stored, state, rel=self.within(1e-7))
        heave, largest = solution.history.heave, swelling.max()
        near("heave", heave[-1], largest, state, within=self.within(1e-7) * largest, rel=1e-7)

    def test_prescribed_pressure_scales_with_the_load(self) -> None:
        boundary = {**SIDES, "y-": {**HELD, "pressure": 2}, "y+": {"pressure": -1}}
        plan = {"end": 4000, "step": 200, "ramp_increments": 2, "ramp_step": 10, "profiles": ()}
        solution = self.solve(confined_column(4, load=0.01, boundary=boundary, time=plan), LINEAR)
        expected = 0.02 - 0.03 * solution.points[:, 1] / 7.5
        state = "steady, p = 0.02 at the base and -0.01 on top"
        near("p", solution.profiles[-1].p, expected, state, within=1e-9, rel=self.within(1e-7))
        near("pressure_min", solution.history.pressure_min[-1], -0.01, state, rel=self.within(1e-7))

    def test_without_load_nothing_happens(self) -> None:
        history = self.solve(confined_column(3, load=0.0, time=SHORT), NONLINEAR).history
        for field in fields(History):
            if field.name not in ("time", "ramp"):
                same(field.name, getattr(history, field.name), 0.0, "no load")
