"""Suite of cell solvers (CellSolverSuite): shapes, derivatives against differences, objectivity.

.. code-block:: python

    class TestMyCellSolver(CellSolverSuite):
        kit_version = "3"

        @classmethod
        def make_solver(cls):
            return MyCellSolver()

The suite of a solver that discretises any pore geometry derives :class:`porocore.testing.MeshedCellSuite`, which adds
the laws of meshes and mirrors.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import porocore.testing.cell_laws.identities as identities
from porocore.interfaces.cell import CellSolver
from porocore.macro.laws.pull_back import ConductivityLaw, PulledBack
from porocore.states import MacroState
from porocore.testing.cell_laws.calls import Calls
from porocore.testing.cell_laws.exact import ExactCells
from porocore.testing.cell_laws.members import Members
from porocore.testing.cell_laws.suite import RESPONSES, STATES, STEP, matches_difference, state_label
from porocore.testing.expect import holds, near, require

ROTATION = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
#: The sheared state and its pressure after a rotation.
TURNED = ROTATION @ (np.eye(3) + STATES["sheared"][0]) - np.eye(3), STATES["sheared"][1]


class CellSolverSuite(ExactCells, Calls, Members):
    """Subclass it, name the class ``Test…`` give it ``make_solver``, and ``make_cell`` if it solves some cells only.

    What the solver's class does not offer (``conductivities``, ``slopes``, ``accuracy`` …) is skipped.
    """

    @pytest.mark.parametrize("name", STATES)
    def test_shapes(self, responses: dict[str, Any], name: str) -> None:
        """The batch axis leads; the indices of a response stand before those of the variable."""
        response, state = responses[name], state_label(name)
        tensor, tangent = (1, 3, 3), require("derivatives", responses[name].tangent, state)
        shapes = {
            "mean_grad": tensor,
            "stress": tensor,
            "potential": (1,),
            "fluid_volume": (1,),
            "status": (1,),
        }
        slopes = {"fluid_volume_grad_u": tensor, "fluid_volume_p": (1,)}
        for field in ("mean_grad", "stress"):
            slopes |= {f"{field}_grad_u": (1, 3, 3, 3, 3), f"{field}_p": tensor}
        for holder, wanted in ((response, shapes), (tangent, slopes)):
            for what, shape in wanted.items():
                found = np.shape(getattr(holder, what))
                holds(found == shape, state, f"{what} of shape {shape}", f"shape {found}")

    @pytest.mark.parametrize("name", STATES)
    def test_derivatives_match_differences(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any], name: str
    ) -> None:
        """Central differences of the responses along a random direction of (H, p)."""
        H, p = STATES[name]
        rng = np.random.default_rng(1)
        dH, dp = rng.normal(size=(3, 3)), rng.normal()
        if name != "sheared":
            dH = np.diag(np.diag(dH))
        differences = self.differences(solver, prepared, H, p, dH, dp)
        for response, slope in identities.linear_changes(responses[name], dH, dp).items():
            matches_difference(f"slope of {response}", differences[response], slope, state_label(name))

    @staticmethod
    def differences(solver: CellSolver, prepared: Any, H: Any, p: float, dH: Any, dp: float) -> Any:
        """Difference quotients of the responses in a direction."""
        states = identities.stencil_states(H, p, dH, dp, STEP)
        return identities.difference_quotients(
            [solver.solve(prepared, state, tangent=False).response for state in states], STEP
        )

    def test_shear_derivatives_of_a_diagonal_state(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any]
    ) -> None:
        """Also where a symmetric part of the cell was solved, which shear would leave."""
        H, p = STATES["compressed"]
        dH = np.zeros((3, 3))
        dH[0, 1], dH[2, 0] = 1.0, -0.5
        differences = self.differences(solver, prepared, H, p, dH, 0.0)
        slopes = identities.linear_changes(responses["compressed"], dH, 0.0)
        # Energy and fluid volume are even in shear, so their slopes vanish.
        for response in ("mean_grad", "stress"):
            state = f"{state_label('compressed')}, along a shear"
            matches_difference(f"slope of {response}", differences[response], slopes[response], state)

    @pytest.mark.parametrize("name", STATES)
    def test_reciprocity(self, responses: dict[str, Any], name: str) -> None:
        """∂P_E/∂p = −∂φ/∂H, and ∂P_E/∂H has major symmetry."""
        tangent, state = responses[name].tangent, state_label(name)
        skew = identities.major_symmetry(tangent)
        holds(skew < 1e-9, state, "major symmetry of ∂P_E/∂H up to 1e-9", f"a misfit of {skew:.3g}")
        misfit = identities.reciprocity(tangent)
        holds(misfit < 1e-9, state, "∂P_E/∂p = −∂φ/∂H up to 1e-9", f"a misfit of {misfit:.3g}")

    @pytest.fixture(scope="class")
    @classmethod
    def turned(cls, solver: CellSolver, prepared: Any) -> Any:
        """Return the response at the sheared state after a rotation."""
        H, p = TURNED
        return solver.solve_one(prepared, H, p, tangent=False)

    def test_objectivity(self, responses: dict[str, Any], turned: Any) -> None:
        """W and φ do not feel a rotation; P_E and <∇u¹> turn with it."""
        for name in RESPONSES:
            expected = getattr(responses["sheared"], name)[0]
            expected = ROTATION @ expected if expected.shape else expected
            self.assert_near(name, getattr(turned, name)[0], expected, f"{state_label('sheared')}, turned")

    @pytest.mark.parametrize("law", ["piola", "deformed"])
    def test_a_rotation_of_the_body_rotates_the_flux(
        self, solver: CellSolver, responses: dict[str, Any], turned: Any, law: ConductivityLaw
    ) -> None:
        """The flux through reference area is that of the body that was not turned; in space it turns with the body."""
        states = MacroState.concatenate([MacroState.single(*STATES["sheared"]), MacroState.single(*TURNED)])
        if law == "deformed":
            self.needs_conductivity(solver, "deformed")
            prepare: Any = solver.prepare
            found = solver.solve(prepare(self.make_cell(), deformed=True), states, tangent=False).response
            mean_grad, conductivity = found.mean_grad, found.conductivity
        else:
            mean_grad = np.concatenate([responses["sheared"].mean_grad, turned.mean_grad])
            conductivity = None
        # Whatever the cell is, K differs between the axes, or a turn of it would not be felt.
        grad_p, K = np.tile([1.0, -0.4, 0.7], (2, 1)), np.diag([1.0, 0.6, 0.3])
        solid = 1 - self.make_cell().geometry.porosity
        straight, rotated = PulledBack.from_states(
            states, mean_grad, grad_p, solid, K, law, conductivity
        ).flux
        state = f"{state_label('sheared')}, turned, by the conductivity '{law}'"
        near(
            "the flux through reference area", rotated, straight, state, within=1e-7 * np.abs(straight).max()
        )
