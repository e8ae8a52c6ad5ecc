"""Contact of rigid indenters: what is refused, small helpers, a wheel and a sphere on bodies of other kinds."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from porocore.commands.verify.linear_cases import isotropic_law
from porocore.core.units import ResultUnits
from porocore.errors import ConfigurationError, SolveError
from porocore.interfaces.solution import CONTACT, write_series
from porocore.macro.boundary.conditions import boundary_data
from porocore.macro.boundary.contact import ContactScales, covered
from porocore.macro.boundary.symmetry import part_problem
from porocore.macro.integration.newton import newton_step
from porocore.macro.problem import MacroProblem, body_mesh
from porocore.plugins.border import body_solution_of
from porocore.plugins.registry import registry
from porocore.report.context import contacts
from porocore.report.figures.curves import panels
from porocore.study.run.summary import rough_contacts, untouched
from porocore.testing.macro_checks.contact import PLANES, RAMP, SPHERE, pressed
from porocore.testing.macro_checks.runs import LINEAR, NONLINEAR

MOVED = SPHERE | {"displacement": 0.05}


def collected(indenter, **settings):
    problem = pressed(indenter, **settings)
    return boundary_data(body_mesh(problem), problem)


@pytest.mark.parametrize(
    ("indenter", "settings", "said"),
    [
        (
            MOVED | {"place": (0, 0.98, 0)},
            {},
            r"macro\.contact\.indenter: the indenter begins 0\.02 deep inside",
        ),
        (
            MOVED | {"surfaces": ["top"]},
            {},
            r"macro\.contact\.indenter\.surfaces: the body has no surface 'top'",
        ),
        (
            MOVED,
            {"boundary": PLANES | {"y+": {"displacement": (None, 0, None)}}},
            r"macro\.contact\.indenter\.surfaces: 9 of the 9 faces belong to macro\.boundary\.y\+, which is held",
        ),
        (MOVED, {"boundary": PLANES | {"y+": {"normal": 0}}}, "is held along its normal"),
        (MOVED, {"boundary": PLANES | {"y+": {"traction": (0, -1, 0)}}}, "is loaded"),
        (MOVED, {"boundary": PLANES | {"y+": {"follower": 1}}}, "is loaded"),
        (
            MOVED | {"outside": "drained"},
            {"boundary": PLANES | {"y+": {"pressure": 0}}},
            "has a pressure or a flux",
        ),
        (
            MOVED | {"place": (0.2, 1, 0)},
            {
                "body": {"kind": "axisymmetric", "radius": 1, "height": 1, "elements": (2, 2)},
                "boundary": {"y-": {"normal": 0}},
            },
            "pressed along its axis alone",
        ),
        (
            MOVED | {"place": (0, 1, 0), "shape": {"kind": "cylinder", "radius": 1}},
            {
                "body": {"kind": "axisymmetric", "radius": 1, "height": 1, "elements": (2, 2)},
                "boundary": {"y-": {"normal": 0}},
            },
            "no body of revolution",
        ),
        (
            MOVED | {"place": (0, 1, 0), "direction": (0, 1, 0)},
            {
                "body": {"kind": "axisymmetric", "radius": 1, "height": 1, "elements": (2, 2)},
                "boundary": {"y-": {"normal": 0}},
            },
            "would move out of the body",
        ),
        (
            MOVED | {"place": (0.2, 1, 0.1)},
            {
                "body": {"kind": "plane-strain", "size": (1, 1), "elements": (2, 2)},
                "boundary": {"y-": {"normal": 0}, "x-": {"normal": 0}},
            },
            "pressed in its plane alone",
        ),
        (
            MOVED | {"place": (0, 1, 0), "shape": {"kind": "cylinder", "radius": 1, "axis": (1, 0, 0)}},
            {
                "body": {"kind": "plane-strain", "size": (1, 1), "elements": (2, 2)},
                "boundary": {"y-": {"normal": 0}, "x-": {"normal": 0}},
            },
            r"macro\.contact\.indenter\.shape\.axis: expected \[0, 0, 1\].*got \[1\.0, 0\.0, 0\.0\]",
        ),
    ],
)
def test_what_is_refused_has_its_key(indenter, settings, said):
    with pytest.raises(ConfigurationError, match=said):
        collected(indenter, **settings)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"force": 1}, "exactly one of displacement and force"),
        ({"displacement": None}, "exactly one of displacement and force"),
        ({"direction": (0, 0, 0)}, "the direction has no length"),
        ({"surfaces": []}, "at least 1 item"),
        ({"shape": {"kind": "sphere", "radius": 0}}, "greater than 0"),
        ({"shape": {"kind": "cylinder", "radius": 1, "axis": (0, 1, 1)}}, "at right angles"),
    ],
)
def test_settings_that_are_none(changes, said):
    with pytest.raises(ValidationError, match=said):
        pressed(MOVED | changes)


def test_a_free_component_beside_an_indenter_is_no_fault():
    held = PLANES | {"y+": {"displacement": (0, None, 0), "pressure": 0}}
    assert len(collected(MOVED, boundary=held).contacts) == 1


def test_an_indenter_changes_the_identity_of_a_problem_and_none_does_not():
    assert "contact" not in pressed(MOVED, contact={}).specification()
    assert pressed(MOVED).specification() != pressed(MOVED | {"penalty": 10}).specification()
    assert pressed(MOVED).parts >= {"contact"}


def test_shares_below_zero_and_their_slopes():
    rng = np.random.default_rng(1)
    for k in (2, 3):
        gaps = rng.normal(size=(200, k))
        found, slopes = covered(gaps)
        # Points at random tell the share to the root of their number.
        points = rng.dirichlet(np.ones(k), 4000)
        assert np.abs((points @ gaps.T < 0).mean(axis=0) - found).max() < 0.04
        h = 1e-7
        for i in range(k):
            up, down = (covered(gaps + sign * h * np.eye(k)[i])[0] for sign in (1, -1))
            np.testing.assert_allclose((up - down) / (2 * h), slopes[:, i], rtol=1e-4, atol=1e-5)


def test_scales_are_powers_of_two():
    one, other = ContactScales.rounded(0.44, 1.94), ContactScales.rounded(0.45, 1.93)
    assert (one.stiffness, one.conductivity) == (other.stiffness, other.conductivity) == (0.5, 2.0)
    assert ContactScales.rounded(0.44, 0.0).conductivity == 1.0


def solver():
    pytest.importorskip("porocore_fem_skfem")
    return registry().get("macro solver", "skfem")()


def solved(problem, law=LINEAR):
    one = solver()
    return one.solve(one.prepare(problem), law)


@pytest.mark.parametrize(
    ("force", "when"),
    [
        (-1e-3, "t = 0.4;"),
        ({"expression": "1e-3*cos(2*pi*t)"}, "t = "),
        ({"table": [[0, 0], [0.3, -1]]}, "t = 0.3;"),
    ],
)
def test_a_force_that_pulls_is_refused(force, when):
    told = rf"macro\.contact\.indenter\.force: the indenter cannot pull.*{when}"
    with pytest.raises(ConfigurationError, match=told):
        collected(SPHERE | {"force": force})


def test_an_indenter_under_a_force_beside_the_body_is_refused():
    with pytest.raises(
        ConfigurationError, match=r"macro\.contact\.indenter: the indenter goes past the body"
    ):
        collected(SPHERE | {"place": (3, 2, 0), "force": 1e-3})


def test_an_indenter_that_leaves_a_symmetry_plane_is_refused():
    body = {"kind": "box", "size": (1, 1, 1), "elements": (2, 2, 2), "symmetry": ("x-", "z-")}
    told = r"macro\.contact\.indenter\.direction: expected one along the symmetry plane 'x-'"
    with pytest.raises(ConfigurationError, match=told):
        part_problem(pressed(MOVED | {"direction": (0.2, -1, 0)}, body=body))
    assert part_problem(pressed(MOVED | {"direction": (0.2, -1, 0), "place": (0.5, 1, 0)}, body=body))


def test_a_force_that_comes_back_to_zero_lets_the_body_go():
    """Newton's method has no stiffness of the contact then; the indenter rests on the surface, and presses again."""
    table = [[0, 0], [0.2, 2e-3], [0.4, 0], [0.6, 2e-3]]
    time = RAMP | {"end": 0.6, "step": 0.1, "profiles": ()}
    found = solved(pressed(SPHERE | {"force": {"table": table}}, time=time))
    at, series = found.history.time, found.contact["indenter"]
    np.testing.assert_allclose(series[:, 0], np.interp(at, *np.array(table).T), rtol=1e-9, atol=1e-14)
    assert series[np.isclose(at, 0.4), 2] == 0
    assert series[-1, 1] > 0.5 * series[:, 1].max() > 0
    assert found.history.iterations.max() <= 8


