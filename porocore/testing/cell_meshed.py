"""What a cell solver on the meshes of porocore obeys in addition: mirrors, statuses of the wall, a known channel.

.. code-block:: python

    class TestMyCellSolver(MeshedCellSuite):
        kit_version = "2"

        @classmethod
        def make_solver(cls):
            return MyCellSolver()
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import porocore.cell_identities as identities
from porocore.cell.contact import ContactSettings
from porocore.cell.geometry import OrthogonalChannels
from porocore.interfaces.cell import CellSolver
from porocore.states import MacroState, Status
from porocore.testing.cell import RESPONSES, STATES, CellSolverSuite


class MeshedCellSuite(CellSolverSuite):
    """Subclass it, name the class ``Test…`` and give it ``make_solver``."""

    def test_cubic_symmetry(self, solver: CellSolver, prepared: Any) -> None:
        """M of a cubic cell is a cubic tensor."""
        tangent: Any = solver.solve_one(prepared, np.zeros((3, 3))).tangent
        assert identities.cubic_symmetry(tangent.mean_grad_grad_u[0]) < 1e-8

    @pytest.mark.parametrize("name", ["compressed", "stretched"])
    def test_eighth_and_whole_cell_agree(
        self, solver: CellSolver, responses: dict[str, Any], name: str
    ) -> None:
        whole = solver.solve_one(solver.prepare(self.make_cell(symmetry="none")), *STATES[name])
        eighth = responses[name]
        for response in RESPONSES:
            np.testing.assert_allclose(getattr(whole, response), getattr(eighth, response), atol=1e-8)
        for name, value in vars(eighth.tangent).items():
            if value is not None:
                np.testing.assert_allclose(getattr(whole.tangent, name), value, atol=1e-8)

    def test_the_flow_percolates_along_every_axis(self, solver: CellSolver, prepared: Any) -> None:
        K = solver.conductivity(prepared)
        assert (np.linalg.eigvalsh(K) > 0).all()
        whole = solver.conductivity(solver.prepare(self.make_cell(symmetry="none")))
        np.testing.assert_allclose(whole, K, atol=1e-8 * K.max())

    def test_conductivity_of_a_straight_channel(self, solver: CellSolver) -> None:
        """K μ = π r⁴/8 along it (Hagen–Poiseuille), nothing across."""
        r = 0.15
        cell = self.make_cell(geometry=OrthogonalChannels(radius=r, axes="z"), viscosity=0.5)
        K = solver.conductivity(solver.prepare(cell))
        assert K[2, 2] == pytest.approx(np.pi * r**4 / 8 / 0.5, rel=1e-2)
        assert abs(K[0, 0]) < 1e-3 * K[2, 2]

    def test_a_failed_state_does_not_take_the_others_along(self, solver: CellSolver) -> None:
        prepared = solver.prepare(self.make_cell(contact=ContactSettings(kind="none")))
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
