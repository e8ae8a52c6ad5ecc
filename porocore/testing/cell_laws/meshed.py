"""Suite of cell solvers on porocore's meshes (MeshedCellSuite): symmetry, eighth and whole, percolation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import porocore.testing.cell_laws.identities as identities
from porocore.cell.cell import Cell
from porocore.cell.contact.settings import ContactSettings
from porocore.cell.geometry.kinds import OrthogonalChannels
from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.interfaces.cell import CellSolver
from porocore.states import MacroState, Status
from porocore.testing.cell_laws.base import CellSolverSuite
from porocore.testing.cell_laws.members import range_around
from porocore.testing.cell_laws.open_cells import OpenCells
from porocore.testing.cell_laws.suite import RESPONSES, STATES, state_label
from porocore.testing.expect import holds, near, require, state_text


class MeshedCellSuite(OpenCells, CellSolverSuite):
    """Subclass it, name the class ``Test…`` and give it ``make_solver``."""

    @classmethod
    def make_family(cls) -> Cell:
        """The cell with ranges around radius and Poisson's ratio: the mesh moves with the first."""
        geometry, material = OrthogonalChannels(), NeoHookean()
        return cls.make_cell(
            geometry={"kind": geometry.kind, "radius": range_around(geometry.radius)},
            material={"poisson_ratio": range_around(material.poisson_ratio)},
        )

    def test_cubic_symmetry(self, solver: CellSolver, prepared: Any) -> None:
        """M of a cubic cell is a cubic tensor."""
        tangent: Any = solver.solve_one(prepared, np.zeros((3, 3))).tangent
        misfit = identities.cubic_symmetry(tangent.mean_grad_grad_u[0])
        holds(
            misfit < 1e-8,
            "at rest",
            "M alike under the symmetries of a cube up to 1e-8",
            f"a misfit of {misfit:.3g}",
        )

    @pytest.mark.parametrize("name", ["compressed", "stretched"])
    def test_eighth_and_whole_cell_agree(
        self, solver: CellSolver, responses: dict[str, Any], name: str
    ) -> None:
        whole = solver.solve_one(solver.prepare(self.make_cell(symmetry="none")), *STATES[name])
        eighth, state = responses[name], f"{state_label(name)} of the whole cell, against the eighth"
        for response in RESPONSES:
            near(response, getattr(whole, response), getattr(eighth, response), state, within=1e-8, rel=1e-7)
        for slope, value in vars(eighth.tangent).items():
            if value is not None:
                near(f"tangent.{slope}", getattr(whole.tangent, slope), value, state, within=1e-8, rel=1e-7)

    def test_the_flow_percolates_along_every_axis(self, solver: CellSolver, prepared: Any) -> None:
        self.needs_conductivity(solver, "piola")
        K = solver.conductivity(prepared)
        lowest = np.linalg.eigvalsh(K).min()
        holds(lowest > 0, "three crossing channels", "positive eigenvalues of K", lowest)
        whole = solver.conductivity(solver.prepare(self.make_cell(symmetry="none")))
        near("K", whole, K, "the whole cell, against the eighth", within=1e-8 * K.max(), rel=1e-7)

    def test_conductivity_of_a_straight_channel(self, solver: CellSolver) -> None:
        """K μ = π r⁴/8 along it (Hagen–Poiseuille), nothing across."""
        self.needs_conductivity(solver, "piola")
        r = 0.15
        cell = self.make_cell(geometry=OrthogonalChannels(radius=r, axes="z"), viscosity=0.5)
        K = solver.conductivity(solver.prepare(cell))
        state = f"one channel of radius {r} along z, viscosity 0.5"
        near("K along it", K[2, 2], np.pi * r**4 / 8 / 0.5, state, rel=1e-2)
        near("K across", K[0, 0], 0.0, state, within=1e-3 * K[2, 2])

    def test_a_failed_state_does_not_take_the_others_along(self, solver: CellSolver) -> None:
        prepared = solver.prepare(self.make_cell(contact=ContactSettings(kind="none")))
        H = np.zeros((4, 3, 3))
        H[1, 1, 1], H[2, 1, 1], H[3, 1, 1] = -0.4, -1.2, -0.1
        batch = solver.solve(prepared, MacroState(H, np.zeros(4)), fields=True)
        wanted = [Status.converged, Status.overlap, Status.inverted, Status.converged]
        for row, status in enumerate(wanted):
            state, found = f"row {row} of 4 ({state_text(H[row])})", Status(int(batch.response.status[row]))
            holds(found is status, state, f"the status {status.name}", found.name)
            for name in RESPONSES:
                values = getattr(batch.response, name)[row]
                right = np.isfinite(values) if status.has_values else np.isnan(values)
                what = "numbers" if status.has_values else "NaN"
                holds(right.all(), state, f"{what} for {name}", values)
        if type(solver).returns_fields:
            fields = [field is None for field in require("fields", batch.fields, "a batch of 4")]
            holds(fields == [False, True, True, False], "a batch of 4", "no field for rows 1 and 2", fields)