#: Places of a small ball whose way ends on a corner, leads past an edge, or lifts it and comes back.
WAYS = {
    "touches a corner": {"place": (1, 1, 1), "displacement": 0.1},
    "slides past an edge": {
        "place": (0.7, 1.26, 0.3),
        "direction": (1, -0.1, 0),
        "displacement": {"table": [[0, 0], [2, 1]]},
    },
    "lifts and comes back": {
        "place": (0.4, 1, 0.4),
        "displacement": {"table": [[0, 0], [0.6, 0.05], [1.2, -0.1], [1.8, 0.05]]},
    },
}


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_an_indenter_ends_rightly(way):
    ball = {"shape": {"kind": "sphere", "radius": 0.25}, "surfaces": ["y+"], "outside": "drained"}
    body = {"kind": "box", "size": (1, 1, 1), "elements": (4, 2, 4)}
    held = {"y-": {"displacement": (0, 0, 0)}}
    end = 2.0 if "past" in way else 1.8
    time = RAMP | {"end": end, "step": 0.1}
    found = solved(pressed(ball | WAYS[way], body=body, boundary=held, time=time))
    force, area = found.contact["indenter"][:, [0, 2]].T
    assert np.isfinite(found.profiles[-1].u).all()
    if "past" in way:
        assert np.abs(force).max() > 1e-5
        assert force[-1] == area[-1] == 0  # beside the body
    elif "lifts" in way:
        low = np.isclose(found.history.time, 1.2)
        assert force[low] == 0
        assert force[-1] > 0.5 * force.max() > 0
    else:
        assert (force[1:] > 0).all()


