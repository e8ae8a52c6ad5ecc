"""Symmetry planes of bodies, and the whole specimen that a part stands for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from porocore.core.formulas import TimeFunction
from porocore.errors import ConfigurationError
from porocore.interfaces.sensitivities import BoundaryChange, LoadChange
from porocore.macro.boundary.symmetry import Symmetry, part_problem, whole_sensitivities, whole_specimen
from porocore.macro.problem import MacroProblem
from porocore.report.context import relaxation
from porocore.testing.macro_checks.runs import COEFFICIENTS, LINEAR
from porocore.testing.synthetic.response import confined_column
from porocore_fem_skfem.macro import SkfemMacroSolver

SLIDES = {"normal": 0}
TIME = {"end": 0.4, "step": 0.1, "ramp_increments": 2, "ramp_step": 0.05, "profiles": (0.1,)}


def problem(body, boundary, **more):
    return MacroProblem.model_validate({"time": TIME, "body": body, "boundary": boundary, **more})


def box(symmetry, boundary, **more):
    return problem({"size": (1, 1, 1), "elements": (2, 2, 2), "symmetry": symmetry}, boundary, **more)


def solved(whole):
    solver, part = SkfemMacroSolver(), part_problem(whole)
    return whole_specimen(solver.solve(solver.prepare(part), LINEAR), whole)


def same_specimen(part, whole, within=1e-9):
    """The volumes of the histories, and the forces and inflows of every surface of the whole."""
    assert (
        part.reactions.keys()
        == whole.reactions.keys()
        == part.compression.keys() | {"side"} & set(whole.reactions)
    )
    for name in ("drained", "drained_paper", "settlement", "pressure_max"):
        a, b = getattr(part.history, name), getattr(whole.history, name)
        np.testing.assert_allclose(a, b, rtol=0, atol=within * abs(b).max(), err_msg=name)
    for kind in ("reactions", "compression", "inflow"):
        for name, theirs in getattr(whole, kind).items():
            found, most = (
                getattr(part, kind)[name],
                max(abs(each).max() for each in getattr(whole, kind).values()),
            )
            np.testing.assert_allclose(found, theirs, rtol=0, atol=within * most, err_msg=f"{kind} {name}")


def test_a_quarter_and_the_whole_cylinder_give_the_same_force_and_volume():
    """Confined: on a smooth base in a ring, under a porous piston."""
    faces = {
        "y-": SLIDES,
        "side": {"displacement": (0, None, 0)},
        "y+": {"displacement": (None, {"ramp": -0.1, "until": 0.1}, None), "pressure": 0},
    }
    size = {"radius": 0.5, "height": 1, "elements": (1, 3, 1)}
    part = solved(problem({"kind": "quarter-cylinder", **size}, {**faces, "x-": SLIDES, "z-": SLIDES}))
    whole = solved(problem({"kind": "cylinder", **size}, faces))
    assert (part.copies, whole.copies) == (4, 1)
    assert part.compression["y+"][-1] > 0.01
    same_specimen(part, whole)


@pytest.mark.parametrize(
    "top", [{"displacement": (0.02, -0.05, 0)}, {"plate": -0.04}], ids=["moved", "plate"]
)
def test_a_half_block_and_the_whole_one_give_the_same_force_and_volume(top):
    """A half between x = 0 and 1 of a block from −1 to 1; shifted, as a box begins at 0."""
    top = {"displacement": (None, -0.05, None)} if "displacement" in top else top
    faces = {
        "y-": {"displacement": (0, 0, 0)},
        "z-": SLIDES,
        "z+": SLIDES,
        "y+": {**top},
        "x+": {"pressure": 0},
    }
    half = solved(box(("x-",), {**faces, "x-": SLIDES}))
    body = {"size": (2, 1, 1), "elements": (4, 2, 2)}
    whole = solved(problem(body, {**faces, "x-": {"pressure": 0}}))
    assert (half.copies, whole.copies) == (2, 1)
    # x+ is one of two faces that drain; the fluid is that through both, and all that has left.
    through = whole.inflow["x+"] + whole.inflow["x-"]
    np.testing.assert_allclose(half.inflow["x+"], through, rtol=0, atol=1e-9 * abs(through).max())
    left = -(np.diff(half.history.time) * half.inflow["x+"][1:]).sum()
    assert left == pytest.approx(half.history.drained[-1], rel=1e-9)
    same_specimen(half, replace(whole, inflow={}))


@pytest.mark.parametrize(
    ("body", "planes", "drained", "area"),
    [
        ({"size": (1, 1, 1), "elements": (2, 1, 2), "symmetry": ("x-", "y-", "z-")}, "xyz", ("x+", "z+"), 4),
        (
            {"kind": "quarter-cylinder", "radius": 1, "height": 1, "elements": (2, 1, 2)},
            "xz",
            ("side",),
            np.pi,
        ),
    ],
    ids=["eighth", "quarter"],
)
def test_the_force_in_equilibrium_is_modulus_times_area_of_the_whole_times_strain(
    body, planes, drained, area
):
    """Unconfined and drained, by hand."""
    faces = {f"{axis}-": SLIDES for axis in {*planes, "y"}} | {face: {"pressure": 0} for face in drained}
    faces["y+"] = {"displacement": (None, {"ramp": -0.005, "until": 0.1}, None)}
    found = solved(problem(body, faces, time=TIME | {"end": 40, "step": 4}))
    C = COEFFICIENTS.stiffness
    across = np.array([[C[i, i, j, j] for j in (0, 2)] for i in (0, 2)])
    modulus = C[1, 1, 1, 1] - C[1, 1, [0, 2], [0, 2]] @ np.linalg.solve(across, C[[0, 2], [0, 2], 1, 1])
    figures = relaxation(found.history.time, found.compression["y+"])
    assert figures["equilibrium"] == pytest.approx(modulus * area * 0.005, rel=1e-3)
    assert figures["peak"] > 1.02 * figures["equilibrium"]
    assert figures["time_of_peak"] == pytest.approx(0.1)


def test_a_wedge_stands_for_the_whole_circle():
    body = {"kind": "wedge", "radius": 1, "height": 0.5, "elements": (3, 1, 1), "angle": 15}
    faces = {
        "y-": SLIDES,
        "z-": SLIDES,
        "oblique": SLIDES,
        "y+": {"displacement": (None, -0.01, None)},
        "side": {"pressure": 0},
    }
    symmetry = Symmetry.of(problem(body, faces))
    assert symmetry.copies == 24
    assert symmetry.surface("y+").copies == symmetry.surface("side").copies == 24
    np.testing.assert_allclose(symmetry.surface("side").projection, np.diag([0, 1, 0]), atol=1e-12)
    assert symmetry.surface("side").normal is None
    assert Symmetry.of(problem(body | {"symmetry": ()}, faces)).copies == 1


@pytest.mark.parametrize(
    ("symmetry", "name", "copies"),
    [
        (("x-",), "y+", 2),
        (("x-",), "x+", 1),
        (("x-", "z-"), "x+", 2),
        (("x-", "z-"), "foot", 4),
        (("x-", "z-"), "far", 1),
        (("x-", "z-", "y-"), "y+", 4),
        ((), "y+", 1),
        (None, "y+", 1),
    ],
)
def test_a_surface_goes_on_across_the_planes_that_it_touches(symmetry, name, copies):
    faces = {face: SLIDES for face in ("x-", "y-", "z-")}
    patches = {
        "foot": {"of": "y+", "centre": (0, 1, 0), "radius": 0.4},
        "far": {"of": "y+", "x": (0.5, 1), "z": (0.5, 1)},
    }
    assert Symmetry.of(box(symmetry, faces, surfaces=patches)).surface(name).copies == copies


def test_rollers_of_a_box_are_no_symmetry_planes_unless_it_is_said():
    column = confined_column(2)
    assert Symmetry.of(column).copies == 1


@pytest.mark.parametrize(
    ("symmetry", "change", "fault"),
    [
        (("x-", "x+"), {}, "face each other"),
        (("top",), {}, "no surface 'top'"),
        (("y+",), {}, "'y+' is no symmetry plane, because it does not slide along itself"),
        (("x-",), {"x-": {"normal": 0, "pressure": 0}}, "lets fluid through"),
        (("x-",), {"x-": {"normal": 0, "traction": (0, 1, 0)}}, "is loaded"),
        (("x-",), {"x-": {"displacement": (0, 0, None)}}, "does not slide"),
        (("x-",), {"x-": {"displacement": (0, None, None)}}, ""),
    ],
)
def test_planes_that_cannot_be_are_refused(symmetry, change, fault):
    faces = {face: SLIDES for face in ("x-", "x+", "y-", "z-")} | change
    if not fault:
        assert Symmetry.of(box(symmetry, faces)).copies == 2
        return
    with pytest.raises(ConfigurationError, match=r"macro\.body\.symmetry") as refused:
        Symmetry.of(box(symmetry, faces))
    assert fault in str(refused.value)


def test_a_body_force_or_an_initial_shear_across_a_plane_is_refused():
    faces = {face: SLIDES for face in ("x-", "y-", "z-")}
    for more, fault in (
        ({"body_force": (0.1, 0, 0)}, "body force"),
        ({"initial": {"gradient": ((0, 0.1, 0), (0, 0, 0), (0, 0, 0))}}, "sheared"),
    ):
        with pytest.raises(ConfigurationError, match=fault):
            Symmetry.of(box(("x-",), faces, **more))
        assert Symmetry.of(box(("z-",), faces, **more)).copies == 2
    # Of a kind that is cut out of a whole, such a plane is none.
    quarter = {"kind": "quarter-cylinder", "radius": 1, "height": 1, "elements": (1, 1, 1)}
    assert Symmetry.of(problem(quarter, faces, body_force=(0.1, 0, 0))).copies == 2


@pytest.mark.parametrize(
    "plate", [-0.8, {"ramp": -0.8, "until": 1}, {"table": [[0, 0], [1, -0.8]]}, {"expression": "-0.8*t"}]
)
def test_the_force_on_a_plate_is_shared_among_the_parts(plate):
    faces = {face: SLIDES for face in ("x-", "y-", "z-")}
    (part,) = {part_problem(box(("x-", "z-"), {**faces, "y+": {"plate": plate}})).boundary["y+"].plate}
    assert (part.at(1.0) if isinstance(part, TimeFunction) else part) == pytest.approx(-0.2)


@pytest.mark.parametrize("plate", [-0.02, {"ramp": -0.02, "until": 0.1}])
def test_derivatives_of_the_whole_are_by_the_numbers_of_the_part(plate):
    """Under a linear law without anything else that acts, a response is its derivative times what acts."""
    faces = {name: SLIDES for name in ("x-", "z-", "y-", "x+")} | {
        "z+": {"pressure": 0},
        "y+": {"plate": plate},
    }
    whole = box(("x-", "z-"), faces, probes={"inside": (0.2, 0.3, 0.4)}, load=0.5)
    solver, part = SkfemMacroSolver(), part_problem(whole)
    changes = [LoadChange(), BoundaryChange("y+", "plate")]
    solution, found = solver.solve_with_sensitivities(solver.prepare(part), LINEAR, changes)
    solution, found = whole_specimen(solution, whole), whole_sensitivities(found, whole)
    acting = [0.5, part.boundary["y+"].plate if isinstance(plate, float) else 1.0]
    for name in ("settlement", "pressure_max", "drained"):
        values = getattr(solution.history, name)
        np.testing.assert_allclose(
            getattr(found, name) * acting, np.stack([values] * 2, axis=-1), atol=1e-9 * abs(values).max()
        )
    for kind in ("probes", "reactions", "compression", "inflow"):
        assert getattr(found, kind).keys() == getattr(solution, kind).keys()
        for name, values in getattr(solution, kind).items():
            np.testing.assert_allclose(
                getattr(found, kind)[name] * acting, np.stack([values] * 2, axis=-1), atol=1e-9, err_msg=name
            )
