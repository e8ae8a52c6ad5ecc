"""The laws that every cell solver obeys, as tests that a plugin author subclasses.

.. code-block:: python

    class TestMyCellSolver(CellSolverSuite):
        kit_version = "2"

        @classmethod
        def make_solver(cls):
            return MyCellSolver()

A solver that discretises any pore geometry subclasses :class:`porocore.testing.cell_meshed.MeshedCellSuite`, which adds
what a mesh and its mirrors bring.
"""

from __future__ import annotations

from inspect import signature
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import porocore.cell_identities as identities
from porocore.closures.pull_back import ConductivityLaw, PulledBack
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import CellSolver
from porocore.materials.material import Material
from porocore.materials.neo_hookean import NeoHookean
from porocore.states import Array, CellResponse, MacroState, Status
from porocore.testing.cell_suite import CellSuite

#: Three states away from zero: diagonal, diagonal under suction, and general with shear and pressure.
STATES: dict[str, tuple[Array, float]] = {
    "compressed": (np.diag([0.02, -0.08, 0.03]), 0.05),
    "stretched": (np.diag([0.10, -0.02, 0.05]), -0.04),
    "sheared": (np.array([[0.03, 0.08, -0.02], [0.01, -0.06, 0.04], [0.0, 0.05, 0.02]]), 0.08),
}
#: Of the differences that derivatives are held against.
STEP = 1e-3
RESPONSES = ("mean_grad", "potential", "stress", "fluid_volume")


