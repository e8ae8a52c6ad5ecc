"""Suites of cell solvers (CellSolverSuite, MeshedCellSuite): calls, derivatives, members, symmetry.

.. code-block:: python

    class TestMyCellSolver(CellSolverSuite):
        kit_version = "5"

        @classmethod
        def make_solver(cls):
            return MyCellSolver()

The suite of a solver that discretises any pore geometry derives :class:`porocore.testing.MeshedCellSuite`, which adds
the checks of meshes and mirrors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from porocore.cell.cell import Cell, Geometry
from porocore.cell.contact.wall_contact import ContactSettings
from porocore.cell.geometry.channels import OrthogonalChannels
from porocore.cell.level_sets.tpms import TriplyPeriodic
from porocore.cell.level_sets.voxels import Voxels
from porocore.cell.materials.hyperelastic import NeoHookean
from porocore.core.field_check import response_fault
from porocore.errors import ConfigurationError
from porocore.interfaces.cell import CellSolver
from porocore.macro.laws.closure import ConductivityLaw, PulledBack
from porocore.states import Array, CellResponse, MacroState, Status
from porocore.testing.cell_checks import identities
from porocore.testing.cell_checks.exact import (
    STATES,
    STEP,
    CellSuite,
    ExactCells,
    matches_difference,
    state_label,
)
from porocore.testing.cell_checks.relaxation import RelaxingCells
from porocore.testing.expect import (
    RESPONSES,
    STEPS,
    central_difference,
    holds,
    near,
    options,
    refused,
    require,
    same,
    state_text,
    states_text,
)


class Calls(CellSuite):
    """Part of :class:`porocore.testing.cell_checks.base.CellSolverSuite`."""

    #: Of responses, between solves that may take another way to the same equilibrium.
    same: ClassVar[float] = 1e-9

    def test_two_calls_give_the_same_to_the_last_bit(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any]
    ) -> None:
        """The same solver and cell repeat their result; so a repeated study is the same."""
        for name in ("compressed", "sheared"):
            again: Any = solver.solve_one(prepared, *STATES[name])
            state = f"{state_label(name)}, solved twice"
            for response in RESPONSES:
                same(response, getattr(again, response), getattr(responses[name], response), state)
            for slope, values in vars(responses[name].tangent).items():
                if values is not None:
                    same(f"tangent.{slope}", getattr(again.tangent, slope), values, state)

    @pytest.mark.parametrize("alone", ["p", "H"])
    def test_each_variable_alone_changes_the_answer(
        self, solver: CellSolver, prepared: Any, alone: str
    ) -> None:
        """Differences along p with the same H, and along H with the same p, beyond the other states' pressures."""
        H, p = np.diag([0.01, -0.03, 0.02]), 0.3
        dH, dp = (np.zeros((3, 3)), 1.0) if alone == "p" else (np.diag([0.3, -1.0, 0.5]), 0.0)
        state = f"{state_text(H, p)} and steps of {alone} alone"
        steps = identities.stencil_states(H, p, dH, dp, STEP)
        there_and_back = MacroState.concatenate([MacroState.single(H, p), *steps])
        solved = solver.solve(prepared, there_and_back).response
        found = identities.difference_quotients(
            [solved[row : row + 1] for row in range(1, len(solved))], STEP
        )
        for response, slope in identities.linear_changes(solved[:1], dH, dp).items():
            matches_difference(f"d{response}/d{alone}", found[response], slope, state)

    def test_rows_do_not_depend_on_the_batch_or_its_order(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any], batch: MacroState
    ) -> None:
        backwards = solver.solve(prepared, batch[::-1]).response[::-1]
        for row, name in enumerate(STATES):
            state = f"{state_label(name)} in a batch, against alone"
            self.assert_same(backwards[row : row + 1], responses[name], state)

    def test_a_new_solver_gives_the_same(self, responses: dict[str, Any]) -> None:
        solver = self.make_solver()
        name, state = next(iter(STATES.items()))
        found = solver.solve_one(solver.prepare(self.make_cell()), *state)
        self.assert_same(found, responses[name], f"{state_label(name)}, by a new solver")

    def test_derivatives_only_where_they_are_wanted(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any]
    ) -> None:
        name, at = next(iter(STATES.items()))
        plain = solver.solve_one(prepared, *at, tangent=False)
        state = f"{state_label(name)}, tangent=False"
        holds(plain.tangent is None, state, "no derivatives", "derivatives")
        for response in RESPONSES:
            self.assert_near(response, getattr(plain, response), getattr(responses[name], response), state)

    def test_inputs_are_not_changed(self, solver: CellSolver, prepared: Any, batch: MacroState) -> None:
        states = batch[:2]
        H, p = states.grad_u.copy(), states.p.copy()
        first: Any = solver.solve(prepared, states, fields=True)
        kept = [None if field is None else field.u.copy() for field in first.fields or []]
        solver.solve(prepared, states, start=first.fields, tangent=False)
        same("H", states.grad_u, H, f"{state_text(H[0], p[0])}, after the solve")
        same("p", states.p, p, f"{state_text(H[0], p[0])}, after the solve")
        for field, before in zip(first.fields or [], kept, strict=True):
            if field is not None and before is not None:
                same("u of the start", field.u, before, states_text(states))

    def test_a_state_without_solution_is_a_row_with_a_status(
        self, solver: CellSolver, prepared: Any, responses: dict[str, Any]
    ) -> None:
        """det (I + H) < 0 turns the cell inside out; its row holds NaN, and those around it hold what they held."""
        H, p = STATES["compressed"]
        states = MacroState(np.stack([H, np.diag([0.0, -1.2, 0.0]), H]), np.array([p, 0.0, p]))
        solution = solver.solve(prepared, states, fields=True)
        response = solution.response
        status, state = Status(int(response.status[1])), state_text(states.grad_u[1])
        holds(not status.has_values, state, "a status without values", status.name)
        for holder in (response, response.tangent, response.extrema):
            for name, values in vars(holder).items() if holder is not None else ():
                if isinstance(values, np.ndarray) and name not in ("status", "doubt"):
                    lost = np.isnan(np.asarray(values[1], dtype=float)).all()
                    holds(lost, state, f"NaN for {name} of the failed row", values[1])
        for row in (0, 2):
            around = f"{state_label('compressed')} beside a failed row"
            self.assert_same(response[row : row + 1], responses["compressed"], around)
        if solution.fields is not None:
            found = [field is None for field in solution.fields]
            holds(found == [False, True, False], state, "no field for the failed row alone", found)

    def test_fields_are_returned_where_they_are_declared(self, solver: CellSolver, prepared: Any) -> None:
        """One for each row, on a domain whose mesh the core makes, and none where they are not asked for."""
        H, p = STATES["compressed"]
        self.needs(type(solver).returns_fields, "returns_fields = False: it returns no fields")
        state, states = state_label("compressed"), MacroState.single(H, p)
        found = require("fields", solver.solve(prepared, states, fields=True).fields, state)
        holds(len(found) == 1, state, "one field", len(found))
        field = require("the field of the row", found[0], state)
        same("H of the field", field.grad_u, H, state)
        same("p of the field", field.p, p, state)
        nodes = len(self.make_cell().make_mesh("solid", field.domain).points)  # type: ignore[arg-type]
        holds(field.u.shape == (nodes, 3), state, f"u of shape ({nodes}, 3)", field.u.shape)
        holds(solver.solve(prepared, states).fields is None, f"{state}, fields=False", "no fields", "fields")

    def test_a_start_changes_the_way_and_not_the_answer(self, solver: CellSolver, prepared: Any) -> None:
        near_by = solver.solve(prepared, MacroState.single(np.diag([0, -0.12, 0]), 0.1), fields=True)
        self.needs(near_by.fields is not None, "returns_fields = False: it returns no fields")
        target = MacroState.single(np.diag([0, -0.14, 0]), 0.1)
        warm = solver.solve(prepared, target, start=near_by.fields).response
        cold = solver.solve(prepared, target).response
        for name in RESPONSES:
            state = f"{states_text(target)}, from a neighbour and from the undeformed cell"
            near(name, getattr(warm, name), getattr(cold, name), state, within=1e-9)

    def test_unknown_options_are_refused(self, solver: CellSolver) -> None:
        with refused(
            ConfigurationError, TypeError, state=options({"no_such_option": 1}), naming=("no_such_option",)
        ):
            type(solver)(no_such_option=1)

    @classmethod
    def assert_near(
        cls, what: str, found: Any, expected: Any, state: str, share: float | None = None
    ) -> None:
        """Up to ``share`` of the largest entry, by default :attr:`same`."""
        size = max(float(np.abs(expected).max()), 1e-3)
        near(what, found, expected, state, within=(cls.same if share is None else share) * size)

    @classmethod
    def assert_same(cls, found: CellResponse, expected: CellResponse, state: str) -> None:
        """Up to :attr:`same` of the largest entry, derivatives included."""
        same("status", found.status, expected.status, state)
        for name in RESPONSES:
            cls.assert_near(name, getattr(found, name), getattr(expected, name), state)
        wanted, slopes = require("derivatives", expected.tangent, state), found.tangent
        for slope in fields(wanted):
            value = getattr(wanted, slope.name)
            if value is not None:
                got = getattr(require("derivatives", slopes, state), slope.name)
                cls.assert_near(f"tangent.{slope.name}", got, value, state, 100 * cls.same)