@pytest.mark.parametrize("law", [LINEAR, NONLINEAR], ids=["linear", "nonlinear"])
def test_a_sphere_is_pressed_to_two_fifths_of_the_thickness(law):
    shape = {"kind": "sphere", "radius": 2.0}
    ball = {"shape": shape, "place": (0, 1, 0), "surfaces": ["y+"], "penalty": 1000}
    body = {"kind": "axisymmetric", "radius": 3, "height": 1, "elements": (8, 3)}
    time = RAMP | {"end": 2.1, "step": 0.1, "ramp_increments": 20}
    held = {"y-": {"displacement": (0, 0, 0)}, "side": {"pressure": 0}}
    found = solved(pressed(ball | {"displacement": 0.4}, body=body, boundary=held, time=time), law)
    series = found.contact["indenter"]
    assert (np.diff(series[:-1, 0]) > 0).all()
    assert series[-1, 5] < 1e-3 * 0.4


def test_a_force_that_the_body_cannot_bear_ends_with_one_message():
    time = RAMP | {"smallest_step": 0.04}
    with pytest.raises(SolveError, match="lower the load") as failure:
        solved(pressed(SPHERE | {"force": 50.0}, time=time), NONLINEAR)
    assert "\n" not in str(failure.value)


@pytest.mark.parametrize("by", ["displacement", "force"])
def test_newton_is_quadratic_once_the_points_have_settled(by, monkeypatch):
    """The last residuals but one, of which the very last may be round-off, fall with an order above 3/2."""
    steps = []

    def kept(*arguments, **how):
        steps.append(newton_step(*arguments, **how | {"linearisations": None}))
        return steps[-1]

    monkeypatch.setattr("porocore.macro.integration.solver.newton_step", kept)
    given = {by: 0.05 if by == "displacement" else 2e-3}
    solved(pressed(SPHERE | given, newton={"tolerance": 1e-11}), NONLINEAR)
    assert max(step.iterations for step in steps) <= 8
    settled = 0
    for step in steps:
        before, last = step.misfits[-3:-1] if len(step.misfits) > 2 else (1, 1)
        if before < 0.02:
            settled += 1
            assert last < max(before**1.5, 1e-11)
    assert settled > 3


