"""The laws that every cell solver obeys, as tests that a plugin author subclasses.

.. code-block:: python

    class TestMyCellSolver(CellSolverConformance):
        @classmethod
        def make_solver(cls):
            return MyCellSolver()
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import porocore.cell_identities as identities
from porocore.cell.cell import Cell
from porocore.cell.contact import ContactSettings
from porocore.cell.geometry import OrthogonalChannels
from porocore.interfaces.cell import CellSolver
from porocore.materials.neo_hookean import NeoHookean
from porocore.states import MacroState, Status
from porocore.testing.cell_suite import CellSuite

#: Three states away from zero: diagonal, diagonal under suction, and general with shear and pressure.
STATES = {
    "compressed": (np.diag([0.02, -0.08, 0.03]), 0.05),
    "stretched": (np.diag([0.10, -0.02, 0.05]), -0.04),
    "sheared": (np.array([[0.03, 0.08, -0.02], [0.01, -0.06, 0.04], [0.0, 0.05, 0.02]]), 0.08),
}
#: Of the differences that derivatives are held against.
STEP = 1e-3
RESPONSES = ("mean_grad", "potential", "stress", "fluid_volume")


class CellSolverConformance(CellSuite):
    """Subclass it, name the class ``Test…`` and give it ``make_solver``."""

    @pytest.fixture(scope="class")
    @classmethod
    def responses(cls, solver: CellSolver, prepared: Any) -> dict[str, Any]:
        return {name: solver.solve_one(prepared, *state) for name, state in STATES.items()}

    def test_rest(self, solver: CellSolver, prepared: Any) -> None:
        rest: Any = solver.solve_one(prepared, np.zeros((3, 3)))
        assert rest.status[0] == Status.converged
        for name in ("mean_grad", "potential", "stress"):
            assert np.abs(getattr(rest, name)).max() < 1e-13
        assert rest.fluid_volume[0] == pytest.approx(OrthogonalChannels().porosity, rel=5e-3)

    @pytest.mark.parametrize("name", STATES)
    def test_derivatives_are_the_slopes(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any], name: str
    ) -> None:
        H, p = STATES[name]
        rng = np.random.default_rng(1)
        dH, dp = rng.normal(size=(3, 3)), rng.normal()
        if name != "sheared":
            dH = np.diag(np.diag(dH))
        differences = self.differences(solver, prepared, H, p, dH, dp)
        for response, slope in identities.along(responses[name], dH, dp).items():
            assert identities.misfit(differences[response], slope) < 1e-6, response

    @staticmethod
    def differences(solver: CellSolver, prepared: Any, H: Any, p: float, dH: Any, dp: float) -> Any:
        """Slopes of the responses in a direction."""
        states = identities.steps_around(H, p, dH, dp, STEP)
        return identities.slopes([solver.solve(prepared, state).response for state in states], STEP)

    def test_shear_derivatives_of_a_diagonal_state(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any]
    ) -> None:
        H, p = STATES["compressed"]
        dH = np.zeros((3, 3))
        dH[0, 1], dH[2, 0] = 1.0, -0.5
        differences = self.differences(solver, prepared, H, p, dH, 0.0)
        slopes = identities.along(responses["compressed"], dH, 0.0)
        # Energy and fluid volume are even in shear, so their slopes vanish.
        for response in ("mean_grad", "stress"):
            assert identities.misfit(differences[response], slopes[response]) < 1e-6, response

    @pytest.mark.parametrize("name", STATES)
    def test_reciprocity(self, responses: dict[str, Any], name: str) -> None:
        tangent = responses[name].tangent
        assert identities.major_symmetry(tangent) < 1e-9
        assert identities.reciprocity(tangent) < 1e-9

    def test_uniform_pressure_identity(self, solver: CellSolver, prepared: Any) -> None:
        tangent: Any = solver.solve_one(prepared, np.zeros((3, 3))).tangent
        assert identities.uniform_pressure(tangent, NeoHookean().poisson_ratio) < 1e-6

    def test_cubic_symmetry(self, solver: CellSolver, prepared: Any) -> None:
        tangent: Any = solver.solve_one(prepared, np.zeros((3, 3))).tangent
        assert identities.cubic_symmetry(tangent.mean_grad_grad_u[0]) < 1e-8

    def test_objectivity(self, solver: CellSolver, prepared: Any, responses: dict[str, Any]) -> None:
        H, p = STATES["sheared"]
        R = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
        turned: Any = solver.solve_one(prepared, R @ (np.eye(3) + H) - np.eye(3), p)
        for name, misfit in identities.objectivity(responses["sheared"], turned, R).items():
            assert misfit < 1e-9, name

    @pytest.mark.parametrize("name", ["compressed", "stretched"])
    def test_eighth_and_whole_cell_agree(
        self, solver: CellSolver, responses: dict[str, Any], name: str
    ) -> None:
        whole = solver.solve_one(solver.prepare(Cell(mesh=self.mesh, symmetry="none")), *STATES[name])
        eighth = responses[name]
        for response in RESPONSES:
            np.testing.assert_allclose(getattr(whole, response), getattr(eighth, response), atol=1e-8)
        for name, value in vars(eighth.tangent).items():
            if value is not None:
                np.testing.assert_allclose(getattr(whole.tangent, name), value, atol=1e-8)

    def test_conductivity(self, solver: CellSolver, prepared: Any) -> None:
        K = solver.conductivity(prepared)
        np.testing.assert_allclose(K, K.T, atol=1e-8 * K.max())
        assert (np.linalg.eigvalsh(K) > 0).all()
        whole = solver.conductivity(solver.prepare(Cell(mesh=self.mesh, symmetry="none")))
        np.testing.assert_allclose(whole, K, atol=1e-8 * K.max())

    def test_conductivity_of_a_straight_channel(self, solver: CellSolver) -> None:
        r = 0.15
        cell = Cell(geometry=OrthogonalChannels(radius=r, axes="z"), mesh=self.mesh, viscosity=0.5)
        K = solver.conductivity(solver.prepare(cell))
        assert K[2, 2] == pytest.approx(np.pi * r**4 / 8 / 0.5, rel=1e-2)
        assert abs(K[0, 0]) < 1e-3 * K[2, 2]

    def test_a_failed_state_does_not_take_the_others_along(self, solver: CellSolver) -> None:
        prepared = solver.prepare(Cell(mesh=self.mesh, contact=ContactSettings(kind="none")))
        H = np.zeros((4, 3, 3))
        H[1, 1, 1], H[2, 1, 1], H[3, 1, 1] = -0.4, -1.2, -0.1
        batch = solver.solve(prepared, MacroState(H, np.zeros(4)), fields=True)
        assert [Status(s) for s in batch.response.status] == [
            Status.converged,
            Status.overlap,
            Status.inverted,
            Status.converged,
        ]
        for name in RESPONSES:
            values = getattr(batch.response, name)
            assert np.isnan(values[1:3]).all()
            assert np.isfinite(values[[0, 3]]).all()
        assert batch.fields is not None
        assert [field is None for field in batch.fields] == [False, True, True, False]

    def test_a_start_changes_the_way_and_not_the_answer(self, solver: CellSolver, prepared: Any) -> None:
        near = solver.solve(prepared, MacroState.single(np.diag([0, -0.12, 0]), 0.1), fields=True)
        assert near.fields is not None
        target = MacroState.single(np.diag([0, -0.14, 0]), 0.1)
        warm = solver.solve(prepared, target, start=near.fields).response
        cold = solver.solve(prepared, target).response
        for name in RESPONSES:
            np.testing.assert_allclose(getattr(warm, name), getattr(cold, name), atol=1e-9)
