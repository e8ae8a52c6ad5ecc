"""What every cell solver obeys where the pore wall touches itself, as tests that a plugin author subclasses.

.. code-block:: python

    class TestMyCellContact(CellContactSuite):
        kit_version = "2"

        @classmethod
        def make_solver(cls):
            return MyCellSolver()
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.contact import ContactSettings
from porocore.interfaces.cell import CellSolver
from porocore.states import MacroState, Status
from porocore.testing.cell_suite import CellSuite

#: In contact with the mirror planes and stable; all four loads that keep the planes mirrors differ.
TOUCHING = MacroState.single(np.diag([0.01, -0.26, -0.005]), 0.02)
#: Of differences; the contact's energy has jumps in its second derivatives, so that the step is small.
STEP = 3e-5
#: The loads that keep the planes mirrors: H_11, H_22, H_33 and p.
LOADS = {"H11": 0, "H22": 4, "H33": 8, "p": 9}


class CellContactSuite(CellSuite):
    """Subclass it, name the class ``Test…`` and give it ``make_solver``."""

    @pytest.fixture(scope="class")
    @classmethod
    def touching(cls, solver: CellSolver, prepared: Any) -> Any:
        """The solution at ``TOUCHING``, with its field."""
        return solver.solve(prepared, TOUCHING, fields=True)

    @pytest.fixture(scope="class")
    @classmethod
    def differences(cls, solver: CellSolver, prepared: Any, touching: Any) -> dict[str, Any]:
        """Central differences of the responses by each load."""
        found = {}
        for name, load in LOADS.items():
            theta = np.zeros((2, 10))
            theta[:, load] = STEP, -STEP
            states = MacroState(
                TOUCHING.grad_u + theta[:, :9].reshape(2, 3, 3),
                TOUCHING.p + theta[:, 9],
            )
            ends = solver.solve(prepared, states, start=2 * touching.fields, tangent=False).response
            assert (ends.status == Status.contact).all()
            responses = {field: getattr(ends, field) for field in ("potential", "stress", "fluid_volume")}
            found[name] = {field: (values[0] - values[1]) / (2 * STEP) for field, values in responses.items()}
        return found

    def test_says_so(self, touching: Any) -> None:
        """The status ``contact``, stable, with the share of the wall that touches."""
        response = touching.response
        assert Status(response.status[0]) is Status.contact
        assert response.valid[0]
        assert response.stable[0]
        assert 0 < response.peaks.contact_share[0] < 0.2
        # Relative to a distance that vanishes towards the planes, so no measure of how deep the penetration is.
        assert response.peaks.min_gap[0] < 0
        assert response.peaks.negative_pivots[0] <= 0

    def test_stress_and_fluid_volume_are_the_slopes_of_the_potential(
        self, touching: Any, differences: dict[str, Any]
    ) -> None:
        response = touching.response
        for name, load in LOADS.items():
            slope = response.stress[0].ravel()[load] if load < 9 else -response.fluid_volume[0]
            assert differences[name]["potential"] == pytest.approx(slope, rel=1e-5)

    def test_derivatives_are_the_slopes(self, touching: Any, differences: dict[str, Any]) -> None:
        tangent = touching.response.tangent
        by_H = tangent.stress_grad_u[0].reshape(3, 3, 9)
        for name, load in LOADS.items():
            stress = by_H[:, :, load] if load < 9 else tangent.stress_p[0]
            error = np.abs(differences[name]["stress"] - stress).max()
            assert error < 1e-5 * np.abs(stress).max(), name
            volume = tangent.fluid_volume_grad_u[0].ravel()[load] if load < 9 else tangent.fluid_volume_p[0]
            assert differences[name]["fluid_volume"] == pytest.approx(volume, rel=1e-5), name

    def test_reciprocity(self, touching: Any) -> None:
        """∂P_E/∂p = −∂φ/∂H, and ∂P_E/∂H has major symmetry."""
        tangent = touching.response.tangent
        A = tangent.stress_grad_u.reshape(9, 9)
        assert np.abs(A - A.T).max() < 1e-8 * np.abs(A).max()
        np.testing.assert_allclose(tangent.stress_p, -tangent.fluid_volume_grad_u, rtol=0, atol=1e-8)

    @pytest.mark.parametrize("factor", [0.5, 2.0])
    def test_the_stiffness_hardly_matters(self, solver: CellSolver, touching: Any, factor: float) -> None:
        """The stress with half and twice the contact's stiffness."""
        settings = ContactSettings(stiffness=factor * ContactSettings().stiffness)
        other = solver.solve(
            solver.prepare(Cell(mesh=self.mesh, contact=settings)), TOUCHING, tangent=False
        ).response
        assert other.status[0] == Status.contact
        assert other.stress is not None
        assert other.stress[0, 1, 1] == pytest.approx(touching.response.stress[0, 1, 1], rel=1e-2)

    @pytest.mark.parametrize("contact", [ContactSettings(kind="none"), ContactSettings(stiffness=1e-6)])
    def test_a_wall_that_gives_way_overlaps(self, solver: CellSolver, contact: ContactSettings) -> None:
        """Without contact as soon as the wall passes a plane, and with too soft a one when it has passed it far."""
        prepared = solver.prepare(Cell(mesh=self.mesh, contact=contact))
        deep = MacroState.single(np.diag([0.0, -0.36, 0.0]))
        response = solver.solve(prepared, deep, tangent=False).response
        assert response.status[0] == Status.overlap
        assert response.stress is not None
        assert np.isnan(response.stress).all()

    def test_a_start_in_contact_changes_the_way_and_not_the_answer(
        self, solver: CellSolver, prepared: Any, touching: Any
    ) -> None:
        """And what was solved in contact leaves nothing behind for the states after it."""
        light = MacroState.single(np.diag([0.0, -0.1, 0.0]), 0.02)
        cold: Any = solver.solve(prepared, light).response
        others: list[Any] = [
            solver.solve(prepared, light, start=touching.fields).response,
            solver.solve(solver.prepare(Cell(mesh=self.mesh)), light).response,
        ]
        for other in others:
            assert other.status[0] == Status.converged
            np.testing.assert_allclose(other.stress, cold.stress, atol=1e-9)
            np.testing.assert_allclose(other.tangent.stress_grad_u, cold.tangent.stress_grad_u, atol=1e-8)