@pytest.mark.parametrize("backend", ["skfem", pytest.param("dolfinx", marks=pytest.mark.slow)])
@pytest.mark.parametrize("by", ["displacement", "force"])
def test_an_iterative_solver_has_the_answer_of_a_direct_one(by, backend):
    """The preconditioner is that of the body with the contact; few more iterations are taken than without."""
    pytest.importorskip(f"porocore_fem_{backend}")
    pytest.importorskip("pyamg" if backend == "skfem" else "dolfinx")
    given = {by: 0.05 if by == "displacement" else 2e-3, "under": "sealed", "outside": "drained"}
    one = pressed(SPHERE | given, newton={"tolerance": 1e-11}, time=RAMP | {"end": 1.2})
    found = []
    for kind in ("direct", "iterative"):
        make = registry().get("macro solver", backend)(solver=kind)
        found.append(make.solve(make.prepare(one), LINEAR))
    a, b = (each.contact["indenter"] for each in found)
    scales = np.abs(a).max(axis=0)
    np.testing.assert_allclose(b / scales, a / scales, rtol=0, atol=1e-8)
    work = found[1].work
    assert work["iterations"][1:].all()
    assert work["iterations"].sum() < 40 * work["systems"].sum()


def test_a_turned_section_has_the_turned_answer():
    """By a quarter turn of plane strain, against x+ in place of y+."""
    wheel = {"shape": {"kind": "cylinder", "radius": 0.8}, "displacement": 0.05, "outside": "drained"}
    one = pressed(
        wheel | {"place": (0.3, 1, 0), "surfaces": ["y+"]},
        body={"kind": "plane-strain", "size": (1.2, 1), "elements": (3, 2)},
        boundary={"y-": {"normal": 0}, "x-": {"normal": 0}, "x+": {"pressure": 0}},
    )
    other = pressed(
        wheel | {"place": (1, 0.9, 0), "surfaces": ["x+"], "direction": (-1, 0, 0)},
        body={"kind": "plane-strain", "size": (1, 1.2), "elements": (2, 3)},
        boundary={"x-": {"normal": 0}, "y+": {"normal": 0}, "y-": {"pressure": 0}},
    )
    a, b = (solved(each).contact["indenter"] for each in (one, other))
    np.testing.assert_allclose(b, a, rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("law", [LINEAR, NONLINEAR], ids=["linear", "nonlinear"])
def test_what_leaves_beside_an_indenter_is_what_the_body_has_lost(law):
    """The drained volume from the state of the body, and the outflow of every step, beside a wheel that is lifted."""
    course = {"table": [[0, 0], [1, 0.05], [1.4, 0.02]]}
    wheel = {"shape": {"kind": "cylinder", "radius": 0.8}, "place": (0, 1, 0), "surfaces": ["y+"]}
    problem = pressed(
        wheel | {"displacement": course, "under": "sealed", "outside": "drained"},
        body={"kind": "plane-strain", "size": (1, 1), "elements": (3, 2)},
        boundary={"x-": {"normal": 0}, "y-": {"normal": 0}},
        newton={"tolerance": 1e-12},
        time=RAMP | {"end": 1.6},
    )
    found = solved(problem, law)
    outflow = found.contact["indenter"][:, [name for name, *_ in CONTACT].index("outflow")]
    lost = np.cumsum(outflow[1:] * np.diff(found.history.time))
    assert np.ptp(lost) > 1e-3
    np.testing.assert_allclose(found.history.drained[1:], lost, rtol=0, atol=1e-9 * np.abs(lost).max())


def test_a_cylinder_on_a_layer_is_one_in_plane_strain():
    """One layer of elements between planes, and the section of it."""
    indenter = {
        "shape": {"kind": "cylinder", "radius": 0.8},
        "place": (0, 1, 0),
        "displacement": 0.05,
        "surfaces": ["y+"],
        "under": "drained",
        "outside": "drained",
    }
    tight = {"tolerance": 1e-12}
    layer = {"kind": "box", "size": (1, 1, 0.5), "elements": (3, 2, 1), "grading": (2, 0.5, 1)}
    section = {"kind": "plane-strain", "size": (1, 1), "elements": (3, 2), "grading": (2, 0.5), "depth": 0.5}
    faces = {"x-": {"normal": 0}, "y-": {"normal": 0}}
    between = {name: {"normal": 0} for name in ("z-", "z+")}
    one = solved(pressed(indenter, body=layer, boundary=faces | between, newton=tight))
    other = solved(pressed(indenter, body=section, boundary=faces, newton=tight))
    a, b = one.contact["indenter"], other.contact["indenter"]
    columns = [
        0,
        1,
        4,
        5,
        6,
    ]  # an area is found by the gaps beside it, which edges and faces resolve differently
    np.testing.assert_allclose(b[:, columns], a[:, columns], rtol=1e-8, atol=1e-13)


@pytest.mark.slow
def test_the_jump_of_the_pressure_at_the_edge_converges():
    """Sealed under a rounded punch and drained beside it: the force of the pressure below, and what is left beside."""
    punch = {"shape": {"kind": "punch", "radius": 0.5, "edge": 0.25}, "place": (0, 1, 0), "surfaces": ["y+"]}
    punch |= {"displacement": 0.02, "under": "sealed", "outside": "drained"}
    below, beside = [], []
    for n in (8, 16, 32):
        one = pressed(
            punch,
            body={"kind": "axisymmetric", "radius": 1, "height": 1, "elements": (n, n // 2)},
            boundary={"y-": {"normal": 0}, "side": {"normal": 0}},
            time={"end": 0.06, "step": 0.01, "ramp_increments": 4, "ramp_step": 0.01, "profiles": ()},
        )
        found = solved(one, isotropic_law(0.1, 0.15, 0.7, 0.1, 1.0))
        x, y = found.points[:, :2].T
        top = np.flatnonzero(y == 1)
        top = top[x[top].argsort()]
        r, p = x[top], found.profiles[-1].p[top]
        below.append(float(((p * r)[1:] + (p * r)[:-1]) @ np.diff(r)))
        beside.append(np.abs(p[r > 1.02 * found.contact["indenter"][-1, 3]]).max() / p[0])
    assert abs(below[2] - below[1]) < 0.3 * abs(below[1] - below[0])
    assert beside[2] < beside[1] < beside[0]
    assert beside[1] < 2e-3


@pytest.mark.slow
def test_a_sphere_follows_hertz():
    """Drained, on a body much larger than the contact: F = 4/3 E/(1 − ν²) √R δ^(3/2) and a = √(R δ)."""
    lame, shear, radius, depth = 0.1, 0.15, 1.0, 1e-3
    a = np.sqrt(radius * depth)
    size = 40 * a
    ball = {
        "shape": {"kind": "sphere", "radius": radius},
        "place": (0, size, 0),
        "displacement": depth,
        "surfaces": ["y+"],
        "under": "drained",
        "outside": "drained",
    }
    problem = MacroProblem.model_validate(
        {
            "body": {
                "kind": "axisymmetric",
                "radius": size,
                "height": size,
                "elements": (40, 24),
                "grading": (200, 1 / 200),
            },
            "boundary": {"y-": {"normal": 0}},
            "contact": {"ball": ball},
            "time": {"end": 1e4, "step": 1e4, "ramp_increments": 6, "ramp_step": 100.0, "profiles": ()},
        }
    )
    found = solved(problem, isotropic_law(lame, shear, 0.7, 0.1, 1.0)).contact["ball"][-1]
    nu = lame / (2 * (lame + shear))
    hertz = 4 / 3 * 2 * shear / (1 - nu) * np.sqrt(radius) * depth**1.5
    assert found[0] == pytest.approx(hertz, rel=0.03)
    assert found[3] == pytest.approx(a, rel=0.03)


def test_what_a_run_tells_of_indenters():
    far = solved(pressed(MOVED | {"place": (0, 2, 0)}))
    (said,) = untouched(far)
    assert "the indenter 'indenter' never touches the body" in said
    assert not far.contact["indenter"][:, [0, 2, 3, 4, 5, 6]].any()
    near = solved(pressed(MOVED))
    assert not list(untouched(near))
    (said,) = rough_contacts(near, pressed(MOVED))
    assert "'indenter' touches" in said
    assert not list(rough_contacts(far, pressed(MOVED)))
    figures = contacts(near)["indenter"]
    assert figures["largest_displacement"] == 0.05
    assert 0 < figures["largest_penetration"] < 1e-3
    assert figures["peak"] == near.contact["indenter"][:, 0].max() > 0
    assert figures["largest_radius"] == pytest.approx((figures["largest_area"] / np.pi) ** 0.5)


@pytest.mark.parametrize(("elements", "warned"), [(4, True), (24, False)])
def test_few_elements_below_a_ball_in_a_meridian_are_told(elements, warned):
    body = {"kind": "axisymmetric", "radius": 1, "height": 1, "elements": (elements, 4)}
    problem = pressed(MOVED, body=body, boundary={"y-": {"normal": 0}})
    found = solved(problem)
    told = list(rough_contacts(found, problem))
    assert bool(told) == warned
    if warned:
        assert "contact area and radius" in told[0]
        none = found.contact["indenter"].copy()
        none[:, 2:4] = 0
        (told,) = rough_contacts(replace(found, contact={"indenter": none}), problem)
        assert "its contact area is told as 0" in told


@pytest.mark.parametrize("shape", [{"kind": "plane"}, {"kind": "sphere", "radius": 1}])
def test_a_contact_that_is_not_round_has_no_radius(shape, tmp_path):
    section = {"kind": "plane-strain", "size": (1, 1), "elements": (2, 2)}
    held = {"x-": {"normal": 0}, "y-": {"normal": 0}}
    problem = pressed(MOVED | {"shape": shape}, body=section, boundary=held)
    one = registry().get("macro solver", "skfem")()
    found = body_solution_of(
        one, one.prepare(problem), LINEAR, problem
    )  # refuses what a plugin must not return
    figures = contacts(found)["indenter"]
    assert figures["largest_area"] > 0
    assert "largest_radius" not in figures
    table = write_series(tmp_path / "history.csv", found, ResultUnits()).read_text(encoding="utf-8")
    assert "indenter: area" in table
    assert "indenter: radius" not in table
    assert "nan" not in table
    assert "-0," not in table
    plain = [panel.plain for panel in panels(found)]
    assert "forces of indenters" in plain
    assert "contact radius of indenters" not in plain
