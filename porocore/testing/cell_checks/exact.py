"""Base of the suites of cell solvers (CellSuite); checks that hold exactly: identities, closed forms, contact.

Misfits are relative to the largest entry of what is compared, unless said otherwise.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.contact.wall_contact import ContactSettings
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.cell.materials.material import Material
from porocore.cell.meshing.mesh import MeshSettings
from porocore.interfaces.cell import CellSolver
from porocore.states import Array, MacroState, Status
from porocore.testing.expect import holds, near, require, same, state_text
from porocore.testing.suite import Suite

#: Three states away from zero: diagonal, diagonal under suction, and general with shear and pressure.
STATES: dict[str, tuple[Array, float]] = {
    "compressed": (np.diag([0.02, -0.08, 0.03]), 0.05),
    "stretched": (np.diag([0.10, -0.02, 0.05]), -0.04),
    "sheared": (np.array([[0.03, 0.08, -0.02], [0.01, -0.06, 0.04], [0.0, 0.05, 0.02]]), 0.08),
}
#: Of the differences that derivatives are held against.
STEP = 1e-3


class CellSuite(Suite):
    """Subclass a suite, name the class ``Test…`` and give it ``make_solver``."""

    #: Kept coarse; what is tested here holds on every mesh.
    mesh = MeshSettings(size=0.2, fluid_size=0.14)

    @classmethod
    def make_solver(cls) -> CellSolver:
        """The solver under test, with default options."""
        raise cls.undefined("make_solver(cls)", "MyCellSolver()", "a new porocore.CellSolver")

    @classmethod
    def make_cell(cls, **others: Any) -> Cell:
        """The cell that is solved, with ``others`` of its keys changed; one that the solver is made for."""
        return Cell(mesh=cls.mesh, **others)

    @pytest.fixture(scope="class")
    @classmethod
    def solver(cls) -> CellSolver:
        return cls.make_solver()

    @pytest.fixture(scope="class")
    @classmethod
    def prepared(cls, solver: CellSolver) -> Any:
        return solver.prepare(cls.make_cell())

    @pytest.fixture(scope="class")
    @classmethod
    def responses(cls, solver: CellSolver, prepared: Any) -> dict[str, Any]:
        """Responses at ``STATES``, one row each."""
        return {name: solver.solve_one(prepared, *state) for name, state in STATES.items()}

    @pytest.fixture(scope="class")
    @classmethod
    def batch(cls) -> MacroState:
        """Return ``STATES`` as one batch."""
        return MacroState.concatenate([MacroState.single(*state) for state in STATES.values()])


def state_label(name: str) -> str:
    """Return one of ``STATES`` as text."""
    return f"{name} ({state_text(*STATES[name])})"


def matches_difference(what: str, difference: Any, slope: Any, state: str) -> None:
    """Hold a derivative against a difference of the responses, up to 1e-6 of its largest entry."""
    size = float(np.abs(slope).max())
    near(f"{what} by differences,", slope, difference, state, within=max(1e-6 * size, 1e-9))


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
    """Part of :class:`porocore.testing.cell_checks.base.CellSolverSuite`."""

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


#: In contact with the mirror planes and stable; all four loads that keep the planes mirrors differ.
TOUCHING = MacroState.single(np.diag([0.01, -0.26, -0.005]), 0.02)
#: In words.
IN_CONTACT = f"in contact ({state_text(TOUCHING.grad_u[0], TOUCHING.p[0])})"
#: Of differences; the contact's energy has jumps in its second derivatives, so that the step is small.
CONTACT_STEP = 3e-5
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
            theta[:, load] = CONTACT_STEP, -CONTACT_STEP
            states = MacroState(TOUCHING.grad_u + theta[:, :9].reshape(2, 3, 3), TOUCHING.p + theta[:, 9])
            ends = solver.solve(prepared, states, start=2 * touching.fields, tangent=False).response
            same("status", ends.status, [int(Status.contact)] * 2, f"{IN_CONTACT}, steps of {name}")
            responses = {field: getattr(ends, field) for field in ("potential", "stress", "fluid_volume")}
            found[name] = {
                field: (values[0] - values[1]) / (2 * CONTACT_STEP) for field, values in responses.items()
            }
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