class CellSolverSuite(CellSuite):
    """Subclass it, name the class ``Test…`` give it ``make_solver``, and ``make_cell`` if it solves some cells only."""

    #: Of responses, between solves that may take another way to the same equilibrium.
    same: ClassVar[float] = 1e-9

    @pytest.fixture(scope="class")
    @classmethod
    def responses(cls, solver: CellSolver, prepared: Any) -> dict[str, Any]:
        """Of ``STATES``, one row each."""
        return {name: solver.solve_one(prepared, *state) for name, state in STATES.items()}

    @pytest.fixture(scope="class")
    @classmethod
    def batch(cls) -> MacroState:
        """``STATES`` together."""
        return MacroState.concatenate([MacroState.single(*state) for state in STATES.values()])

    def test_rest(self, solver: CellSolver, prepared: Any) -> None:
        """No stress, no energy, no displacement, and the fluid volume is the porosity."""
        rest: Any = solver.solve_one(prepared, np.zeros((3, 3)))
        assert rest.status[0] == Status.converged
        for name in ("mean_grad", "potential", "stress"):
            assert np.abs(getattr(rest, name)).max() < 1e-13
        porosity = self.make_cell().geometry.porosity
        assert rest.fluid_volume[0] == pytest.approx(porosity, rel=5e-3, abs=1e-12)

    @pytest.mark.parametrize("name", STATES)
    def test_shapes(self, responses: dict[str, Any], name: str) -> None:
        """The batch axis leads; the indices of a response stand before those of the variable."""
        response = responses[name]
        assert response.status.shape == (1,)
        assert response.mean_grad.shape == response.stress.shape == (1, 3, 3)
        assert response.potential.shape == response.fluid_volume.shape == (1,)
        tangent = response.tangent
        for field in ("mean_grad", "stress"):
            assert getattr(tangent, f"{field}_grad_u").shape == (1, 3, 3, 3, 3)
            assert getattr(tangent, f"{field}_p").shape == (1, 3, 3)
        assert tangent.fluid_volume_grad_u.shape == (1, 3, 3)
        assert tangent.fluid_volume_p.shape == (1,)

    @pytest.mark.parametrize("name", STATES)
    def test_derivatives_are_the_slopes(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any], name: str
    ) -> None:
        """Central differences of the responses along a random direction of (H, p)."""
        H, p = STATES[name]
        rng = np.random.default_rng(1)
        dH, dp = rng.normal(size=(3, 3)), rng.normal()
        if name != "sheared":
            dH = np.diag(np.diag(dH))
        differences = self.differences(solver, prepared, H, p, dH, dp)
        for response, slope in identities.along(responses[name], dH, dp).items():
            _assert_slope(differences[response], slope, response)

    @staticmethod
    def differences(solver: CellSolver, prepared: Any, H: Any, p: float, dH: Any, dp: float) -> Any:
        """Slopes of the responses in a direction."""
        states = identities.steps_around(H, p, dH, dp, STEP)
        return identities.slopes([solver.solve(prepared, state).response for state in states], STEP)

    def test_shear_derivatives_of_a_diagonal_state(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any]
    ) -> None:
        """Also where a symmetric part of the cell was solved, which shear would leave."""
        H, p = STATES["compressed"]
        dH = np.zeros((3, 3))
        dH[0, 1], dH[2, 0] = 1.0, -0.5
        differences = self.differences(solver, prepared, H, p, dH, 0.0)
        slopes = identities.along(responses["compressed"], dH, 0.0)
        # Energy and fluid volume are even in shear, so their slopes vanish.
        for response in ("mean_grad", "stress"):
            _assert_slope(differences[response], slopes[response], response)

    @pytest.mark.parametrize("name", STATES)
    def test_reciprocity(self, responses: dict[str, Any], name: str) -> None:
        """∂P_E/∂p = −∂φ/∂H, and ∂P_E/∂H has major symmetry."""
        tangent = responses[name].tangent
        assert identities.major_symmetry(tangent) < 1e-9
        assert identities.reciprocity(tangent) < 1e-9

    def test_uniform_pressure_identity(self, solver: CellSolver, prepared: Any) -> None:
        """Q_ii = (1 − 2ν)(M_iiii + M_iijj + M_iikk) where the solid is one isotropic material, neo-Hookean here."""
        material = self.make_cell().material
        if not isinstance(material, NeoHookean):
            pytest.skip("the solid of this cell is not one neo-Hookean material")
        tangent: Any = solver.solve_one(prepared, np.zeros((3, 3))).tangent
        Q = np.diag(tangent.mean_grad_p[0])
        expected = (1 - 2 * material.poisson_ratio) * np.einsum("iikk->i", tangent.mean_grad_grad_u[0])
        assert np.abs(Q - expected).max() <= 1e-6 * np.abs(expected).max()

    def test_averages_belong_together(self, solver: CellSolver, prepared: Any) -> None:
        """At rest ∂φ/∂H = φ_f I − I:M and ∂φ/∂p = −tr Q: what the solid gives way is room for the fluid.

        And ∂P_E/∂H = φ_s C + C:M where the solid is one material. So <∇u¹> is per volume of the cell, not of the solid.
        """
        rest: Any = solver.solve_one(prepared, np.zeros((3, 3)))
        tangent, porosity = rest.tangent, rest.fluid_volume[0]
        M, Q = tangent.mean_grad_grad_u[0], tangent.mean_grad_p[0]
        biot = porosity * np.eye(3) - np.einsum("iikl->kl", M)
        _assert_near(tangent.fluid_volume_grad_u[0], biot, 1e-8, "∂φ/∂H")
        _assert_near(tangent.fluid_volume_p[0], -np.trace(Q), 1e-8, "∂φ/∂p")
        material = self.make_cell().solid
        if isinstance(material, Material):
            C = material.elasticity
            stiffness = (1 - porosity) * C + np.einsum("ijmn,mnkl->ijkl", C, M)
            _assert_near(tangent.stress_grad_u[0], stiffness, 1e-8, "∂P_E/∂H")

    def test_objectivity(self, solver: CellSolver, prepared: Any, responses: dict[str, Any]) -> None:
        """W and φ do not feel a rotation; P_E and <∇u¹> turn with it."""
        H, p = STATES["sheared"]
        R = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
        before = responses["sheared"]
        turned: Any = solver.solve_one(prepared, R @ (np.eye(3) + H) - np.eye(3), p)
        for name in RESPONSES:
            expected = getattr(before, name)[0]
            expected = R @ expected if expected.shape else expected
            _assert_near(getattr(turned, name)[0], expected, self.same, name)

    def test_rows_do_not_depend_on_the_batch_or_its_order(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any], batch: MacroState
    ) -> None:
        backwards = solver.solve(prepared, batch[::-1]).response[::-1]
        for row, name in enumerate(STATES):
            self.assert_same(backwards[row : row + 1], responses[name])

    def test_a_new_solver_gives_the_same(self, responses: dict[str, Any]) -> None:
        solver = self.make_solver()
        name, state = next(iter(STATES.items()))
        self.assert_same(solver.solve_one(solver.prepare(self.make_cell()), *state), responses[name])

    def test_derivatives_only_where_they_are_wanted(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any]
    ) -> None:
        name, state = next(iter(STATES.items()))
        plain = solver.solve_one(prepared, *state, tangent=False)
        assert plain.tangent is None
        for response in RESPONSES:
            _assert_near(getattr(plain, response), getattr(responses[name], response), self.same, response)

    def test_inputs_are_not_changed(self, solver: CellSolver, prepared: Any, batch: MacroState) -> None:
        states = batch[:2]
        H, p = states.grad_u.copy(), states.p.copy()
        first: Any = solver.solve(prepared, states, fields=True)
        kept = [None if field is None else field.u.copy() for field in first.fields or []]
        solver.solve(prepared, states, start=first.fields, tangent=False)
        np.testing.assert_array_equal(states.grad_u, H)
        np.testing.assert_array_equal(states.p, p)
        for field, before in zip(first.fields or [], kept, strict=True):
            if field is not None and before is not None:
                np.testing.assert_array_equal(field.u, before)

    def test_a_state_without_solution_is_a_row_with_a_status(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any]
    ) -> None:
        """det (I + H) < 0 turns the cell inside out; its row holds NaN, and those around it hold what they held."""
        H, p = STATES["compressed"]
        states = MacroState(np.stack([H, np.diag([0.0, -1.2, 0.0]), H]), np.array([p, 0.0, p]))
        solution = solver.solve(prepared, states, fields=True)
        response = solution.response
        assert not Status(int(response.status[1])).has_values
        assert not response.valid[1]
        for holder in (response, response.tangent, response.peaks):
            for name, values in vars(holder).items() if holder is not None else ():
                if isinstance(values, np.ndarray) and name not in ("status", "outside"):
                    assert np.isnan(np.asarray(values[1], dtype=float)).all(), f"{name} of a failed state"
        for row in (0, 2):
            self.assert_same(response[row : row + 1], responses["compressed"])
        if solution.fields is not None:
            assert [field is None for field in solution.fields] == [False, True, False]

    def test_a_start_changes_the_way_and_not_the_answer(self, solver: CellSolver, prepared: Any) -> None:
        near = solver.solve(prepared, MacroState.single(np.diag([0, -0.12, 0]), 0.1), fields=True)
        if near.fields is None:
            pytest.skip("this solver returns no fields")
        target = MacroState.single(np.diag([0, -0.14, 0]), 0.1)
        warm = solver.solve(prepared, target, start=near.fields).response
        cold = solver.solve(prepared, target).response
        for name in RESPONSES:
            np.testing.assert_allclose(getattr(warm, name), getattr(cold, name), atol=1e-9)

    def test_conductivity(self, solver: CellSolver, prepared: Any) -> None:
        """Symmetric, no negative eigenvalue, a positive one where there are pores, and ∝ 1/μ_f."""
        K = solver.conductivity(prepared)
        assert K.shape == (3, 3)
        np.testing.assert_allclose(K, K.T, atol=1e-8 * np.abs(K).max())
        assert np.linalg.eigvalsh((K + K.T) / 2).min() >= -1e-8 * np.abs(K).max()
        assert (K.max() > 0) == (self.make_cell().geometry.porosity > 0)
        thick = self.make_cell(viscosity=2 * self.make_cell().viscosity)
        np.testing.assert_allclose(
            solver.conductivity(solver.prepare(thick)), K / 2, rtol=1e-9, atol=1e-9 * np.abs(K).max()
        )

    def test_conductivity_of_the_deformed_pore(self, solver: CellSolver) -> None:
        """At rest that of the undeformed cell; λ³ times that where solid and pore grow by λ, under a pressure alike."""
        if "deformed" not in signature(solver.prepare).parameters:
            pytest.skip("this solver computes the conductivity of the undeformed cell only")
        cell, grown = self.make_cell(), 1.05
        if not isinstance(cell.solid, NeoHookean):
            pytest.skip("the solid of this cell is not one neo-Hookean material")
        p = -cell.solid.stress(grown * np.eye(3)[None])[0, 0, 0] / grown**2
        H = np.stack([np.zeros((3, 3)), (grown - 1) * np.eye(3), np.diag([0.0, -1.2, 0.0])])
        deformed: Any = solver
        prepared = deformed.prepare(cell, deformed=True)
        found: Any = solver.solve(prepared, MacroState(H, np.array([0.0, p, 0.0])), tangent=False).response
        K = solver.conductivity(prepared)
        assert found.conductivity.shape == (3, 3, 3)
        assert found.min_fluid_jacobian.shape == (3,)
        np.testing.assert_allclose(found.conductivity[0], K, atol=1e-9 * K.max())
        np.testing.assert_allclose(found.conductivity[1], grown**3 * K, atol=1e-7 * K.max())
        np.testing.assert_allclose(found.min_fluid_jacobian[:2], [1, grown**3], rtol=1e-7)
        assert np.isnan(found.conductivity[2]).all()
        assert np.isnan(found.min_fluid_jacobian[2])
        plain = solver.solve_one(solver.prepare(cell), np.zeros((3, 3)), tangent=False)
        assert plain.conductivity is None

    @pytest.mark.parametrize("law", ["piola", "deformed"])
    def test_a_rotation_of_the_body_rotates_the_flux(self, solver: CellSolver, law: ConductivityLaw) -> None:
        """The flux through reference area is that of the body that was not turned; in space it turns with the body."""
        how: dict[str, Any] = {}
        if law == "deformed":
            if "deformed" not in signature(solver.prepare).parameters:
                pytest.skip("this solver computes the conductivity of the undeformed cell only")
            how = {"deformed": True}
        H, p = STATES["sheared"]
        R = Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix()
        states = MacroState(np.stack([H, R @ (np.eye(3) + H) - np.eye(3)]), np.array([p, p]))
        prepare: Any = solver.prepare
        found = solver.solve(prepare(self.make_cell(), **how), states, tangent=False).response
        # Whatever the cell is, K differs between the axes, or a turn of it would not be felt.
        grad_p, K = np.tile([1.0, -0.4, 0.7], (2, 1)), np.diag([1.0, 0.6, 0.3])
        solid = 1 - self.make_cell().geometry.porosity
        straight, turned = PulledBack.of(
            states, found.mean_grad, grad_p, solid, K, law, found.conductivity
        ).flux
        _assert_near(turned, straight, 1e-7, "the flux of the turned body")

    def test_unknown_options_are_refused(self, solver: CellSolver) -> None:
        with pytest.raises((ConfigurationError, TypeError), match="no_such_option"):
            type(solver)(no_such_option=1)

    @classmethod
    def assert_same(cls, found: CellResponse, expected: CellResponse) -> None:
        """Up to :attr:`same` of the largest entry, derivatives included."""
        assert (found.status == expected.status).all()
        for name in RESPONSES:
            _assert_near(getattr(found, name), getattr(expected, name), cls.same, name)
        for name, value in vars(expected.tangent).items():
            if value is not None:
                _assert_near(getattr(found.tangent, name), value, 100 * cls.same, name)


def _assert_near(found: Any, expected: Any, share: float, what: str) -> None:
    size = max(float(np.abs(expected).max()), 1e-3)
    worst = float(np.abs(found - expected).max())
    assert worst <= share * size, f"{what}: {worst:.3g} apart, of {size:.3g}"


def _assert_slope(difference: Any, slope: Any, what: str) -> None:
    size = float(np.abs(slope).max())
    worst = float(np.abs(difference - slope).max())
    assert worst <= max(1e-6 * size, 1e-9), f"{what}: {worst:.3g} apart, of {size:.3g}"
