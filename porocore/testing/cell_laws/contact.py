"""Suite of cell solvers in self-contact (CellContactSuite): derivatives, stiffness, overlap, starts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.contact.settings import ContactSettings
from porocore.interfaces.cell import CellSolver
from porocore.states import MacroState, Status
from porocore.testing.cell_laws.suite import CellSuite
from porocore.testing.expect import holds, near, require, same, state_text

#: In contact with the mirror planes and stable; all four loads that keep the planes mirrors differ.
TOUCHING = MacroState.single(np.diag([0.01, -0.26, -0.005]), 0.02)
#: In words.
IN_CONTACT = f"in contact ({state_text(TOUCHING.grad_u[0], TOUCHING.p[0])})"
#: Of differences; the contact's energy has jumps in its second derivatives, so that the step is small.
STEP = 3e-5
#: The loads that keep the planes mirrors: H_11, H_22, H_33 and p.
LOADS = {"H11": 0, "H22": 4, "H33": 8, "p": 9}


class CellContactSuite(CellSuite):
    """Subclass it, name the class ``Test…`` and give it ``make_solver``; for solvers that declare ``contact``."""

    @pytest.fixture(scope="class", autouse=True)
    @classmethod
    def _contact(cls, solver: CellSolver) -> None:
        cls.needs(type(solver).contact, "contact = False: it does not hold the pore wall against itself")

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
            states = MacroState(TOUCHING.grad_u + theta[:, :9].reshape(2, 3, 3), TOUCHING.p + theta[:, 9])
            ends = solver.solve(prepared, states, start=2 * touching.fields, tangent=False).response
            same("status", ends.status, [int(Status.contact)] * 2, f"{IN_CONTACT}, steps of {name}")
            responses = {field: getattr(ends, field) for field in ("potential", "stress", "fluid_volume")}
            found[name] = {field: (values[0] - values[1]) / (2 * STEP) for field, values in responses.items()}
        return found

    def test_says_so(self, touching: Any) -> None:
        """The status ``contact``, stable, with the share of the wall that touches."""
        response = touching.response
        status = Status(int(response.status[0]))
        holds(status is Status.contact, IN_CONTACT, "the status contact", status.name)
        holds(response.valid[0] and response.stable[0], IN_CONTACT, "a stable row with values", "none")
        share = response.extrema.contact_share[0]
        holds(0 < share < 0.2, IN_CONTACT, "contact_share between 0 and 0.2", share)
        # Relative to a distance that vanishes towards the planes, so no measure of how deep the penetration is.
        gap, pivots = response.extrema.min_gap[0], response.extrema.negative_pivots[0]
        holds(gap < 0, IN_CONTACT, "a negative min_gap, since a penalty gives way", gap)
        holds(pivots <= 0, IN_CONTACT, "no negative pivots", pivots)

    def test_stress_and_fluid_volume_derive_from_the_potential(
        self, touching: Any, differences: dict[str, Any]
    ) -> None:
        response = touching.response
        for name, load in LOADS.items():
            slope = response.stress[0].ravel()[load] if load < 9 else -response.fluid_volume[0]
            near(f"dW/d{name} by differences,", slope, differences[name]["potential"], IN_CONTACT, rel=1e-5)

    def test_derivatives_match_differences(self, touching: Any, differences: dict[str, Any]) -> None:
        tangent = touching.response.tangent
        by_H = tangent.stress_grad_u[0].reshape(3, 3, 9)
        for name, load in LOADS.items():
            stress = by_H[:, :, load] if load < 9 else tangent.stress_p[0]
            within = 1e-5 * np.abs(stress).max()
            near(
                f"dP_E/d{name} by differences,",
                stress,
                differences[name]["stress"],
                IN_CONTACT,
                within=within,
            )
            volume = tangent.fluid_volume_grad_u[0].ravel()[load] if load < 9 else tangent.fluid_volume_p[0]
            found = differences[name]["fluid_volume"]
            near(f"dφ/d{name} by differences,", [volume], found, IN_CONTACT, rel=1e-5)

    def test_reciprocity(self, touching: Any) -> None:
        """∂P_E/∂p = −∂φ/∂H, and ∂P_E/∂H has major symmetry."""
        tangent = touching.response.tangent
        A = tangent.stress_grad_u.reshape(9, 9)
        near("∂P_E/∂H, with major symmetry,", A, A.T, IN_CONTACT, within=1e-8 * np.abs(A).max())
        near("∂P_E/∂p = −∂φ/∂H", tangent.stress_p, -tangent.fluid_volume_grad_u, IN_CONTACT, within=1e-8)

    @pytest.mark.parametrize("factor", [0.5, 2.0])
    def test_the_stiffness_hardly_matters(self, solver: CellSolver, touching: Any, factor: float) -> None:
        """The stress with half and twice the contact's stiffness."""
        settings = ContactSettings(stiffness=factor * ContactSettings().stiffness)
        other = solver.solve(
            solver.prepare(Cell(mesh=self.mesh, contact=settings)), TOUCHING, tangent=False
        ).response
        state = f"{IN_CONTACT}, with {factor} times the stiffness"
        same("status", other.status, [int(Status.contact)], state)
        near(
            "stress[1, 1]",
            require("stress", other.stress, state)[0, 1, 1],
            touching.response.stress[0, 1, 1],
            state,
            rel=1e-2,
        )

    @pytest.mark.parametrize("contact", [ContactSettings(kind="none"), ContactSettings(stiffness=1e-6)])
    def test_a_wall_that_gives_way_overlaps(self, solver: CellSolver, contact: ContactSettings) -> None:
        """Without contact as soon as the wall passes a plane, and with too soft a one when it has passed it far."""
        prepared = solver.prepare(Cell(mesh=self.mesh, contact=contact))
        deep = MacroState.single(np.diag([0.0, -0.36, 0.0]))
        response = solver.solve(prepared, deep, tangent=False).response
        state = f"{state_text(deep.grad_u[0])}, {contact!r}"
        status = Status(int(response.status[0]))
        holds(status is Status.overlap, state, "the status overlap", status.name)
        holds(
            np.isnan(require("stress", response.stress, state)).all(),
            state,
            "NaN for stress",
            response.stress,
        )

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
            state = f"{state_text(light.grad_u[0], light.p[0])}, after a state in contact"
            same("status", other.status, [int(Status.converged)], state)
            near("stress", other.stress, cold.stress, state, within=1e-9, rel=1e-7)
            slope, before = other.tangent.stress_grad_u, cold.tangent.stress_grad_u
            near("∂P_E/∂H", slope, before, state, within=1e-8, rel=1e-7)