#: Half of a parameter's range, relative to its middle.
HALF_WIDTH = 0.1
#: Of differences by a parameter, relative to its range.
PARAMETER_STEP = 5e-3
#: State of the slopes: a diagonal one is solved on the eighth, where there is one.
STATE = "compressed"


class Members(CellSuite):
    """Part of :class:`porocore.testing.cell_checks.base.CellSolverSuite`."""

    @classmethod
    def make_family(cls) -> Cell:
        """The cell that is solved with ranges around some of its numbers: Poisson's ratio and the viscosity.

        A suite of cells that are no neo-Hookean solids gives ranges of its own.
        """
        cell = cls.make_cell()
        if not isinstance(cell.material, NeoHookean):
            pytest.skip("the solid of this cell is not one neo-Hookean material; give make_family")
        return cls.make_cell(
            material={"poisson_ratio": range_around(cell.material.poisson_ratio)},
            viscosity=range_around(cell.viscosity),
        )

    @pytest.fixture(scope="class")
    @classmethod
    def family(cls) -> Cell:
        return cls.make_family()

    @pytest.fixture(scope="class")
    @classmethod
    def member_response(cls, solver: CellSolver, family: Cell) -> CellResponse:
        """Response of the member at the middle of all ranges."""
        return solver.solve_one(solver.prepare(family.at(middle(family))), *STATES[STATE])

    def test_a_member_is_the_cell_with_its_numbers(self, solver: CellSolver) -> None:
        """Each member of a family that varies in its material answers as the cell with that number alone."""
        if not isinstance(self.make_cell().material, NeoHookean):
            pytest.skip("the solid of this cell is not one neo-Hookean material")
        family = self.make_cell(material={"poisson_ratio": {"range": [0.2, 0.4]}})
        plain = self.make_cell(material={"poisson_ratio": 0.25})
        one, other = (
            solver.solve_one(solver.prepare(cell), *STATES[STATE], tangent=False)
            for cell in (family.at({"poisson_ratio": 0.25}), plain)
        )
        state = f"{state_label(STATE)}, the member with Poisson's ratio 0.25"
        for name in RESPONSES:
            near(name, getattr(one, name), getattr(other, name), state, rel=1e-9, within=1e-12)

    def test_slopes_are_there_or_not_offered(
        self, solver: CellSolver, family: Cell, member_response: CellResponse, responses: dict[str, Any]
    ) -> None:
        """A solver whose ``slopes`` are true gives them by each parameter, in order; else it leaves them None.

        A cell without parameters has none.
        """
        state = f"{state_label(STATE)}, of a cell with the parameters {', '.join(p.name for p in family.parameters)}"
        offered = type(solver).slopes
        found = member_response.slopes
        holds(
            (found is not None) == offered, state, f"slopes {'' if offered else 'None'}", type(found).__name__
        )
        holds(responses[STATE].slopes is None, state_label(STATE), "no slopes without parameters", "slopes")
        if offered:
            fault = response_fault(member_response, 1, len(family.parameters))
            holds(not fault, state, "a right response", fault)
            for name in ("potential", "stress", "fluid_volume", "porosity"):
                require(f"slopes of {name}", getattr(found, name), state)

    def neighbours(self, solver: CellSolver, family: Cell) -> Iterator[tuple[int, str, float, list[Any]]]:
        """Yield number and name of each parameter, a step, and the prepared members at :data:`STEPS` times it."""
        self.needs(type(solver).slopes, "slopes = False: it solves members without slopes by the parameters")
        for k, parameter in enumerate(family.parameters):
            h = PARAMETER_STEP * (parameter.upper - parameter.lower)
            along = h * np.eye(len(family.parameters))[k]
            yield (
                k,
                parameter.name,
                h,
                [solver.prepare(family.at(middle(family) + s * along)) for s in STEPS],
            )

    def test_slopes_match_differences(
        self, solver: CellSolver, family: Cell, member_response: CellResponse
    ) -> None:
        """Central differences of fourth order between members, by each parameter."""
        slopes: Any = member_response.slopes
        for k, parameter, h, members in self.neighbours(solver, family):
            ends = [solver.solve_one(member, *STATES[STATE], tangent=False) for member in members]
            values = {name: [getattr(end, name)[0] for end in ends] for name in RESPONSES}
            if "piola" in type(solver).conductivities:
                values["conductivity"] = [solver.conductivity(member) for member in members]
            state = f"{state_label(STATE)}, by {parameter}"
            for name, of_members in values.items():
                found = getattr(slopes, name)
                if found is not None:
                    difference = central_difference(of_members, h)
                    matches_difference(f"slope of {name}", difference, found[0, ..., k], state)

    def test_slopes_of_the_hessian_at_rest(self, solver: CellSolver, family: Cell) -> None:
        """Central differences of the second derivatives of W between undeformed members, by each parameter."""
        self.needs(type(solver).slopes, "slopes = False: it solves members without slopes by the parameters")
        found = solver.hessian_slopes_at_rest(solver.prepare(family.at(middle(family))))
        m = len(family.parameters)
        holds(found.shape == (10, 10, m), "at rest", f"slopes of the Hessian (10, 10, {m})", found.shape)
        for k, parameter, h, members in self.neighbours(solver, family):
            tangents: list[Any] = [solver.solve_one(member, np.zeros((3, 3))).tangent for member in members]
            difference = central_difference([tangent.hessian[0] for tangent in tangents], h)
            matches_difference("slope of the Hessian", difference, found[..., k], f"at rest, by {parameter}")

    def test_slopes_of_a_state_without_values(self, solver: CellSolver, family: Cell) -> None:
        """They are NaN in a row that has a status only, so that rows stay of one kind."""
        self.needs(type(solver).slopes, "slopes = False: it solves members without slopes by the parameters")
        turned_inside_out = MacroState.single(np.diag([-2.0, 0.0, 0.0]))
        response = solver.solve(solver.prepare(family.at(middle(family))), turned_inside_out).response
        state = "H_11 = -2, which no cell bears"
        holds(
            not Status(int(response.status[0])).has_values,
            state,
            "a status without values",
            response.status[0],
        )
        slopes: Any = require("slopes", response.slopes, state)
        holds(bool(np.isnan(slopes.stress).all()), state, "slopes of NaN", slopes.stress)


