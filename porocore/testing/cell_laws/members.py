"""Laws of cells with parameters: members are cells of their own; slopes are theirs, or are not offered."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.cell.cell import Cell
from porocore.cell.materials.neo_hookean import NeoHookean
from porocore.core.fields.check import response_fault
from porocore.interfaces.cell import CellSolver
from porocore.states import Array, CellResponse, MacroState, Status
from porocore.testing.cell_laws.identities import STEPS, WEIGHTS
from porocore.testing.cell_laws.suite import RESPONSES, STATES, CellSuite, matches_difference, state_label
from porocore.testing.expect import holds, near, require

#: Half of a parameter's range, relative to its middle.
HALF_WIDTH = 0.1
#: Of differences by a parameter, relative to its range.
STEP = 5e-3
#: State of the slopes: a diagonal one is solved on the eighth, where there is one.
STATE = "compressed"


class Members(CellSuite):
    """Part of :class:`porocore.testing.cell_laws.base.CellSolverSuite`."""

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

    def test_slopes_match_differences(
        self, solver: CellSolver, family: Cell, member_response: CellResponse
    ) -> None:
        """Central differences of fourth order between members, by each parameter."""
        self.needs(type(solver).slopes, "slopes = False: it solves members without slopes by the parameters")
        slopes: Any = member_response.slopes
        for k, parameter in enumerate(family.parameters):
            h = STEP * (parameter.upper - parameter.lower)
            members = [family.at(middle(family) + s * h * np.eye(len(family.parameters))[k]) for s in STEPS]
            ends = [
                solver.solve_one(solver.prepare(member), *STATES[STATE], tangent=False) for member in members
            ]
            state = f"{state_label(STATE)}, by {parameter.name}"
            values = {name: [getattr(end, name)[0] for end in ends] for name in RESPONSES}
            if "piola" in type(solver).conductivities:
                values["conductivity"] = [solver.conductivity(solver.prepare(member)) for member in members]
            for name, of_members in values.items():
                found = getattr(slopes, name)
                if found is not None:
                    difference: Any = sum(w * x for w, x in zip(WEIGHTS, of_members, strict=True)) / h
                    matches_difference(f"slope of {name}", difference, found[0, ..., k], state)

    def test_slopes_of_the_hessian_at_rest(self, solver: CellSolver, family: Cell) -> None:
        """Central differences of the second derivatives of W between undeformed members, by each parameter."""
        self.needs(type(solver).slopes, "slopes = False: it solves members without slopes by the parameters")
        found = solver.hessian_slopes_at_rest(solver.prepare(family.at(middle(family))))
        m = len(family.parameters)
        holds(found.shape == (10, 10, m), "at rest", f"slopes of the Hessian (10, 10, {m})", found.shape)
        for k, parameter in enumerate(family.parameters):
            h = STEP * (parameter.upper - parameter.lower)
            members = [family.at(middle(family) + s * h * np.eye(m)[k]) for s in STEPS]
            tangents: list[Any] = [
                solver.solve_one(solver.prepare(member), np.zeros((3, 3))).tangent for member in members
            ]
            hessians = [tangent.hessian[0] for tangent in tangents]
            difference: Any = sum(w * x for w, x in zip(WEIGHTS, hessians, strict=True)) / h
            matches_difference(
                "slope of the Hessian", difference, found[..., k], f"at rest, by {parameter.name}"
            )

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
