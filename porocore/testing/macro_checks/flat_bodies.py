"""Checks on bodies in two dimensions: revolutions in their meridian, and plane strain."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from porocore.macro.body.mesh import Facets
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.testing.expect import holds, near
from porocore.testing.macro_checks.runs import LINEAR, NONLINEAR, SHORT, Solving

#: A thick tube and a plate with graded elements.
SHAPES: dict[str, dict[str, Any]] = {
    "axisymmetric": {
        "kind": "axisymmetric",
        "radius": 2.0,
        "inner_radius": 0.8,
        "height": 1.0,
        "elements": (2, 2),
        "grading": (2, 1),
    },
    "plane-strain": {
        "kind": "plane-strain",
        "size": (1.2, 1.0),
        "depth": 0.7,
        "elements": (2, 2),
        "grading": (2, 1),
    },
}
#: Side of each that drains.
OUTER = {"axisymmetric": "side", "plane-strain": "x+"}
#: Until no pressure is left.
LONG = SHORT | {"end": 4e5, "step": 1e5, "profiles": ()}


class FlatBodies(Solving):
    """Part of :class:`porocore.testing.macro_checks.states.MacroSolverSuite`."""

    @pytest.fixture(params=list(SHAPES))
    def flat(self, request: Any) -> str:
        """The kinds of bodies in two dimensions."""
        kind: str = request.param
        return kind

    def test_the_hoop_of_a_tube_is_stretched_with_its_radius(self) -> None:
        """u_r = a r and u_y = b y at finite strain, drained: H = diag(a, b, a), and forces are stresses by areas."""
        a, b, free = 0.04, -0.06, {"pressure": 0}
        boundary = {
            "inner": {"displacement": (0.8 * a, None, None), **free},
            "side": {"displacement": (2 * a, None, None), **free},
            "y-": {"normal": 0, **free},
            "y+": {"displacement": (None, b, None), **free},
        }
        data = {
            "body": SHAPES["axisymmetric"],
            "boundary": boundary,
            "time": LONG,
            "newton": {"tolerance": 1e-11},
        }
        solution = self.solve(MacroProblem.model_validate(data), NONLINEAR)
        last, state = solution.profiles[-1], "a tube with u_r = 0.04 r and u_y = −0.06 y, drained"
        exact = self.within(1e-9)
        near("H", last.grad_u, np.diag([a, b, a]), state, within=exact)
        P = last.stress.mean(axis=0)
        near("P_E,33, as P_E,11", P[2, 2], P[0, 0], state, rel=1e-7)
        area = np.pi * (4 - 0.64)
        near("the force on y+", solution.reactions["y+"][-1, 1], area * P[1, 1], state, rel=self.within(1e-7))
        radial = 2 * np.pi * 2 * P[0, 0]
        near(
            "the radial force on side",
            solution.reactions["side"][-1, 0],
            radial,
            state,
            rel=self.within(1e-7),
        )
        holds(P[0, 0] > 1e-3, state, "P_E,11 above 1e-3", P[0, 0])

    def test_the_tangent_is_the_derivative_of_the_residual_in_two_dimensions(self, flat: str) -> None:
        """A pressure follows, and the state has no symmetry."""
        outer = OUTER[flat]
        boundary = {"y-": {"displacement": (0, 0, None)}, outer: {"follower": 0.3, "pressure": 0}}
        data = {"body": SHAPES[flat], "boundary": boundary, "time": SHORT, "load": 1.0}
        d = self.discretise(MacroProblem.model_validate(data))
        system, slope, direction = self.tangent_and_slope(d, 0.5)
        found = d.solve(system, slope, direction[d.prescribed])
        state = f"random unknowns of the body '{flat}', along a random direction"
        near(
            "what the tangent makes of the slope", found, direction, state, within=2e-5 * abs(direction).max()
        )

    def test_a_pressure_all_around_follows_a_surface_of_revolution(self) -> None:
        """Fluid pressure alone around a solid drum: P = −p J F⁻ᵀ, the same everywhere."""
        body = SHAPES["axisymmetric"] | {"inner_radius": 0.0}
        around = {"follower": 0.02, "pressure": 0}
        data = {
            "body": body,
            "boundary": {"y-": {"normal": 0}, "y+": around, "side": around},
            "time": LONG,
            "newton": {"tolerance": 1e-11},
        }
        solution = self.solve(MacroProblem.model_validate(data), NONLINEAR)
        F = np.eye(3) + solution.profiles[-1].grad_u
        expected = -0.02 * np.linalg.det(F)[:, None, None] * np.linalg.inv(F).swapaxes(1, 2)
        state, exact = "a drum under p = 0.02 all around, drained", self.within(1e-8)
        near("P = −p J F⁻ᵀ", solution.profiles[-1].stress, expected, state, within=exact)
        near("F, as much along radius, axis and hoop,", F, F[0, 0, 0] * np.eye(3), state, within=exact)
        holds(0.9 < F[0, 0, 0] < 0.99, state, "F_11 from 0.9 to 0.99", F[0, 0, 0])
        force = 0.02 * np.pi * (2 * F[0, 0, 0]) ** 2
        near("the force on y-", solution.reactions["y-"][-1, 1], force, state, rel=self.within(1e-7))

    def test_forces_and_volumes_are_those_of_the_whole_revolution_or_depth(self, flat: str) -> None:
        """Body force, traction, and what drains, against areas and volumes in closed form."""
        outer = OUTER[flat]
        data = {
            "body": SHAPES[flat],
            "boundary": {
                "y-": {"displacement": (0, 0, None)},
                "y+": {"traction": (0, -0.01, 0)},
                outer: {"pressure": 0},
            },
            "body_force": (0, -0.02, 0),
            "time": SHORT,
            "load": 1.0,
        }
        problem = MacroProblem.model_validate(data)
        solution, mesh = self.solve(problem, LINEAR), body_mesh(problem)
        area = np.pi * (4 - 0.64) if flat == "axisymmetric" else 1.2 * 0.7
        state = f"the body '{flat}' with a traction and a body force"
        near("the area of y+", Facets(mesh, mesh.surfaces["y+"]).areas.sum(), area, state, rel=1e-12)
        near("the volume", mesh.weights.sum(), area, state, rel=1e-12)
        near("the reaction of y-", solution.reactions["y-"][-1, 1], 0.03 * area, state, rel=self.within(1e-9))
        entered = (np.diff(solution.history.time) * solution.inflow[outer][1:]).sum()
        near("drained", solution.history.drained[-1], -entered, state, rel=self.within(1e-9))
        holds(solution.history.drained[-1] > 1e-4, state, "drained above 1e-4", solution.history.drained[-1])

    def test_plane_strain_is_a_layer_of_bricks(self) -> None:
        """One layer of three-dimensional elements that nothing moves along z."""
        plate = SHAPES["plane-strain"]
        boundary = {
            "x-": {"normal": 0},
            "y-": {"displacement": (0, 0, None)},
            "x+": {"pressure": 0, "traction": (0.01, 0.005, 0)},
            "y+": {"follower": 0.03},
        }
        more = {"time": SHORT | {"end": 1.0}, "newton": {"tolerance": 1e-11}}
        brick = {"size": (1.2, 1.0, 0.7), "elements": (2, 2, 1), "grading": (2, 1, 1)}
        sides = {"z-": {"normal": 0}, "z+": {"normal": 0}}
        found, layer = (
            self.solve(MacroProblem.model_validate({"body": body, "boundary": held, **more}), NONLINEAR)
            for body, held in ((plate, boundary), (brick, boundary | sides))
        )
        state, exact = "plane strain, against a layer of bricks", self.within(1e-10)
        near("P_E", found.profiles[-1].stress, layer.profiles[-1].stress, state, within=exact)
        near("the reaction of y-", found.reactions["y-"], layer.reactions["y-"], state, within=exact)
        near("settlement", found.history.settlement, layer.history.settlement, state, within=exact)
        near("drained", found.history.drained, layer.history.drained, state, within=exact)
        holds(
            abs(found.profiles[-1].stress[:, 2, 2]).max() > 1e-3,
            state,
            "P_E,33 above 1e-3",
            found.profiles[-1],
        )