def range_around(value: float) -> dict[str, list[float]]:
    """Return the range around a number, as in a configuration."""
    return {"range": [value * (1 - HALF_WIDTH), value * (1 + HALF_WIDTH)]}


def middle(family: Cell) -> Array:
    """Return the middles of all ranges, (m,)."""
    return np.array([(parameter.lower + parameter.upper) / 2 for parameter in family.parameters])


ROTATION = Rotation.from_rotvec([0.3, -0.5, 0.7]).as_matrix()
#: The sheared state and its pressure after a rotation.
TURNED = ROTATION @ (np.eye(3) + STATES["sheared"][0]) - np.eye(3), STATES["sheared"][1]


class CellSolverSuite(ExactCells, Calls, Members, RelaxingCells):
    """Subclass it, name the class ``Test…`` give it ``make_solver``, and ``make_cell`` if it solves some cells only.

    What the solver's class does not offer (``conductivities``, ``slopes``, ``relaxes``, ``accuracy`` …) is skipped.
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


#: Images by the seed of their noise, minimal surfaces by their name.
OPEN_CELLS = (0, 3, "gyroid", "diamond")


def noise(seed: int, voxels: int, smoothing: float) -> npt.NDArray[np.uint8]:
    """Return an image of smoothed periodic noise: 1 in the pores, which are half of it, and 0 in the solid."""
    from scipy.ndimage import gaussian_filter  # slow to import

    values = np.random.default_rng(seed).normal(size=(voxels,) * 3)
    smooth = gaussian_filter(values, smoothing, mode="wrap")
    return np.asarray(smooth < np.median(smooth), dtype=np.uint8)


def image_cell(
    path: Path, seed: int, voxels: int, repeat: Literal["periodic", "mirror"] = "periodic"
) -> Voxels:
    """Write an image of noise that is smoothed over an eighth of its edge, and return it as a cell or as its eighth."""
    np.save(path, noise(seed, voxels, voxels / 8))
    return Voxels(kind="voxels", path=str(path), pore=1, repeat=repeat)


class OpenCells(CellSuite):
    """Part of :class:`porocore.testing.cell_checks.base.MeshedCellSuite`."""

    @pytest.mark.parametrize("which", OPEN_CELLS)
    def test_a_strain_of_one_percent_is_no_overlap(
        self, solver: CellSolver, which: int | str, tmp_path: Path
    ) -> None:
        """Whatever the mesh at the wall and at the faces of the cell looks like."""
        geometry: Geometry
        if isinstance(which, int):
            geometry = image_cell(tmp_path / "image.npy", which, 16)
        else:
            geometry = TriplyPeriodic.model_validate({"kind": "tpms", "surface": which, "level": 0})
        prepared = solver.prepare(self.make_cell(geometry=geometry))
        H = -0.01 * np.diag([1.0, 0.0, 0.0])
        status = Status(int(solver.solve_one(prepared, H, tangent=False).status[0]))
        state = f"{geometry.description}, {state_text(H)}"
        holds(status.has_values, state, "the status converged or contact", status.name)


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
