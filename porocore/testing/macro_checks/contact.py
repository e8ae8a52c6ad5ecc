"""Checks on the contact of rigid indenters: tangent, known states, balance, turned problems."""

from __future__ import annotations

from typing import Any

import pytest

from porocore.macro.problem import MacroProblem
from porocore.testing.expect import holds, near
from porocore.testing.macro_checks.runs import LINEAR, NONLINEAR, SHORT, Solving

PLANES = {"x-": {"normal": 0}, "y-": {"normal": 0}, "z-": {"normal": 0}}
SPHERE: dict[str, Any] = {"shape": {"kind": "sphere", "radius": 0.8}, "place": (0, 1, 0), "surfaces": ["y+"]}
PLATEN: dict[str, Any] = {"shape": {"kind": "plane"}, "place": (0, 1, 0), "surfaces": ["y+"]}
RAMP = SHORT | {"ramp_increments": 4, "ramp_step": 0.1}


def pressed(indenter: dict[str, Any], **settings: Any) -> MacroProblem:
    """An eighth of a block, or what ``settings`` make of it, under an indenter."""
    data: dict[str, Any] = {
        "body": {"kind": "box", "size": (1, 1, 1), "elements": (3, 2, 3), "grading": (2, 0.5, 2)},
        "boundary": PLANES,
        "time": RAMP,
        "contact": {"indenter": indenter},
    }
    return MacroProblem.model_validate(data | settings)


class Contacts(Solving):
    """Part of :class:`porocore.testing.macro_checks.states.MacroSolverSuite`."""

    def test_the_tangent_knows_contact_and_its_drainage(self) -> None:
        """The state has no symmetry, and a part of the surface is touched."""
        indenter = SPHERE | {"displacement": 0.1, "under": "sealed", "outside": "drained"}
        body = {"kind": "box", "size": (1, 1, 1), "elements": (2, 2, 2)}
        d = self.discretise(pressed(indenter, body=body, boundary={"y-": {"displacement": (0, 0, 0)}}))
        system, slope, direction = self.tangent_and_slope(d, 1.0)
        found = d.solve(system, slope, direction[d.prescribed])
        state = "random unknowns of a block under a sphere, along a random direction"
        near(
            "what the tangent makes of the slope", found, direction, state, within=2e-5 * abs(direction).max()
        )

    @pytest.mark.parametrize("law", [LINEAR, NONLINEAR], ids=["linear", "nonlinear"])
    def test_a_plane_on_a_whole_face_moves_it(self, law: Any) -> None:
        """The body is that under a prescribed displacement, up to the penetration, which the run tells."""
        sides: Any = {name: {"normal": 0} for name in ("x-", "x+", "z-", "z+", "y-")}
        drained = {"y-": {"normal": 0, "pressure": 0}}
        body = {"kind": "box", "size": (1, 1, 1), "elements": (1, 4, 1)}
        shared: Any = {"body": body, "contact": {}}
        faces = sides | drained | {"y+": {"displacement": (None, 1, None)}}
        moved = self.solve(pressed({}, **shared, boundary=faces, load=-0.1), law)
        platen = PLATEN | {"displacement": 0.1, "penalty": 1e5}
        touched = self.solve(pressed(platen, body=body, boundary=sides | drained), law)
        state, series = "a plane on the top of a column, against a moved top", touched.contact["indenter"]
        depth = float(series[-1, 5])
        holds(0 < depth < 1e-4 * 0.1, state, "a penetration below 1e-4 of the displacement", depth)
        near("u", touched.profiles[-1].u, moved.profiles[-1].u, state, within=2 * depth)
        near("the force", series[:, 0], -moved.reactions["y+"][:, 1], state, rel=1e-4, within=1e-12)
        near("the area", series[1:, 2], 1.0, state, rel=1e-9)
        near("the displacement", series[-1, 1], 0.1, state, rel=1e-12)

    def test_contact_forces_balance_those_of_the_support(self) -> None:
        indenter = SPHERE | {"displacement": 0.05, "under": "drained", "outside": "drained"}
        found = self.solve(pressed(indenter, newton={"tolerance": 1e-12}), LINEAR)
        force, state = found.contact["indenter"][:, 0], "a sphere on a block"
        holds(float(force[-1]) > 1e-4, state, "a force above 1e-4", force[-1])
        near("the force of the support", found.reactions["y-"][:, 1], force, state, rel=1e-10, within=1e-14)

    @pytest.mark.parametrize("law", [LINEAR, NONLINEAR], ids=["linear", "nonlinear"])
    def test_a_force_and_the_displacement_that_it_makes_are_one_state(self, law: Any) -> None:
        """The force of a run by displacement is prescribed, step by step."""
        settings: Any = {"newton": {"tolerance": 1e-12}}
        shared = SPHERE | {"under": "sealed", "outside": "drained"}
        moved = self.solve(pressed(shared | {"displacement": 0.05}, **settings), law)
        series = moved.contact["indenter"]
        table = list(zip(moved.history.time.tolist(), series[:, 0].tolist(), strict=True))
        pushed = self.solve(pressed(shared | {"force": {"table": table}}, **settings), law)
        state = "a sphere that is pushed by the force of one that is moved"
        for i, name in enumerate(("force", "displacement", "area", "radius", "largest pressure")):
            values, wanted = pushed.contact["indenter"][1:, i], series[1:, i]
            near(f"the {name}", values, wanted, state, within=1e-8 * abs(wanted).max())
        u = moved.profiles[-1].u
        near("u", pushed.profiles[-1].u, u, state, within=1e-8 * abs(u).max())

    def test_a_turned_indentation_is_the_same(self) -> None:
        """About the diagonal, x → y → z → x, of a problem without symmetry in these axes."""
        indenter = {"shape": {"kind": "cone", "angle": 60, "radius": 0.2}, "displacement": 0.05}
        body = {"kind": "box", "size": (1.2, 1, 0.8), "elements": (3, 2, 2)}
        one = pressed(
            indenter | {"place": (0.3, 1, 0.2), "direction": (0, -1, 0), "surfaces": ["y+"]},
            body=body,
            boundary=PLANES | {"x+": {"pressure": 0}},
        )
        turned = {"kind": "box", "size": (0.8, 1.2, 1), "elements": (2, 3, 2)}
        other = pressed(
            indenter | {"place": (0.2, 0.3, 1), "direction": (0, 0, -1), "surfaces": ["z+"]},
            body=turned,
            boundary=PLANES | {"y+": {"pressure": 0}},
        )
        a, b = (self.solve(each, LINEAR) for each in (one, other))
        state = "a cone on a block, and both turned about a diagonal"
        series = a.contact["indenter"]
        near("contact", b.contact["indenter"], series, state, rel=1e-6, within=1e-9 * abs(series).max())
        near("the largest pressure", b.history.pressure_max, a.history.pressure_max, state, rel=1e-6)
