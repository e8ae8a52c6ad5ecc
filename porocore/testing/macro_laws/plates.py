"""Laws of rigid plates: a face that moves as one under a given force."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.macro.problem import MacroProblem
from porocore.testing.expect import holds, near, refused, same
from porocore.testing.macro_laws.solving import LINEAR, NONLINEAR, SHORT, Solving
from porocore.testing.synthetic.response import confined_column

#: Symmetry planes on three sides; the face x+ is drained, and free.
PLANES: dict[str, Any] = {
    "x-": {"displacement": (0, None, None)},
    "y-": {"displacement": (None, 0, None)},
    "z-": {"displacement": (None, None, 0)},
    "z+": {"displacement": (None, None, 0)},
    "x+": {"pressure": 0},
}


def squeezed(top: dict[str, Any], load: float = -0.05, **settings: Any) -> MacroProblem:
    """A block of 2 × 1 × 0.5 that drains to one side while something is done to its top."""
    data = {
        "body": {"size": (2, 1, 0.5), "elements": (3, 2, 1)},
        "boundary": {**PLANES, "y+": top},
        "time": SHORT,
    }
    return MacroProblem.model_validate(data | {"load": load} | settings)


class Plates(Solving):
    """Part of :class:`porocore.testing.macro_laws.base.MacroSolverSuite`."""

    @pytest.mark.parametrize("law", [LINEAR, NONLINEAR], ids=["linear", "nonlinear"])
    def test_a_plate_moves_as_one_and_bears_its_force(self, law: Any) -> None:
        """Newton's iteration, and the weak form: δu_2 = y is a motion of the plate, so ∫ P_22 dV = force × height."""
        solution = self.solve(squeezed({"plate": 1}, newton={"tolerance": 1e-11}), law)
        top = solution.points[:, 1] == 1
        for profile in solution.after_rest:
            state = f"a plate on a block that drains to one side, t = {profile.time:g}"
            same("the spread of u_2 under the plate", np.ptp(profile.u[top, 1]), 0.0, state)
            slides = np.ptp(profile.u[top, 0])
            holds(slides > 1e-3, state, "a spread of u_1 under the plate above 1e-3", slides)
            near("the mean of P_E,22", profile.stress[:, 1, 1].mean(), -0.05, state, rel=1e-9)
        # While the drained side softens, the middle takes over: the stress beneath is not uniform.
        state, spread = (
            "a plate on a block that drains to one side",
            np.ptp(solution.after_rest[0].stress[:, 1, 1]),
        )
        holds(spread > 0.1 * 0.05, state, "a spread of P_E,22 above a tenth of its mean", spread)
        same("settlement", solution.history.settlement[-1], -solution.profiles[-1].u[top, 1][0], state)

    def test_a_pushed_plate_is_a_face_moved_by_as_much(self) -> None:
        """The steady states are the same, up to what is left of the pressure."""
        plan = SHORT | {"end": 400.0, "step": 20.0}
        pushed = self.solve(squeezed({"plate": 1}, time=plan), NONLINEAR)
        by = float(pushed.history.settlement[-1])
        moved = self.solve(squeezed({"displacement": (None, 1, None)}, load=-by, time=plan), NONLINEAR)
        state = "the steady states of a pushed plate and of a face moved by as much"
        near("p", pushed.profiles[-1].p, 0.0, state, within=1e-6)
        near("u", moved.profiles[-1].u, pushed.profiles[-1].u, state, within=1e-5 * by)

    def test_on_a_column_a_plate_is_a_traction(self) -> None:
        by_traction = confined_column(4, load=-0.1, time=SHORT)
        faces: Any = dict(by_traction.model_dump()["boundary"])
        faces["y+"] = {"plate": 0.01, "pressure": 0}  # the cross-section is 0.01
        by_plate = confined_column(4, load=-0.1, time=SHORT, boundary=faces)
        one, other = self.solve(by_traction, NONLINEAR), self.solve(by_plate, NONLINEAR)
        state, a, b = "a column under a plate, against a traction", one.history, other.history
        near("settlement", b.settlement, a.settlement, state, rel=1e-8)
        near("drained", b.drained, a.drained, state, rel=1e-7, within=1e-15)

    def test_a_plate_whose_edge_is_held_is_refused(self) -> None:
        faces = {**PLANES, "x-": {"displacement": (0, 0, None)}}
        state = "a plate on y+ whose edge x- holds u_2"
        with refused(ConfigurationError, state=state, naming=("boundary.y+", "plate", "u_2")):
            self.prepare(squeezed({"plate": 1}, boundary={**faces, "y+": {"plate": 1}}))
