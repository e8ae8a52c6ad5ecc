"""Checks on bodies of any shape: meshes, oblique planes, followers, reactions, rigid plates."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from porocore.errors import ConfigurationError
from porocore.macro.body.kinds import Box, make_body
from porocore.macro.body.mesh import Facets
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.testing.expect import holds, near, refused, same
from porocore.testing.macro_checks.runs import C22, HELD, LINEAR, NONLINEAR, SHORT, SIDES, Solving
from porocore.testing.synthetic.response import confined_column

#: A cube's corners numbered as bits xyz, cut into six tetrahedra about its diagonal; neighbours match.
KUHN = ((0, 1, 3, 7), (0, 3, 2, 7), (0, 2, 6, 7), (0, 6, 4, 7), (0, 4, 5, 7), (0, 5, 1, 7))


def write_tetrahedra(path: Path, box: Box, bend: float = 0.0, turn: Any = None) -> None:
    """Write a box of linear tetrahedra with its six faces by name, in gmsh's format.

    Inner nodes are moved by ``bend``, and the whole is rotated by ``turn`` (3, 3).
    """
    import meshio

    mesh = make_body(box)
    points = mesh.points[mesh.p_nodes]
    bits = mesh.p_cells[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    tetrahedra = np.concatenate([bits[:, list(kuhn)] for kuhn in KUHN])
    tetrahedra = np.where(
        (np.linalg.det(points[tetrahedra[:, 1:]] - points[tetrahedra[:, :1]]) < 0)[:, None],
        tetrahedra[:, [0, 2, 1, 3]],
        tetrahedra,
    )
    size = np.array(box.size)
    inner = ((points > 1e-9) & (points < size - 1e-9)).all(axis=1)
    triangles = tetrahedra[:, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]].reshape(-1, 3)
    blocks, tags, names = [("tetra", tetrahedra)], [np.full(len(tetrahedra), 7)], {"body": [7, 3]}
    for axis, letter in enumerate("xyz"):
        for side, place in (("-", 0.0), ("+", size[axis])):
            on = (np.abs(points[triangles][..., axis] - place) < 1e-9).all(axis=1)
            tag = 10 + 2 * axis + (side == "+")
            blocks.append(("triangle", triangles[on]))
            tags.append(np.full(int(on.sum()), tag))
            names[letter + side] = [tag, 2]
    points = points + bend * inner[:, None] * np.sin(7 * points[:, [1, 2, 0]] + 1)
    points = points if turn is None else points @ np.transpose(turn)
    meshio.write(
        path,
        meshio.Mesh(
            points,
            blocks,
            cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
            field_data={name: np.array(value) for name, value in names.items()},
        ),
        file_format="gmsh22",
    )


def make(kind: str, folder: Path) -> dict[str, Any]:
    """Return the settings of a small body of a kind."""
    if kind == "tetrahedra":
        write_tetrahedra(folder / "box.msh", Box(size=(1, 1.2, 0.8), elements=(2, 2, 2)), bend=0.05)
        return {"kind": "file", "path": str(folder / "box.msh")}
    angle = {"angle": 60} if kind == "wedge" else {}
    return {"kind": kind, "radius": 1.0, "height": 0.7, "elements": (1, 2, 1), **angle}


ROLLERS: dict[str, Any] = {name: {"normal": 0} for name in ("x-", "y-", "z-")}


class Bodies(Solving):
    """Part of :class:`porocore.testing.macro_checks.states.MacroSolverSuite`."""

    @pytest.fixture(params=["quarter-cylinder", "wedge", "tetrahedra"])
    def body(self, request: Any, tmp_path: Path) -> dict[str, Any]:
        """Curved hexahedra, an oblique plane, and tetrahedra from a file."""
        return make(request.param, tmp_path)

    @pytest.fixture(params=["wedge", "tetrahedra"])
    def either(self, request: Any, tmp_path: Path) -> dict[str, Any]:
        """One of each kind of element."""
        return make(request.param, tmp_path)

    def problem(self, body: dict[str, Any], **settings: Any) -> MacroProblem:
        """Held by its planes, drained on top."""
        planes = {"quarter-cylinder": ("x-", "z-"), "wedge": ("oblique", "z-"), "file": ("x-", "z-")}[
            body["kind"]
        ]
        boundary: dict[str, Any] = {name: {"normal": 0} for name in (*planes, "y-")}
        boundary["y+"] = {"pressure": 0}
        for name, more in settings.pop("boundary", {}).items():
            boundary[name] = boundary.get(name, {}) | more
        data = {"body": body, "boundary": boundary, "time": SHORT, "load": 1.0}
        return MacroProblem.model_validate(data | settings)

    def test_the_tangent_is_the_derivative_of_the_residual_on_any_body(self, body: Any) -> None:
        """Followers included, at a state without any symmetry."""
        d = self.discretise(self.problem(body, boundary={"y+": {"follower": 0.3}}))
        system, slope, direction = self.tangent_and_slope(d, 0.5)
        found = d.solve(system, slope, direction[d.prescribed])
        state = f"random unknowns of the body '{body['kind']}', along a random direction"
        near(
            "what the tangent makes of the slope", found, direction, state, within=2e-5 * abs(direction).max()
        )

    def test_fields_of_first_order_are_exact_on_any_body(self, body: Any) -> None:
        d = self.discretise(self.problem(body))
        mesh, rng = d.mesh, np.random.default_rng(2)
        A, g = rng.standard_normal((3, 3)), rng.standard_normal(3)
        p = 0.3 + mesh.points[mesh.p_nodes] @ g
        states, grad_p = d.states(d.from_mesh(np.concatenate([(mesh.points @ A.T).ravel(), p])))
        state = f"a linear displacement and pressure on the body '{body['kind']}'"
        near("H", states.grad_u, A, state, within=1e-11, rel=1e-7)
        if mesh.straight:  # on curved elements the pressure is linear in the reference coordinates only
            near("grad_p", grad_p, g, state, within=1e-11, rel=1e-7)

    def test_a_pressure_all_around_follows_the_surface(self, either: Any) -> None:
        """A drained body under fluid pressure alone: P = −p J F⁻ᵀ everywhere, homogeneous, whatever the shape."""
        free = {"wedge": ("y+", "side"), "file": ("x+", "y+", "z+")}
        faces = {name: {"follower": 0.02, "pressure": 0} for name in free[either["kind"]]}
        problem = self.problem(either, boundary=faces, time=SHORT | {"end": 400.0, "step": 50.0})
        profile = self.solve(problem, NONLINEAR).profiles[-1]
        F = np.eye(3) + profile.grad_u
        expected = -0.02 * np.linalg.det(F)[:, None, None] * np.linalg.inv(F).swapaxes(1, 2)
        state, exact = f"the body '{either['kind']}' under p = 0.02 all around, drained", self.within(1e-8)
        near("p", profile.p, 0.0, state, within=self.within(1e-10))
        near("P = −p J F⁻ᵀ", profile.stress, expected, state, within=exact, rel=1e-7)
        near("F, the same everywhere,", F, F[0], state, within=exact, rel=1e-7)
        near("diag F", np.diag(F[0]), F[0, 0, 0], state, within=exact)
        holds(0.9 < F[0, 0, 0] < 0.99, state, "F_11 from 0.9 to 0.99", F[0, 0, 0])

    def test_reactions_balance_the_loads(self, either: Any) -> None:
        """Body force, traction on a patch and a course: what holds the body bears them all."""
        problem = self.problem(
            either,
            surfaces={"patch": {"of": "y+", "x": (0, 0.6)}},
            boundary={
                "patch": {"traction": (0, -0.01, 0.002)},
                "y+": {"pressure": {"ramp": 1e-3, "until": 2.0}},
            },
            body_force=(0, {"table": [[0, 0], [3, -0.02]]}, 0),
        )
        solution, mesh = self.solve(problem, LINEAR), body_mesh(problem)
        areas = {name: float(Facets(mesh, mesh.surfaces[name]).areas.sum()) for name in ("patch", "y+")}
        whole = {"wedge": np.pi / 6, "file": 0.8}[either["kind"]]
        state = f"the body '{either['kind']}' with a traction on a patch and a body force"
        near("the area of patch and y+", sum(areas.values()), whole, state, rel=2e-3)
        t = solution.history.time
        volume = float(mesh.weights.sum())
        down = -0.01 * areas["patch"] * np.minimum(1, t / 0.2) - 0.02 * volume * np.minimum(1, t / 3)
        found = solution.reactions["y-"][:, 1]
        near("the reaction of y-", found[1:], -down[1:], state, rel=self.within(1e-9))
        entered = (np.diff(t) * solution.inflow["y+"][1:]).sum()
        near("drained", solution.history.drained[-1], -entered, state, rel=self.within(1e-9))
        holds(set(solution.inflow) == {"y+"}, state, "an inflow of y+ alone", sorted(solution.inflow))

    def test_probes_say_what_the_fields_say(self, either: Any) -> None:
        """A probe is exact at a node, and between nodes for a linear field."""
        self.needs_core_mesh()
        mesh = body_mesh(self.problem(either))
        node = int(np.argmax(mesh.points @ np.array([0.3, 1.0, 0.2])))
        problem = self.problem(
            either,
            boundary={"y+": {"displacement": (None, -0.02, None)}},
            probes={"corner": tuple(map(float, mesh.points[node])), "inside": (0.31, 0.2, 0.05)},
        )
        solution = self.solve(problem, LINEAR)
        last = solution.profiles[-1]
        state, inside = f"the body '{either['kind']}', pushed down by 0.02", solution.probes["inside"]
        near(
            "the probe at a node",
            solution.probes["corner"][-1],
            [*last.u[node], last.p[node]],
            state,
            within=1e-13,
        )
        shape, wanted = inside.shape, (len(solution.history.time), 4)
        holds(shape == wanted, state, f"a probe of shape {wanted}", f"shape {shape}")
        holds(-0.02 < inside[-1, 1] < 0, state, "u_2 of the probe inside from -0.02 to 0", inside[-1, 1])

    def test_a_probe_outside_is_refused(self, tmp_path: Path) -> None:
        problem = self.problem(make("wedge", tmp_path), probes={"far": (9, 0, 0)})
        state = "a probe 'far' at (9, 0, 0), outside"
        with refused(ConfigurationError, state=state, naming=("far", "outside")):
            self.solve(problem, LINEAR)

    def test_an_initial_state_is_where_it_begins(self) -> None:
        """Uniform pressure in a sealed and held body stays as it is."""
        held = {name: {"displacement": (0, 0, 0)} for name in ("x-", "x+", "y-", "y+", "z-", "z+")}
        body = {"size": (1, 1, 1), "elements": (1, 1, 1)}
        data = {"body": body, "boundary": held, "time": SHORT, "initial": {"pressure": 0.01}}
        solution = self.solve(MacroProblem.model_validate(data), LINEAR)
        state = "a sealed and held box with an initial pressure"
        near("pressure_max", solution.history.pressure_max, 0.01, state, rel=1e-12)
        near("p", solution.profiles[-1].p, 0.01, state, rel=1e-12)

    def test_an_initial_strain_presses_no_fluid_out(self) -> None:
        """Storage is counted from it, stress from H = 0: where it is held, nothing happens."""
        strain, settled = -0.02, {"table": [[0, -0.04], [6, -0.04]]}
        boundary = {**SIDES, "y-": HELD, "y+": {"displacement": (None, settled, None)}}
        data = {
            "body": {"size": (1, 2, 1), "elements": (1, 2, 1)},
            "boundary": boundary,
            "time": SHORT,
            "initial": {"gradient": ((0, 0, 0), (0, strain, 0), (0, 0, 0))},
        }
        solution = self.solve(MacroProblem.model_validate(data), LINEAR)
        state, last = "a held column with an initial strain", solution.profiles[-1]
        near("settlement", solution.history.settlement, 0.04, state, rel=1e-12)
        near("pressure_max", solution.history.pressure_max, 0.0, state, within=1e-12)
        near("P_E,22", last.stress[:, 1, 1], C22 * strain, state, rel=self.within(1e-10))

    def test_steps_by_error_meet_the_tolerance(self) -> None:
        """The last state of a relaxing column against very fine steps; fewer, where little happens."""
        top = {"displacement": (None, {"ramp": -0.1, "until": 0.1}, None), "pressure": 0}
        body = {"size": (1, 1, 1), "elements": (1, 2, 1)}
        held = {face: {"normal": 0} for face in ("x-", "x+", "z-", "z+", "y-")}

        def settle(**plan: Any) -> Any:
            time = {"end": 0.5, "ramp_increments": 2, "ramp_step": 0.01, "profiles": (0.3,)} | plan
            data = {"body": body, "boundary": {**held, "y+": top}, "time": time}
            return self.solve(MacroProblem.model_validate(data), LINEAR)

        fine = settle(step=0.004)
        errors, counts = [], []
        for tolerance in (1e-2, 1e-3):
            found = settle(step=0.5, tolerance=tolerance)
            errors.append(
                abs(found.after_rest[0].p - fine.after_rest[0].p).max() / fine.history.pressure_max.max()
            )
            counts.append(len(found.history.time))
        state = "time.tolerance = 1e-2 and 1e-3, against steps of 0.004"
        found = f"{errors[0]:.3g} and {errors[1]:.3g}"
        less = errors[1] < errors[0] < 0.05 and errors[1] < 0.012
        holds(less, state, "errors of p below 0.05 and 0.012, the second the smaller", found)
        holds(counts[0] < counts[1] < 200, state, "more steps for the second, below 200", counts)

    def test_a_killed_run_continues_to_the_identical_history_on_any_body(self, tmp_path: Path) -> None:
        """A run killed after every step continues to the last bit, with adaptive steps, a follower and probes."""
        problem = self.problem(
            make("wedge", tmp_path),
            boundary={"y+": {"follower": {"table": [[0, 0], [0.4, 0.03], [1, 0.01]]}}},
            probes={"inside": (0.31, 0.2, 0.05)},
            time=SHORT | {"end": 1.0, "tolerance": 1e-2},
        )
        self.needs_checkpoints()
        whole, state = self.solve(problem, NONLINEAR), "a wedge, killed after every step and resumed"
        count = len(whole.history.time) - 1
        holds(count > 8, "time.tolerance = 1e-2 on a wedge", "more than 8 steps", count)
        path = tmp_path / "macro.h5"

        def killed(report: Any) -> None:
            raise KeyboardInterrupt

        for _ in whole.history.time[1:]:
            solver = self.make_solver(checkpoint_seconds=0)
            with suppress(KeyboardInterrupt):
                solver.solve(solver.prepare(problem), NONLINEAR, checkpoint=path, on_step=killed)
        resumed = self.solve(problem, NONLINEAR, checkpoint=path)
        same("time", resumed.history.time, whole.history.time, state)
        same("the probe", resumed.probes["inside"], whole.probes["inside"], state)
        for name, force in whole.reactions.items():
            same(f"the reaction of {name}", resumed.reactions[name], force, state)
        same("the inflow of y+", resumed.inflow["y+"], whole.inflow["y+"], state)
        same("u", resumed.profiles[-1].u, whole.profiles[-1].u, state)

    def test_an_unknown_surface_is_refused(self) -> None:
        data = {"body": {"elements": (1, 1, 1)}, "boundary": {**ROLLERS, "lid": {"pressure": 0}}}
        problem = MacroProblem.model_validate(data)
        with refused(ConfigurationError, state="a boundary 'lid' of a box", naming=("'lid'", "x-")):
            self.prepare(problem)

    def test_an_empty_patch_is_refused(self) -> None:
        data = {
            "body": {"elements": (1, 1, 1)},
            "boundary": ROLLERS,
            "surfaces": {"strip": {"of": "y+", "x": (5, 6)}},
        }
        problem = MacroProblem.model_validate(data)
        with refused(
            ConfigurationError, state="a patch 'strip' beside the body", naming=("strip", "none of")
        ):
            self.prepare(problem)


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
    """Part of :class:`porocore.testing.macro_checks.states.MacroSolverSuite`."""

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
