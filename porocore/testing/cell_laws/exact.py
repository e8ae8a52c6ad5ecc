"""Laws on cells with known responses: rest, uniform pressure, conductivity, an overlap."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.contact.settings import ContactSettings
from porocore.cell.geometry.kinds import OrthogonalChannels
from porocore.cell.materials.material import Material
from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.interfaces.cell import CellSolver
from porocore.states import Array, MacroState, Status
from porocore.testing.cell_laws.suite import CellSuite
from porocore.testing.expect import holds, near, require, same, state_text

#: μ_f K of three channels of radius 0.25 (Dehghani and Zilian 2022), two digits of which are certain.
THREE_CHANNELS = 1.94e-3
#: A plane layer is one if its volume is its thickness times the cross-section, in lengths of the cell.
FLAT = 1e-6
#: λ of the solid under a pressure on all sides: 0.47 and −0.14 E for the usual one.
STRETCHES = (0.9, 1.05)


def known_conductivity(cell: Cell) -> tuple[Array, float] | None:
    """Return K (3, 3) of a cell from elsewhere, and how far the number itself can be trusted; None: not known.

    A straight round channel (Hagen–Poiseuille), one plane layer of fluid, and three channels as published.
    """
    geometry, mu = cell.geometry, cell.viscosity
    if geometry == OrthogonalChannels():
        return THREE_CHANNELS / mu * np.eye(3), 0.04
    if isinstance(geometry, OrthogonalChannels) and len(geometry.axes) == 1 and geometry.radii is None:
        along = np.diag([float(axis == geometry.axes) for axis in "xyz"])
        return np.pi * geometry.radius**4 / 8 / mu * along, 0.0
    if geometry.porosity == 0:
        return None
    points = cell.make_mesh("fluid", "whole").points
    for axis, thickness in enumerate(np.ptp(points, axis=0)):
        if abs(thickness - geometry.porosity) < FLAT:
            return thickness**3 / 12 / mu * np.diag(np.arange(3) != axis), 0.0
    return None


class ExactCells(CellSuite):
    """Part of :class:`porocore.testing.cell_laws.base.CellSolverSuite`."""

    def test_rest(self, solver: CellSolver, prepared: Any) -> None:
        """No stress, no energy, no displacement, and the fluid volume is the porosity."""
        rest: Any = solver.solve_one(prepared, np.zeros((3, 3)))
        same("status", rest.status, [int(Status.converged)], "at rest")
        for name in ("mean_grad", "potential", "stress"):
            near(name, getattr(rest, name), 0.0, "at rest", within=1e-13)
        porosity = self.make_cell().geometry.porosity
        near("fluid_volume, the porosity,", rest.fluid_volume[0], porosity, "at rest", rel=5e-3, within=1e-12)

    def test_uniform_pressure_identity(self, solver: CellSolver, prepared: Any) -> None:
        """Q_ii = (1 − 2ν)(M_iiii + M_iijj + M_iikk) where the solid is one isotropic material, neo-Hookean here."""
        material = self.make_cell().material
        if not isinstance(material, NeoHookean):
            pytest.skip("the solid of this cell is not one neo-Hookean material")
        tangent: Any = solver.solve_one(prepared, np.zeros((3, 3))).tangent
        Q = np.diag(tangent.mean_grad_p[0])
        expected = (1 - 2 * material.poisson_ratio) * np.einsum("iikk->i", tangent.mean_grad_grad_u[0])
        near("Q_ii", Q, expected, "at rest", within=1e-6 * np.abs(expected).max())

    @pytest.mark.parametrize("stretch", STRETCHES)
    def test_under_a_pressure_on_all_sides_the_solid_deforms_alike(
        self, solver: CellSolver, prepared: Any, stretch: float
    ) -> None:
        """F = λ I and p = −P(λ I)₁₁/λ² of the solid: u¹ = 0, P_E = −p λ² I, φ = φ_f λ³, whatever the pores."""
        accuracy = self.exact(solver)
        solid = self.make_cell().solid
        if not isinstance(solid, Material) or not solid.isotropic:
            pytest.skip("the solid of this cell is not one isotropic material")
        F = stretch * np.eye(3)
        p = float(-solid.stress(F[None])[0, 0, 0] / stretch**2)
        H, state = F - np.eye(3), state_text(F - np.eye(3), p)
        found: Any = solver.solve_one(prepared, H, p)
        same("status", found.status, [int(Status.converged)], state)
        rest: Any = solver.solve_one(prepared, np.zeros((3, 3)))
        fluid = float(rest.fluid_volume[0])
        energy = (1 - fluid) * float(solid.energy_density(F[None])[0])
        within = 1e-7 if type(solver).meshes == "core" else max(1e-7, 0.1 * accuracy)
        near("mean_grad", found.mean_grad[0], 0.0, state, within=within)
        near("stress", found.stress[0], -p * stretch**2 * np.eye(3), state, within=within)
        near("fluid_volume", found.fluid_volume[0], fluid * stretch**3, state, within=within)
        near("potential", found.potential[0], energy - p * fluid * stretch**3, state, within=within)

    def test_averages_belong_together(self, solver: CellSolver, prepared: Any) -> None:
        """Averages at rest obey ∂φ/∂H = φ_f I − I:M and ∂φ/∂p = −tr Q: what the solid gives way is room for the fluid.

        And ∂P_E/∂H = φ_s C + C:M where the solid is one material. So <∇u¹> is per volume of the cell, not of the solid.
        """
        rest: Any = solver.solve_one(prepared, np.zeros((3, 3)))
        tangent, porosity = rest.tangent, rest.fluid_volume[0]
        M, Q = tangent.mean_grad_grad_u[0], tangent.mean_grad_p[0]
        biot = porosity * np.eye(3) - np.einsum("iikl->kl", M)
        pairs = [
            ("∂φ/∂H", tangent.fluid_volume_grad_u[0], biot),
            ("∂φ/∂p", tangent.fluid_volume_p[0], -np.trace(Q)),
        ]
        material = self.make_cell().solid
        if isinstance(material, Material):
            C = material.elasticity
            stiffness = (1 - porosity) * C + np.einsum("ijmn,mnkl->ijkl", C, M)
            pairs.append(("∂P_E/∂H", tangent.stress_grad_u[0], stiffness))
        for what, slope, expected in pairs:
            near(what, slope, expected, "at rest", within=1e-8 * max(float(np.abs(expected).max()), 1e-3))

    def test_conductivity(self, solver: CellSolver, prepared: Any) -> None:
        """Symmetric, no negative eigenvalue, a positive one where there are pores, and ∝ 1/μ_f."""
        self.needs_conductivity(solver, "piola")
        K, state = solver.conductivity(prepared), "the undeformed cell"
        holds(np.shape(K) == (3, 3), state, "K of shape (3, 3)", np.shape(K))
        size = np.abs(K).max()
        near("K, symmetric,", K, K.T, state, within=1e-8 * size)
        lowest = np.linalg.eigvalsh((K + K.T) / 2).min()
        holds(lowest >= -1e-8 * size, state, "K without a negative eigenvalue", lowest)
        has_pores = self.make_cell().geometry.porosity > 0
        holds((K.max() > 0) == has_pores, state, "flow where there are pores, and else none", K.max())
        thick = self.make_cell(viscosity=2 * self.make_cell().viscosity)
        half = solver.conductivity(solver.prepare(thick))
        near("K", half, K / 2, "with twice the viscosity", rel=1e-9, within=1e-9 * size)

    def test_conductivity_has_the_known_value(self, solver: CellSolver, prepared: Any) -> None:
        """K of a channel, a plane layer or three channels has the known value, within the declared accuracy."""
        self.needs_conductivity(solver, "piola")
        accuracy, cell = self.exact(solver), self.make_cell()
        known = known_conductivity(cell)
        if known is None:
            pytest.skip("K of this cell is not known from elsewhere; give make_cell a straight channel")
        K, trust = known
        found = solver.conductivity(prepared)
        near("K", found, K, cell.geometry.description, within=(accuracy + trust) * np.abs(K).max())

    def test_conductivity_of_the_deformed_pore(self, solver: CellSolver) -> None:
        """K_ref at rest is K of the undeformed cell; λ³ times that where solid and pore grow by λ."""
        self.needs_conductivity(solver, "deformed")
        cell, grown = self.make_cell(), 1.05
        if not isinstance(cell.solid, NeoHookean):
            pytest.skip("the solid of this cell is not one neo-Hookean material")
        p = -cell.solid.stress(grown * np.eye(3)[None])[0, 0, 0] / grown**2
        H = np.stack([np.zeros((3, 3)), (grown - 1) * np.eye(3), np.diag([0.0, -1.2, 0.0])])
        deformed: Any = solver
        prepared = deformed.prepare(cell, deformed=True)
        found: Any = solver.solve(prepared, MacroState(H, np.array([0.0, p, 0.0])), tangent=False).response
        K = solver.conductivity(prepared)
        states = ["at rest", state_text(H[1], p), state_text(H[2])]
        for what, shape in (("conductivity", (3, 3, 3)), ("min_fluid_jacobian", (3,))):
            values = require(what, getattr(found, what), "prepared with deformed=True")
            holds(values.shape == shape, "three states", f"{what} of shape {shape}", values.shape)
        near("conductivity", found.conductivity[0], K, states[0], within=1e-9 * K.max())
        near("conductivity", found.conductivity[1], grown**3 * K, states[1], within=1e-7 * K.max())
        near("min_fluid_jacobian", found.min_fluid_jacobian[:2], [1, grown**3], states[1], rel=1e-7)
        for what in ("conductivity", "min_fluid_jacobian"):
            lost = getattr(found, what)[2]
            holds(np.isnan(lost).all(), states[2], f"NaN for {what} of the failed row", lost)
        plain = solver.solve_one(solver.prepare(cell), np.zeros((3, 3)), tangent=False)
        holds(plain.conductivity is None, "prepared without deformed", "no conductivity", plain.conductivity)

    def test_an_overlap_has_no_values(self, solver: CellSolver) -> None:
        """A drained cell without contact, squeezed along each axis: where there are values, there is room for fluid.

        The wall of three channels of radius 0.25 has then passed through itself.
        """
        cell = self.make_cell(contact=ContactSettings(kind="none"))
        H = np.stack([-0.4 * np.diag(row) for row in np.eye(3)])
        response = solver.solve(solver.prepare(cell), MacroState(H, np.zeros(3)), tangent=False).response
        through = type(solver).accuracy is not None and cell.geometry == OrthogonalChannels()
        for row in range(3):
            status, state = Status(int(response.status[row])), f"{state_text(H[row])}, without contact"
            if not status.has_values:
                continue
            holds(
                not through,
                state,
                "a status without values, since the wall passes through itself",
                status.name,
            )
            volume = require("fluid_volume", response.fluid_volume, state)[row]
            porous = cell.geometry.porosity > 0
            holds(volume > 0 or not porous, state, "the status overlap, or a positive fluid volume", volume)

    @staticmethod
    def needs_conductivity(solver: CellSolver, which: str) -> None:
        """Skip where the solver does not declare this conductivity."""
        CellSuite.needs(
            which in type(solver).conductivities,
            f"conductivities = {type(solver).conductivities}: it does not compute '{which}'",
        )

    @staticmethod
    def exact(solver: CellSolver) -> float:
        """Return the declared accuracy; skip where there is none."""
        accuracy = type(solver).accuracy
        if accuracy is None:
            pytest.skip("accuracy = None: it is an estimate, which is held to no exact value")
        return accuracy
